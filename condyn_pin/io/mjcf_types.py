"""What an MJCF file says, and what becomes of it: plain values.

Angles are in radians, axes and quaternions are normalised, and every pose is the one in which the
file draws the model: MuJoCo calls that configuration qpos0.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from condyn_pin._core.arrays import Array
from condyn_pin.constraints.coupling import Coupling
from condyn_pin.constraints.loop import Loop
from condyn_pin.model.spring import Spring

WORLD: Final = "world"
COORDINATES: Final[Mapping[str, int]] = {"free": 7, "ball": 4, "slide": 1, "hinge": 1}


@dataclass(frozen=True, eq=False)
class Joint:
    """A joint of the file.

    Attributes
    ----------
    name, kind : str
        Its name and its type: free, ball, slide or hinge.
    point : (3,) array
        Where it is, in the axes of its body [m].
    axis : (3,) array
        Unit vector in the axes of its body; of a free or a ball joint, none.
    reference : float
        Its coordinate where the file draws the model [rad or m].
    lower, upper : float
        [rad or m], infinite if there is none.
    armature, damping : float
        [kg m^2 or kg], [N m s/rad or N s/m].
    stiffness, rest : float
        Of its spring: [N m/rad or N/m], [rad or m].
    """

    name: str
    kind: str
    point: Array
    axis: Array
    reference: float
    lower: float
    upper: float
    armature: float
    damping: float
    stiffness: float
    rest: float


@dataclass(frozen=True, eq=False)
class Body:
    """A body of the file; the first one is the world.

    Attributes
    ----------
    name : str
    parent : int
        Position of its parent in the list of bodies; parents stand before their children.
    pose : pin.SE3
        parentMbody.
    inertia : pin.Inertia or None
        In the body's axes; None if the file gives none.
    joints : tuple of Joint
        Between the parent and the body, in the order in which they move it.
    sites : mapping of str to pin.SE3
        bodyMsite.
    """

    name: str
    parent: int
    pose: Any
    inertia: Any | None
    joints: tuple[Joint, ...]
    sites: Mapping[str, Any]


@dataclass(frozen=True, eq=False)
class End:
    """One side of a closure: a site by name, or a pose on a body.

    Attributes
    ----------
    body : str
    pose : pin.SE3 or None
        bodyMend; None for the one that coincides with the other end as the model is drawn.
    site : str
        Name of the site that this is; empty if there is none.
    """

    body: str
    pose: Any | None
    site: str = ""


@dataclass(frozen=True, eq=False)
class Closure:
    """Two ends that stay together: kind "ball" (a <connect>) or "weld"."""

    name: str
    kind: str
    ends: tuple[End, End]


@dataclass(frozen=True, eq=False)
class Gear:
    """Two joints: q_a - reference_a = shift + ratio (q_b - reference_b)."""

    name: str
    joint_a: str
    joint_b: str
    ratio: float
    shift: float  # [rad or m]


@dataclass(frozen=True, eq=False)
class Description:
    """What an MJCF file says.

    Attributes
    ----------
    name : str
    gravity : (3,) array
        [m/s^2]
    bodies : tuple of Body
        Depth-first, the world first.
    equalities : tuple of Closure or Gear
    actuated : tuple of str
        Joints with a motor.
    keyframes : mapping of str to array
        Configurations, the numbers in MuJoCo's order.
    unused : tuple of str
        What the file has and nobody reads, a sentence each.
    """

    name: str
    gravity: Array
    bodies: tuple[Body, ...]
    equalities: tuple[Closure | Gear, ...]
    actuated: tuple[str, ...]
    keyframes: Mapping[str, Array]
    unused: tuple[str, ...]


@dataclass(frozen=True)
class MjcfRobot:
    """What was read from an MJCF file; the fields are those of `Robot`."""

    model: Any
    loops: tuple[Loop | Coupling, ...]
    actuated: tuple[str, ...]
    springs: tuple[Spring, ...]
    postures: Mapping[str, Array]
    unused: tuple[str, ...]
