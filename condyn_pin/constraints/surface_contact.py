"""A surface held in the world: the velocity of its frame stays zero, linear and angular."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin.constraints.constraint import (
    THIN,
    USUAL,
    Constraint,
    Foot,
    FramedModel,
    Patch,
    Placement,
    Support,
    WithWorld,
    check_lengths,
    lever,
    placement,
)
from condyn_pin.constraints.places import FrameLike, set_frames
from condyn_pin.constraints.point_contact import PointContact, point_of
from condyn_pin.constraints.rows.bound import FRAME, BoundBetweenFrames
from condyn_pin.errors import InvalidArgument


@dataclass(frozen=True)
class SurfaceContact(WithWorld):
    """A flat part of the robot that stays in place in the world: 6 rows.

    v = 0,    omega = 0    of the frame

    Parameters
    ----------
    frame : str, (joint, pin.SE3) or pin.Frame
        Frame of the robot in the middle of the surface, z along its normal.
    half_length, half_width : float, optional
        Half of the size along x and y of `frame` [m]. The dynamics do not need them; `corners`,
        support polygons and wrench cones do.
    anchor : (7,) sequence of float or pin.SE3, optional
        Where the frame belongs in the world: x y z [m] and the quaternion x y z w. Without it the
        contact holds the surface where it is, and has no position error.
    name : str, optional
        Name of the constraint; the frame's name by default.

    Raises
    ------
    InvalidArgument
        If `frame` is no frame, a size is not positive, or the anchor is no placement.

    Notes
    -----
    The force is the wrench on the robot at the origin of `frame`, in its axes, linear part first
    [N, N m]. The contact is bilateral.
    """

    rows: ClassVar[int] = 6
    by_points_called: ClassVar[str] = "corners for surfaces"
    word: ClassVar[str] = "surface"
    lengths: ClassVar[tuple[str, ...]] = ("half_length", "half_width", "anchor")
    has_normal: ClassVar[bool] = True

    frame: FrameLike
    half_length: float | None = None  # [m]
    half_width: float | None = None  # [m]
    anchor: Placement | None = None

    def __post_init__(self) -> None:
        set_frames(self, "frame")
        check_lengths(half_length=self.half_length, half_width=self.half_width)
        object.__setattr__(self, "anchor", placement("anchor", self.anchor))
        self._set_name(self.frame)

    def corners(self) -> tuple[PointContact, ...]:
        """Return an equivalent support by four points: 12 rows, of which 6 are redundant.

        Raises
        ------
        InvalidArgument
            If the surface does not say its size.
        """
        if self.half_length is None or self.half_width is None:
            raise InvalidArgument(
                f"{self.name}: half_length and half_width are not set, so there are no corners; "
                "use SurfaceContact(frame, half_length=..., half_width=...)"
            )
        signs = {"front_left": (1, 1), "front_right": (1, -1), "back_left": (-1, 1),
                 "back_right": (-1, -1)}  # fmt: skip
        return tuple(
            point_of(self, corner, np.array([x * self.half_length, y * self.half_width, 0.0]))
            for corner, (x, y) in signs.items()
        )

    def bind(self, machine: FramedModel, rows: slice) -> BoundBetweenFrames:
        """Return the contact with c1 its frame, and c2 the anchor."""
        joint, placement = machine.frame(self.frame)
        place = pin.XYZQUATToSE3(np.array(self.anchor)) if self.anchor else pin.SE3.Identity()
        return BoundBetweenFrames(
            self.name, rows, joint, placement, 0, place, FRAME,
            anchored=self.anchor is not None, lever=lever(machine, placement),
        )  # fmt: skip

    @property
    def support(self) -> Support:
        """A rectangle."""
        return Support(self.half_length, self.half_width)

    @property
    def feet(self) -> tuple[Foot, ...]:
        """Corners of the surface."""
        return tuple(foot for corner in self.corners() for foot in corner.feet)

    def anchored_at(self, c1: Any, c2: Any) -> SurfaceContact:
        """Return the contact anchored at its frame c1."""
        return replace(self, anchor=tuple(pin.SE3ToXYZQUAT(c1).tolist()))

    def by_points(self, robot: Any) -> tuple[Any, tuple[Constraint, ...]]:
        """Return the four corners, if the surface has a size."""
        return robot, self.corners() if self.half_length and self.half_width else (self,)

    def patch(self, size: float) -> Patch:
        """Return a thin box."""
        x, y = self.half_length or USUAL * size, self.half_width or USUAL * size
        return Patch("box", (2.0 * x, 2.0 * y, THIN * size))
