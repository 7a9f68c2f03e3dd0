"""A ball that rolls on a plane; the rows are in `condyn_pin.constraints.rows.special`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from condyn_pin.constraints.constraint import Foot, FramedModel, Vector3
from condyn_pin.constraints.on_velocity import OnPlane
from condyn_pin.constraints.places import FrameLike
from condyn_pin.constraints.rows.special import BoundRolling, BoundRollingOver


@dataclass(frozen=True)
class RollingBall(OnPlane):
    """A ball that rolls on a plane without slipping: 3 rows.

    Its lowest point has the velocity of the plane: v - radius omega x n = 0 on one that stands
    still. It may spin about the normal n.

    Parameters
    ----------
    frame : str, (joint, pin.SE3) or pin.Frame
        Frame of the robot in the middle of the ball.
    radius : float
        Radius [m].
    normal : (3,) sequence of float
        Of the plane, in the axes of `on`; any length.
    height : float, optional
        Of the plane, along the normal from the origin of `on` [m]. Without it the plane is where
        the ball lies: the row off the plane has no position error either.
    on : str, (joint, pin.SE3) or pin.Frame
        Frame that carries the plane: `normal` and `height` are in its axes. The world by default;
        a frame of another body for a table, a belt or a ramp that moves.
    name : str, optional
        Name of the constraint; the frame's name by default.

    Raises
    ------
    InvalidArgument
        If `frame` is no frame, the radius is not positive, or the normal is zero.

    Notes
    -----
    The force is the one on the robot at the lowest point, in the axes of the plane [N]: z is the
    normal. On a level plane x and y are the world's.
    """

    rows: ClassVar[int] = 3

    frame: FrameLike
    radius: float  # [m]
    normal: Vector3 = (0.0, 0.0, 1.0)
    height: float | None = None  # [m]
    on: FrameLike = "world"

    def __post_init__(self) -> None:
        self._check()
        self._set_name(self.frame)

    def bind(self, machine: FramedModel, rows: slice) -> BoundRolling | BoundRollingOver:
        """Return the constraint with c1 its frame, and c2 the plane."""
        return self._rolled(machine, rows, (0, 1, 2), axle=None)

    @property
    def feet(self) -> tuple[Foot, ...]:
        """The ball, on a plane of the world."""
        if self.support is None:
            return ()
        return (Foot(self.name, self.frame, (0.0, 0.0, 0.0), self.radius),)
