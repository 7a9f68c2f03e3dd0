"""Constraints as the user names them: loops between bodies, and couplings of joints.

A loop asks two frames, c1 and c2, to keep a part of their relative placement. With r the position
of c2's origin in c1, R the axes of c2 in c1, and every velocity in the axes of its own frame, body
1 slips past body 2 at the origin of c2 with

    s = ( v1 + omega1 x r - R v2,   omega1 - R omega2 )        in the axes of c1,

and a kind is a choice of rows of s = 0:

    ball    x y z                the two origins stay together
    weld    x y z rx ry rz       the two frames stay together
    hinge   all but the turn about `axis`
    slider  all but the shift along `axis`
    planar  x y z but the shift along `axis`: a pin that says nothing across the plane
    rod     r . s / |r|: the distance of the two origins stays
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Final, Literal, get_args

from condyn_pin._core.arrays import finite
from condyn_pin._core.errors import InvalidArgument
from condyn_pin.constraints.constraint_fields import (
    Axis,
    check_axis,
    check_lengths,
    check_size,
    text,
)

LoopKind = Literal["ball", "weld", "hinge", "slider", "planar", "rod"]

WORLD = ("world", "universe")

_ROWS: Final[dict[str, int]] = {
    "ball": 3, "weld": 6, "hinge": 5, "slider": 5, "planar": 2, "rod": 1,
}  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Constraint(ABC):
    """What every constraint has: a name and a number of rows.

    Parameters
    ----------
    name : str, optional
        What forces, rows and errors are listed under; after its frames or joints by default.
    """

    name: str = ""

    def _set_name(self, default: str) -> None:
        if not isinstance(self.name, str):
            raise InvalidArgument(f"name = {self.name!r}: a text is needed")
        object.__setattr__(self, "name", self.name or default)

    @property
    @abstractmethod
    def rows(self) -> int:
        """Number of rows of the constraint."""


@dataclass(frozen=True)
class Loop(Constraint):
    """Two frames of the robot that stay together in part: a closed chain.

    Parameters
    ----------
    frame_a, frame_b : str
        The two halves of the joint that closes the loop. One of them may belong to the world.
    kind : {"ball", "weld", "hinge", "slider", "planar", "rod"}
        The joint that was cut, with 3, 6, 5, 5, 2 and 1 rows. A ball closes planar linkages too;
        it is redundant there, which every solver of this library that says ok has taken care of,
        and ``planar`` is not. Sliders, rods, and planar pins whose bodies can leave the plane
        have no equivalent in Pinocchio, and take five times as long or more. A weld in place of a
        hinge locks the hinge.
    axis : {"x", "y", "z"}
        Of `frame_a`: what a hinge turns about, a slider moves along, and a planar pin says nothing
        about. The same axis of `frame_b` coincides with it in a hinge. The other kinds ignore it.
    length : float, optional
        Of a rod [m], which needs it; the other kinds have none.
    name : str, optional
        Name of the constraint; ``frame_a~frame_b`` by default.

    Notes
    -----
    The force is the one on the body of `frame_a`, at the origin of `frame_b` and in the axes of
    `frame_a`; the body of `frame_b` feels the opposite. When `frame_a` of a ball, a weld or a
    hinge belongs to the world, the axes are those of `frame_b`.
    """

    frame_a: str
    frame_b: str
    kind: LoopKind = "ball"
    axis: Axis = "z"
    length: float | None = None  # [m]

    def __post_init__(self) -> None:
        text("frame_a", self.frame_a)
        text("frame_b", self.frame_b)
        if self.kind not in get_args(LoopKind):
            raise InvalidArgument(
                f"kind = {self.kind!r}: known kinds of loops are {', '.join(_ROWS)}"
            )
        check_axis(self.axis)
        check_lengths(length=self.length)
        if (self.kind == "rod") != (self.length is not None):
            wanted = "a rod needs its length" if self.kind == "rod" else "only a rod has a length"
            raise InvalidArgument(f"length = {self.length!r} for a {self.kind}: {wanted} [m]")
        self._set_name(f"{self.frame_a}~{self.frame_b}")

    @property
    def rows(self) -> int:
        """Number of rows of the kind."""
        return _ROWS[self.kind]


@dataclass(frozen=True)
class Coupling(Constraint):
    """Two joints that move in proportion: a gear, a belt, a mimic joint. 1 row.

    q_a = ratio q_b + offset

    Parameters
    ----------
    joint_a, joint_b : str
        Joints with one degree of freedom.
    ratio : float
        [1], or [m/rad] and [rad/m] between a hinge and a slider.
    offset : float
        q_a where q_b is zero [rad or m].
    name : str, optional
        Name of the constraint; ``joint_a~joint_b`` by default.

    Notes
    -----
    The force is the one on joint a, along its coordinate [N m or N]; joint b feels minus `ratio`
    times it.
    """

    joint_a: str
    joint_b: str
    ratio: float = 1.0
    offset: float = 0.0  # [rad or m]

    def __post_init__(self) -> None:
        text("joint_a", self.joint_a, "joint")
        text("joint_b", self.joint_b, "joint")
        for argument in ("ratio", "offset"):
            number = float(finite(argument, getattr(self, argument), ()))
            check_size(argument, number)
            object.__setattr__(self, argument, number)
        if self.ratio == 0.0:
            raise InvalidArgument("ratio = 0: that holds joint a still; lock the joint instead")
        self._set_name(f"{self.joint_a}~{self.joint_b}")

    @property
    def rows(self) -> int:
        """Number of rows: 1."""
        return 1
