"""A blade: e . v = 0, with e an axis of the frame and v the velocity of the point."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from condyn_pin._core._pin import pin
from condyn_pin.constraints.constraint import (
    Axis,
    FramedModel,
    Vector3,
    check_axis,
    floats,
    shifted_placement,
)
from condyn_pin.constraints.on_velocity import Nonholonomic
from condyn_pin.constraints.places import FrameLike, set_frames
from condyn_pin.constraints.rows.bound import BoundBetweenFrames


@dataclass(frozen=True)
class KnifeEdge(Nonholonomic):
    """A blade, a skate, or a wheel seen from above: a point that does not slip sideways. 1 row.

    e . v = 0, with e an axis of the frame and v the velocity of the point.

    Parameters
    ----------
    frame : str, (joint, pin.SE3) or pin.Frame
        Frame of the robot that carries the blade.
    axis : {"x", "y", "z"}
        Of `frame`: across the blade.
    offset : (3,) sequence of float
        The point, in the axes of `frame` [m].
    name : str, optional
        Name of the constraint; the frame's name by default.

    Raises
    ------
    InvalidArgument
        If `frame` is no frame, the axis is unknown, or a number is not finite.

    Notes
    -----
    The force is the one on the robot, in the axes of `frame` [N]: along `axis` only.
    """

    rows: ClassVar[int] = 1
    lengths: ClassVar[tuple[str, ...]] = ("offset",)

    frame: FrameLike
    axis: Axis = "y"
    offset: Vector3 = (0.0, 0.0, 0.0)  # [m]

    def __post_init__(self) -> None:
        set_frames(self, "frame")
        check_axis(self.axis)
        object.__setattr__(self, "offset", floats("offset", self.offset, 3))
        self._set_name(self.frame)

    def bind(self, machine: FramedModel, rows: slice) -> BoundBetweenFrames:
        """Return the constraint with c1 at the point, in the axes of the frame."""
        joint, placement = machine.frame(self.frame)
        chosen = ("xyz".index(self.axis),)
        point, world = shifted_placement(placement, self.offset), pin.SE3.Identity()
        return BoundBetweenFrames(self.name, rows, joint, point, 0, world, chosen, anchored=False)
