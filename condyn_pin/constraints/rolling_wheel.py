"""A thin wheel that rolls on a plane; the rows are in `condyn_pin.constraints.rows.special`."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from condyn_pin.constraints.constraint import Axis, FramedModel, Support, Vector3, check_axis
from condyn_pin.constraints.on_velocity import EVERY, Direction, OnPlane
from condyn_pin.constraints.places import FrameLike
from condyn_pin.constraints.rows.special import BoundRolling, BoundRollingOver
from condyn_pin.errors import InvalidArgument


@dataclass(frozen=True)
class RollingWheel(OnPlane):
    """A thin wheel that rolls on a plane without slipping: 3 rows or fewer.

    Its lowest point has the velocity of the plane, upright or leaning: on one that stands still,
    with e the axle, n the normal of the plane
    and all in the axes of the body,

        t = e x n / |e x n|,    r = radius e x t,    v + omega x r = 0   along t, n x t and n.

    Parameters
    ----------
    frame : str, (joint, pin.SE3) or pin.Frame
        Frame of the robot in the middle of the wheel.
    radius : float
        Radius [m].
    axis : {"x", "y", "z"}
        Of `frame`: the axle.
    holds : sequence of {"rolling", "lateral", "normal"}
        The directions in which it does not slip: along t, across, and off the plane. A base that
        moves in the plane anyway needs no "normal", and an omnidirectional wheel has no "lateral".
    normal : (3,) sequence of float
        Of the plane, in the axes of `on`; any length.
    height : float, optional
        Of the plane, along the normal from the origin of `on` [m]. Without it the plane is where
        the wheel stands: "normal" has no position error either.
    on : str, (joint, pin.SE3) or pin.Frame
        Frame that carries the plane: `normal` and `height` are in its axes. The world by default;
        a frame of another body for a table, a belt or a ramp that moves.
    name : str, optional
        Name of the constraint; the frame's name by default.

    Raises
    ------
    InvalidArgument
        If `frame` is no frame, the axis or a direction is unknown, the radius is not positive, or
        the normal is zero.

    Notes
    -----
    The force is the one on the robot at the lowest point: along t, n x t and n [N]. Flat on the
    plane a wheel has no lowest point: the rows along it vanish, and `Scene.rank` names them.
    """

    frame: FrameLike
    radius: float  # [m]
    axis: Axis = "y"
    holds: tuple[Direction, ...] = EVERY
    normal: Vector3 = (0.0, 0.0, 1.0)
    height: float | None = None  # [m]
    on: FrameLike = "world"

    def __post_init__(self) -> None:
        check_axis(self.axis)
        object.__setattr__(self, "holds", _in_order(self.holds))
        self._check()
        self._set_name(self.frame)

    @property
    def rows(self) -> int:
        """Number of rows: one for each direction."""
        return len(self.holds)

    def bind(self, machine: FramedModel, rows: slice) -> BoundRolling | BoundRollingOver:
        """Return the constraint with c1 its frame, and c2 the plane."""
        holds = tuple(EVERY.index(each) for each in self.holds)
        return self._rolled(machine, rows, holds, axle="xyz".index(self.axis))

    @property
    def title(self) -> str:
        """Name of the kind, with the directions without slip."""
        return f"RollingWheel ({', '.join(self.holds)})"

    @property
    def _support(self) -> Support | None:
        """A point, if the wheel is held to the plane."""
        return Support() if "normal" in self.holds else None


def _in_order(holds: object) -> tuple[Direction, ...]:
    """Directions in the order of the rows, or InvalidArgument."""
    asked = tuple(holds) if isinstance(holds, Iterable) and not isinstance(holds, str) else ()
    if not asked or any(asked.count(each) > 1 or each not in EVERY for each in asked):
        raise InvalidArgument(
            f"holds = {holds!r}: some of {', '.join(EVERY)} are needed, each once"
        )
    return tuple(each for each in EVERY if each in asked)
