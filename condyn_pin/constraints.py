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

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from numbers import Real
from typing import Any, Final, Literal, get_args

import numpy as np

from condyn_pin import tolerances
from condyn_pin.arrays import finite
from condyn_pin.errors import InvalidArgument

Axis = Literal["x", "y", "z"]
LoopKind = Literal["ball", "weld", "hinge", "slider", "planar", "rod"]

WORLD = ("world", "universe")

_ROWS: Final[dict[str, int]] = {
    "ball": 3, "weld": 6, "hinge": 5, "slider": 5, "planar": 2, "rod": 1,
}  # fmt: skip


def floats(argument: str, value: Any, size: int) -> tuple[float, ...]:
    """Return a sequence of numbers as a tuple, or raise InvalidArgument."""
    try:
        array = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        array = np.empty(0)
    if array.shape != (size,) or not np.isfinite(array).all():
        raise InvalidArgument(f"{argument} = {value!r}: {size} finite numbers are needed")
    check_size(argument, *array)
    return tuple(float(x) for x in array)


def check_size(argument: str, *numbers: float) -> None:
    """Refuse numbers so large that what is computed from them overflows."""
    for number in numbers:
        if abs(number) > tolerances.HUGE:
            raise InvalidArgument(
                f"{argument} = {number:g}: no machine has that; {tolerances.HUGE:g} is the largest "
                "number"
            )


def direction(argument: str, value: Any) -> tuple[float, ...]:
    """Return three numbers as a vector of unit length, or raise InvalidArgument."""
    return unit(floats(argument, value, 3), f"{argument} = (0, 0, 0): a direction is needed")


def unit(vector: Sequence[float], fault: str) -> tuple[float, ...]:
    """Return a vector at unit length; InvalidArgument says the fault of one that is zero."""
    exponent = math.frexp(max(map(abs, vector)))[1]
    scaled = [math.ldexp(x, -exponent) for x in vector]  # exact, and no longer subnormal
    norm = math.hypot(*scaled)
    if norm == 0.0:
        raise InvalidArgument(fault)
    return tuple(x / norm for x in scaled)


def text(argument: str, value: Any, what: str = "frame") -> str:
    """Return the name of something, or raise InvalidArgument."""
    if not isinstance(value, str) or not value:
        raise InvalidArgument(f"{argument} = {value!r}: the name of a {what} is needed")
    return value


def positive(argument: str, value: float | None) -> None:
    """Refuse what is not a positive length."""
    number = isinstance(value, Real) and not isinstance(value, bool)
    if value is not None and not (number and math.isfinite(value) and value > 0):
        raise InvalidArgument(f"{argument} = {value!r}: a positive length [m] is needed")
    if value is not None:
        check_size(argument, value)


def check_axis(axis: Any) -> None:
    """Refuse what is not the name of an axis."""
    if axis not in get_args(Axis):
        raise InvalidArgument(f"axis = {axis!r}: one of {', '.join(get_args(Axis))} is needed")


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
        and ``planar`` is not. A weld in place of a hinge locks the hinge.
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
        positive("length", self.length)
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
