"""What an SDF file says, and what becomes of it: plain values."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import inf
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from condyn_pin.constraints.coupling import Coupling

WORLD: Final = "world"


@dataclass(frozen=True, eq=False)
class Link:
    """A link of the file, placed in the model frame.

    Attributes
    ----------
    name : str
        Its name.
    pose : pin.SE3
        oMlink.
    inertia : pin.Inertia or None
        In the link's frame; None if the file gives none.
    massless : bool
        Whether it is the cross of a universal joint, which the file does not have.
    """

    name: str
    pose: Any
    inertia: Any | None
    massless: bool = False


@dataclass(frozen=True, eq=False)
class Axis:
    """An axis of a joint.

    Attributes
    ----------
    direction : (3,) array or None
        Unit vector in the joint's axes; None if the file gives none.
    lower, upper : float
        [rad or m], infinite if there is none.
    effort, velocity : float
        [N m or N], [rad/s or m/s], infinite if there is none.
    damping, friction : float
        [N m s/rad or N s/m], [N m or N].
    stiffness, reference : float
        Of its spring: [N m/rad or N/m], [rad or m].
    """

    direction: NDArray[np.float64] | None = None
    lower: float = -inf
    upper: float = inf
    effort: float = inf
    velocity: float = inf
    damping: float = 0.0
    friction: float = 0.0
    stiffness: float = 0.0
    reference: float = 0.0


NO_AXIS: Final = Axis()


@dataclass(frozen=True)
class Gear:
    """What a gearbox says: theta_child = -ratio theta_parent, both seen from the reference link."""

    ratio: float
    reference: str


@dataclass(frozen=True, eq=False)
class Joint:
    """A joint of the file, placed in the model frame.

    Attributes
    ----------
    name, kind, parent, child : str
        Its name, its type as the file writes it, and the two links.
    pose : pin.SE3
        oMj.
    axis, axis2 : Axis
        The second one belongs to a universal joint or a gearbox.
    gear : Gear or None
        Of a gearbox.
    """

    name: str
    kind: str
    parent: str
    child: str
    pose: Any
    axis: Axis
    axis2: Axis
    gear: Gear | None

    @property
    def has_axis(self) -> bool:
        """Whether it is a hinge or a slider: one coordinate, about or along the axis."""
        return self.kind in ("revolute", "continuous", "prismatic")

    def reversed(self) -> Joint:
        """Return the same joint from child to parent.

        R(-a, q) = R(a, q)⁻¹: a hinge or a slider about the opposite axis keeps its coordinate q,
        and with it limits, spring and damping. The quaternion of a ball becomes its inverse.
        """
        axis = self.axis
        if axis.direction is not None:
            axis = replace(axis, direction=-axis.direction)
        return replace(self, parent=self.child, child=self.parent, axis=axis)


@dataclass(frozen=True)
class Description:
    """What an SDF file says.

    Attributes
    ----------
    name : str
        Name of the model.
    pose : pin.SE3
        wMo, the model frame in the world.
    links : tuple of Link
        In the order of the file.
    joints : tuple of Joint
        In the order of the file.
    frames : mapping of str to (str, pin.SE3)
        Frames of the file: the link that carries each one, and its pose in the model.
    unread : Counter
        How many elements of each tag were not read.
    """

    name: str
    pose: Any
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]
    frames: Mapping[str, tuple[str, Any]]
    unread: Counter[str]


@dataclass(frozen=True)
class Closure:
    """A joint of the file that is cut out of the tree: it closes a loop.

    Attributes
    ----------
    name : str
        The joint's name in the file.
    kind : str
        The kind of `Loop`: "ball", "weld" (from a fixed joint), "hinge" (revolute, continuous) or
        "slider" (prismatic).
    frame_a : str
        Frame of the model at the joint, on its parent link; z along the axis of a hinge or slider.
    frame_b : str
        The same on its child link.
    """

    name: str
    kind: str
    frame_a: str
    frame_b: str


@dataclass(frozen=True)
class SdfRobot:
    """What was read from an SDF file.

    Attributes
    ----------
    model : pin.Model
        The tree. Each link is a BODY frame, each joint a JOINT frame (FIXED_JOINT for a fixed
        one), each frame of the file and each end of a closure an OP_FRAME.
    closures : tuple of Closure
        The joints that close loops, in the order of the file.
    couplings : tuple of Coupling
        The gearboxes, in the order of the file.
    springs : mapping of str to (float, float)
        Joint name to stiffness [N m/rad or N/m] and reference [rad or m].
    reversed : tuple of str
        Joints that the tree holds from child to parent.
    unused : tuple of str
        What the file has and the model does not use, one sentence for each kind of thing.
    """

    model: Any
    closures: tuple[Closure, ...]
    couplings: tuple[Coupling, ...]
    springs: Mapping[str, tuple[float, float]]
    reversed: tuple[str, ...]
    unused: tuple[str, ...]
