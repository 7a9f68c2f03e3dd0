"""What an SDF file says: plain values, placed in the model frame o."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf
from typing import Any, Final

from condyn_pin._core.arrays import Array

WORLD: Final = "world"


@dataclass(frozen=True, eq=False)
class Link:
    """A link of the file, or the cross of a universal joint, which has no mass of its own."""

    name: str
    pose: Any  # oMlink
    inertia: Any | None  # in the link's frame; None for a cross
    massless: bool = False
    weighs: bool = True


@dataclass(frozen=True)
class Mimic:
    """What an axis of a joint follows: q = ratio q_leader + offset."""

    leader: str
    axis: str  # axis or axis2
    ratio: float
    offset: float  # [rad or m]


@dataclass(frozen=True, eq=False)
class Axis:
    """An axis of a joint; what the file leaves out is infinite or zero."""

    direction: Array | None = None  # unit vector in the joint's axes
    lower: float = -inf  # [rad or m]
    upper: float = inf
    effort: float = inf  # [N m or N]
    velocity: float = inf  # [rad/s or m/s]
    damping: float = 0.0  # [N m s/rad or N s/m]
    friction: float = 0.0  # [N m or N]
    stiffness: float = 0.0  # of its spring [N m/rad or N/m]
    reference: float = 0.0  # where the spring rests [rad or m]
    mimic: Mimic | None = None


NO_AXIS: Final = Axis()


@dataclass(frozen=True)
class Gear:
    """What a gearbox says: theta_child = -ratio theta_parent, both seen from the reference link."""

    ratio: float
    reference: str


@dataclass(frozen=True, eq=False)
class Joint:
    """A joint of the file between two links, its type as the file writes it."""

    name: str
    kind: str
    parent: str
    child: str
    pose: Any  # oMj
    axis: Axis
    axis2: Axis  # of a universal joint or a gearbox
    gear: Gear | None  # of a gearbox
    pitch: float = 0.0  # of a screw, right-handed [m/rad]

    @property
    def has_axis(self) -> bool:
        """Whether it is a hinge, a slider or a screw: one coordinate, about or along the axis."""
        return self.kind in ("revolute", "continuous", "prismatic", "screw")

    def reversed(self) -> Joint:
        """Return the same joint from child to parent.

        R(-a, q) = R(a, q)⁻¹: a hinge, slider or screw about the opposite axis keeps its coordinate
        q, and with it limits, spring and damping. The quaternion of a ball becomes its inverse.
        """
        axis = self.axis
        if axis.direction is not None:
            axis = replace(axis, direction=-axis.direction)
        return replace(self, parent=self.child, child=self.parent, axis=axis)


@dataclass(frozen=True)
class SdfModel:
    """The model of a file, its links and joints in the order of the file."""

    name: str
    pose: Any  # wMo, the model frame in the world
    canonical: str  # the link with which the model frame moves
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]
    frames: Mapping[str, tuple[str, Any]]  # the link that carries each, and its pose in the model
    gravity: Array | None  # [m/s^2]
    defaults: Mapping[str, Sequence[str]]  # inertias that the file leaves out, with their links
    unread: tuple[str, ...]  # sentences
    unmodelled: tuple[str, ...]  # sentences
