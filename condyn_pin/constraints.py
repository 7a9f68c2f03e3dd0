"""Constraints as the user names them: contacts with the world and loops between bodies.

Each one asks two frames, c1 on a moving body and c2 on another body or the world, to keep their
relative placement. With ``c1Mc2`` the placement of c2 in c1 and ``v1, v2`` the velocities of the
two frames in their own axes, the rows are, in the axes of c1,

    3 rows:  c = -translation(c1Mc2)      J v = linear(v1) - c1R2 linear(v2)
    6 rows:  c = -log6(c1Mc2)             J v = v1 - c1X2 v2

so that the time derivative of c is J v wherever c = 0.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from numbers import Real
from typing import Any, Literal, get_args

import numpy as np

from condyn_pin._pin import pin
from condyn_pin.errors import InvalidArgument

Vector3 = tuple[float, float, float]
Placement = tuple[float, float, float, float, float, float, float]
LoopKind = Literal["ball", "weld"]

WORLD = ("world", "universe")


def _floats(argument: str, value: Any, size: int) -> tuple[float, ...]:
    try:
        array = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        array = np.empty(0)
    if array.shape != (size,) or not np.isfinite(array).all():
        raise InvalidArgument(f"{argument} = {value!r}: {size} finite numbers are needed")
    return tuple(float(x) for x in array)


def _text(argument: str, value: Any) -> str:
    if not isinstance(value, str) or not value:
        raise InvalidArgument(f"{argument} = {value!r}: the name of a frame is needed")
    return value


def _positive(argument: str, value: float | None) -> None:
    number = isinstance(value, Real) and not isinstance(value, bool)
    if value is not None and not (number and math.isfinite(value) and value > 0):
        raise InvalidArgument(f"{argument} = {value!r}: a positive length [m] is needed")


@dataclass(frozen=True, kw_only=True)
class Constraint(ABC):
    """What every constraint has: a name and a number of rows."""

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
class PointContact(Constraint):
    """A point of the robot that keeps its place in the world: 3 rows.

    Parameters
    ----------
    frame : str
        Frame of the robot that carries the point.
    offset : (3,) sequence of float
        The point, in the axes of `frame` [m].
    anchor : (3,) sequence of float, optional
        Where the point belongs, in the world [m]. Without it the point belongs where it is: the
        contact holds it there and has no position error.
    name : str, optional
        Name of the constraint; the frame's name by default.

    Notes
    -----
    The force is the one on the robot, in the axes of `frame` [N]. The contact is bilateral: it
    also pulls.
    """

    frame: str
    offset: Vector3 = (0.0, 0.0, 0.0)
    anchor: Vector3 | None = None

    def __post_init__(self) -> None:
        _text("frame", self.frame)
        object.__setattr__(self, "offset", _floats("offset", self.offset, 3))
        if self.anchor is not None:
            object.__setattr__(self, "anchor", _floats("anchor", self.anchor, 3))
        self._set_name(self.frame)

    @property
    def rows(self) -> int:
        """Number of rows: 3."""
        return 3


@dataclass(frozen=True)
class SurfaceContact(Constraint):
    """A flat part of the robot that keeps its placement in the world: 6 rows.

    Parameters
    ----------
    frame : str
        Frame of the robot in the middle of the surface, z along its normal.
    half_length, half_width : float, optional
        Half of the size along x and y of `frame` [m]. The dynamics do not need them; they are
        where `corners` puts its points.
    anchor : (7,) sequence of float or pin.SE3, optional
        Where the frame belongs in the world: x y z [m] and the quaternion x y z w. Without it the
        surface belongs where it is.
    name : str, optional
        Name of the constraint; the frame's name by default.

    Notes
    -----
    The force is the wrench on the robot at the origin of `frame`, in its axes, linear part first
    [N, N m]. The contact is bilateral.
    """

    frame: str
    half_length: float | None = None  # [m]
    half_width: float | None = None  # [m]
    anchor: Placement | None = None

    def __post_init__(self) -> None:
        _text("frame", self.frame)
        _positive("half_length", self.half_length)
        _positive("half_width", self.half_width)
        if self.anchor is not None:
            anchor = self.anchor
            if isinstance(anchor, pin.SE3):
                anchor = pin.SE3ToXYZQUAT(anchor)
            numbers = _floats("anchor", anchor, 7)
            norm = math.hypot(*numbers[3:])
            if norm == 0.0:
                raise InvalidArgument("anchor: its quaternion (x y z w) is zero; use 0 0 0 1")
            unit = (*numbers[:3], *(x / norm for x in numbers[3:]))
            object.__setattr__(self, "anchor", unit)
        self._set_name(self.frame)

    @property
    def rows(self) -> int:
        """Number of rows: 6."""
        return 6

    def corners(self) -> tuple[PointContact, ...]:
        """Return the same support as four points: 12 rows, of which 6 are redundant."""
        if self.half_length is None or self.half_width is None:
            raise InvalidArgument(
                f"{self.name}: half_length and half_width are not set, so there are no corners; "
                "use SurfaceContact(frame, half_length=..., half_width=...)"
            )
        signs = {"front_left": (1, 1), "front_right": (1, -1), "back_left": (-1, 1),
                 "back_right": (-1, -1)}  # fmt: skip
        made = []
        for corner, (x, y) in signs.items():
            offset = np.array([x * self.half_length, y * self.half_width, 0.0])
            anchor = None
            if self.anchor is not None:
                anchor = pin.XYZQUATToSE3(np.array(self.anchor)).act(offset)
            made.append(PointContact(self.frame, offset, anchor, name=f"{self.name}/{corner}"))  # type: ignore[arg-type]
        return tuple(made)


@dataclass(frozen=True)
class Loop(Constraint):
    """Two frames of the robot that stay together: a closed chain.

    Parameters
    ----------
    frame_a, frame_b : str
        The two halves of the joint that closes the loop. One of them may belong to the world.
    kind : {"ball", "weld"}
        ``ball`` keeps the two origins together (3 rows), ``weld`` the whole frames (6 rows). A
        ball closes planar linkages too; it is redundant there, which every solver of this library
        that says ok has taken care of. A weld in place of a hinge locks the hinge.
    name : str, optional
        Name of the constraint; ``frame_a~frame_b`` by default.

    Notes
    -----
    The force is the one on the body of `frame_a`, at its origin and in its axes; the body of
    `frame_b` feels the opposite. When `frame_a` belongs to the world, the axes and the origin are
    those of `frame_b`.
    """

    frame_a: str
    frame_b: str
    kind: LoopKind = "ball"

    def __post_init__(self) -> None:
        _text("frame_a", self.frame_a)
        _text("frame_b", self.frame_b)
        if self.kind not in get_args(LoopKind):
            raise InvalidArgument(
                f"kind = {self.kind!r}: known kinds of loops are {', '.join(get_args(LoopKind))}"
            )
        self._set_name(f"{self.frame_a}~{self.frame_b}")

    @property
    def rows(self) -> int:
        """Number of rows: 3 for a ball, 6 for a weld."""
        return 3 if self.kind == "ball" else 6
