"""Constraints on the velocity alone: blades, wheels and balls that roll.

    A(q) v = 0,        A a + Adot v = a_ref = -2 alpha A v

Such a row takes a direction away from the velocity and none from the position: a blade gets to
every place of the plane. It has no gap, so nothing is there to assemble, and of Baumgarte's two
terms only alpha acts. Its force is J^T lam as of any other row (d'Alembert), and does no work
where A v = 0.

The exception is the height of what rolls: that row is the rate of a distance, and has a gap where
the plane has a height.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal, get_args

from condyn_pin._core.errors import InvalidArgument
from condyn_pin.constraints.constraint_fields import (
    Axis,
    Vector3,
    check_axis,
    check_positive,
    direction,
    floats,
    text,
)
from condyn_pin.constraints.constraints import Constraint

Direction = Literal["rolling", "lateral", "normal"]

EVERY: tuple[Direction, ...] = get_args(Direction)


class Nonholonomic(Constraint):
    """A constraint with rows on the velocity alone."""


@dataclass(frozen=True)
class Knife(Nonholonomic):
    """A blade, a skate, a wheel seen from above: a point that does not slip sideways. 1 row.

    e . v = 0, with e an axis of the frame and v the velocity of the point.

    Parameters
    ----------
    frame : str
        Frame of the robot that carries the blade.
    axis : {"x", "y", "z"}
        Of `frame`: across the blade.
    offset : (3,) sequence of float
        The point, in the axes of `frame` [m].
    name : str, optional
        Name of the constraint; the frame's name by default.

    Notes
    -----
    The force is the one on the robot, in the axes of `frame` [N]: along `axis` only.
    """

    frame: str
    axis: Axis = "y"
    offset: Vector3 = (0.0, 0.0, 0.0)  # [m]

    def __post_init__(self) -> None:
        text("frame", self.frame)
        check_axis(self.axis)
        object.__setattr__(self, "offset", floats("offset", self.offset, 3))
        self._set_name(self.frame)

    @property
    def rows(self) -> int:
        """Number of rows: 1."""
        return 1


@dataclass(frozen=True)
class RollingWheel(Nonholonomic):
    """A thin wheel that rolls on a plane of the world without slipping: 3 rows or fewer.

    Its lowest point has no velocity, upright or leaning: with e the axle, n the normal of the plane
    and all in the axes of the body,

        t = e x n / |e x n|,    r = radius e x t,    v + omega x r = 0   along t, n x t and n.

    Parameters
    ----------
    frame : str
        Frame of the robot in the middle of the wheel.
    radius : float
        [m].
    axis : {"x", "y", "z"}
        Of `frame`: the axle.
    holds : sequence of {"rolling", "lateral", "normal"}
        The directions in which it does not slip: along t, across, and off the plane. A base that
        moves in the plane anyway needs no "normal", and an omnidirectional wheel has no "lateral".
    normal : (3,) sequence of float
        Of the plane, in the world; any length.
    height : float, optional
        Of the plane, along the normal from the world's origin [m]. Without it the plane is where
        the wheel stands: "normal" has no position error either.
    name : str, optional
        Name of the constraint; the frame's name by default.

    Notes
    -----
    The force is the one on the robot at the lowest point: along t, n x t and n [N]. Flat on the
    plane a wheel has no lowest point: the rows along it vanish, and `Scene.rank` says so.
    """

    frame: str
    radius: float  # [m]
    axis: Axis = "y"
    holds: tuple[Direction, ...] = EVERY
    normal: Vector3 = (0.0, 0.0, 1.0)
    height: float | None = None  # [m]

    def __post_init__(self) -> None:
        check_axis(self.axis)
        object.__setattr__(self, "holds", _directions(self.holds))
        _check_rolling(self)
        self._set_name(self.frame)

    @property
    def rows(self) -> int:
        """Number of rows: one for each direction."""
        return len(self.holds)

    @property
    def kind(self) -> str:
        """The directions in which it does not slip, for summaries."""
        return ", ".join(self.holds)


@dataclass(frozen=True)
class RollingBall(Nonholonomic):
    """A ball that rolls on a plane of the world without slipping: 3 rows.

    Its lowest point has no velocity: v - radius omega x n = 0. It may spin about the normal n.

    Parameters
    ----------
    frame : str
        Frame of the robot in the middle of the ball.
    radius : float
        [m].
    normal : (3,) sequence of float
        Of the plane, in the world; any length.
    height : float, optional
        Of the plane, along the normal from the world's origin [m]. Without it the plane is where
        the ball lies: the row off the plane has no position error either.
    name : str, optional
        Name of the constraint; the frame's name by default.

    Notes
    -----
    The force is the one on the robot at the lowest point, in the axes of the plane [N]: z is the
    normal. On a level plane x and y are the world's.
    """

    frame: str
    radius: float  # [m]
    normal: Vector3 = (0.0, 0.0, 1.0)
    height: float | None = None  # [m]

    def __post_init__(self) -> None:
        _check_rolling(self)
        self._set_name(self.frame)

    @property
    def rows(self) -> int:
        """Number of rows: 3."""
        return 3


Rolling = RollingWheel | RollingBall


def _check_rolling(made: Rolling) -> None:
    text("frame", made.frame)
    check_positive("length [m]", radius=made.radius)
    object.__setattr__(made, "radius", float(made.radius))
    object.__setattr__(made, "normal", direction("normal", made.normal))
    if made.height is not None:
        object.__setattr__(made, "height", floats("height", [made.height], 1)[0])


def _directions(holds: object) -> tuple[Direction, ...]:
    """Return the directions in the order of the rows, or raise InvalidArgument."""
    asked = tuple(holds) if isinstance(holds, Iterable) and not isinstance(holds, str) else ()
    if not asked or any(asked.count(each) > 1 or each not in EVERY for each in asked):
        raise InvalidArgument(
            f"holds = {holds!r}: some of {', '.join(EVERY)} are needed, each once"
        )
    return tuple(each for each in EVERY if each in asked)
