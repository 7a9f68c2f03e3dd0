"""Edge contact with the world: the rows of a surface but the turn about the edge."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin.constraints.constraint import (
    USUAL,
    Axis,
    Constraint,
    Foot,
    FramedModel,
    Patch,
    Placement,
    Support,
    WithWorld,
    check_axis,
    check_lengths,
    lever,
    placement,
)
from condyn_pin.constraints.places import FrameLike, set_frames
from condyn_pin.constraints.point_contact import PointContact, point_of
from condyn_pin.constraints.rows.bound import FRAME, BoundBetweenFrames
from condyn_pin.errors import InvalidArgument


@dataclass(frozen=True)
class LineContact(WithWorld):
    """A straight edge of the robot that stays in place in the world: 5 rows.

    v = 0,    e x omega = 0    of the frame

    The robot can still roll about the edge e: Cassie's foot.

    Parameters
    ----------
    frame : str, (joint, pin.SE3) or pin.Frame
        Frame of the robot in the middle of the edge.
    axis : {"x", "y", "z"}
        Of `frame`: the edge lies along it.
    half_length : float, optional
        Half of the edge [m]. The dynamics do not need it; it is where `ends` puts its points.
    anchor : (7,) sequence of float or pin.SE3, optional
        Where the frame belongs in the world, up to a turn about the edge: x y z [m] and the
        quaternion x y z w. Without it the edge belongs where it is.
    name : str, optional
        Name of the constraint; the frame's name by default.

    Raises
    ------
    InvalidArgument
        If `frame` is no frame, the axis is unknown, a size is not positive, or the anchor is no
        placement.

    Notes
    -----
    The force is the wrench on the robot at the origin of `frame`, in its axes, linear part first
    [N, N m]; its moment about the edge is zero. The contact is bilateral.
    """

    rows: ClassVar[int] = 5
    by_points_called: ClassVar[str] = "ends for edges"
    word: ClassVar[str] = "line"
    lengths: ClassVar[tuple[str, ...]] = ("half_length", "anchor")

    frame: FrameLike
    axis: Axis = "x"
    half_length: float | None = None  # [m]
    anchor: Placement | None = None

    def __post_init__(self) -> None:
        set_frames(self, "frame")
        check_axis(self.axis)
        check_lengths(half_length=self.half_length)
        object.__setattr__(self, "anchor", placement("anchor", self.anchor))
        self._set_name(self.frame)

    def ends(self) -> tuple[PointContact, PointContact]:
        """Return an equivalent support by two points: 6 rows, of which 1 is redundant.

        Raises
        ------
        InvalidArgument
            If the edge does not say its length.
        """
        if self.half_length is None:
            raise InvalidArgument(
                f"{self.name}: half_length is not set, so there are no ends; "
                "use LineContact(frame, half_length=...)"
            )
        direction = np.eye(3)["xyz".index(self.axis)]
        front, back = (
            point_of(self, end, sign * self.half_length * direction)
            for end, sign in (("front", 1), ("back", -1))
        )
        return front, back

    def bind(self, machine: FramedModel, rows: slice) -> BoundBetweenFrames:
        """Return the contact with c1 its frame and c2 the anchor, free to turn about the edge."""
        joint, placement = machine.frame(self.frame)
        place = pin.XYZQUATToSE3(np.array(self.anchor)) if self.anchor else pin.SE3.Identity()
        axis = "xyz".index(self.axis)
        return BoundBetweenFrames(
            self.name, rows, joint, placement, 0, place, tuple(i for i in FRAME if i != 3 + axis),
            anchored=self.anchor is not None, axis=axis,
            lever=self.half_length or lever(machine, placement),
        )  # fmt: skip

    @property
    def support(self) -> Support:
        """The edge."""
        return Support(self.half_length, 0.0, "xyz".index(self.axis))

    @property
    def feet(self) -> tuple[Foot, ...]:
        """Ends of the edge."""
        return tuple(foot for end in self.ends() for foot in end.feet)

    def anchored_at(self, c1: Any, c2: Any) -> LineContact:
        """Return the contact anchored at its frame c1."""
        return replace(self, anchor=tuple(pin.SE3ToXYZQUAT(c1).tolist()))

    def by_points(self, robot: Any) -> tuple[Any, tuple[Constraint, ...]]:
        """Return the two ends, if the edge has a length."""
        return robot, self.ends() if self.half_length else (self,)

    def patch(self, size: float) -> Patch:
        """Return a rod along the edge."""
        x, y, z = np.eye(3)["xyz".index(self.axis)].tolist()
        return Patch("rod", (0.006 * size, 2.0 * (self.half_length or USUAL * size)), (x, y, z))
