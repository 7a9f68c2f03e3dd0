"""A point that slides on a plane of the world: it does not move along the normal n.

c = n . p - height
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from condyn_pin.constraints.constraint import (
    THIN,
    USUAL,
    Foot,
    FramedModel,
    Patch,
    Support,
    Vector3,
    WithWorld,
    direction,
    floats,
    plane,
    shifted_placement,
)
from condyn_pin.constraints.places import FrameLike, set_frames
from condyn_pin.constraints.rows.bound import BoundBetweenFrames


@dataclass(frozen=True)
class PlanarContact(WithWorld):
    """A point of the robot that slides on a plane of the world without friction: 1 row.

    n . p(q) = height,    n . v_p = 0

    Parameters
    ----------
    frame : str, (joint, pin.SE3) or pin.Frame
        Frame of the robot that carries the point.
    offset : (3,) sequence of float
        The point, in the axes of `frame` [m].
    normal : (3,) sequence of float
        Of the plane, in the world; any length.
    height : float, optional
        Of the plane, along the normal from the world's origin [m]. Without it the plane goes
        through the point.
    name : str, optional
        Name of the constraint; the frame's name by default.

    Raises
    ------
    InvalidArgument
        If `frame` is no frame, a number is not finite, or the normal is zero.

    Notes
    -----
    The force is the one on the robot [N], in the axes of the plane: z is the normal, x and y are
    zero. The contact is bilateral.
    """

    rows: ClassVar[int] = 1
    word: ClassVar[str] = "planar"
    lengths: ClassVar[tuple[str, ...]] = ("offset", "height")
    unitless: ClassVar[tuple[str, ...]] = ("normal",)
    has_normal: ClassVar[bool] = True

    frame: FrameLike
    offset: Vector3 = (0.0, 0.0, 0.0)
    normal: Vector3 = (0.0, 0.0, 1.0)
    height: float | None = None  # [m]

    def __post_init__(self) -> None:
        set_frames(self, "frame")
        object.__setattr__(self, "offset", floats("offset", self.offset, 3))
        object.__setattr__(self, "normal", direction("normal", self.normal))
        if self.height is not None:
            object.__setattr__(self, "height", floats("height", [self.height], 1)[0])
        self._set_name(self.frame)

    def bind(self, machine: FramedModel, rows: slice) -> BoundBetweenFrames:
        """Return the contact with c1 the plane, z along its normal, and c2 the robot's point."""
        joint, placement = machine.frame(self.frame)
        return BoundBetweenFrames(
            self.name, rows, 0, plane(self.normal, self.height),
            joint, shifted_placement(placement, self.offset), (2,),
            anchored=self.height is not None, sign=-1.0,
        )  # fmt: skip

    def acting(self, *, swapped: bool) -> tuple[str, str, str]:
        """Return the frame, the world, and the plane for its axes."""
        return self.frame, "world", f"{self.name}/plane"

    @property
    def support(self) -> Support:
        """A point."""
        return Support()

    @property
    def feet(self) -> tuple[Foot, ...]:
        """The point."""
        return (Foot(self.name, self.frame, self.offset),)

    def anchored_at(self, c1: Any, c2: Any) -> PlanarContact:
        """Return the contact with the plane through the point."""
        return replace(self, height=float(np.dot(self.normal, c2.translation)))

    def patch(self, size: float) -> Patch:
        """Return a disc in the plane, whose normal is one of the world."""
        return Patch("rod", (USUAL * size, THIN * size), self.normal, turns=False)
