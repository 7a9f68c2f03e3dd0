"""A point held in the world: its velocity stays zero.

J v = v + omega x r,        r the point in its frame
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.constraint import (
    Foot,
    FramedModel,
    Support,
    Vector3,
    WithWorld,
    floats,
    lever,
    shifted_placement,
)
from condyn_pin.constraints.places import FrameLike, set_frames
from condyn_pin.constraints.rows.bound import POINT, BoundBetweenFrames


@dataclass(frozen=True)
class PointContact(WithWorld):
    """A point of the robot that stays in place in the world: 3 rows.

    p(q) = anchor,    v_p = 0

    Parameters
    ----------
    frame : str, (joint, pin.SE3) or pin.Frame
        Frame of the robot that carries the point.
    offset : (3,) sequence of float
        The point, in the axes of `frame` [m].
    anchor : (3,) sequence of float, optional
        Where the point belongs, in the world [m]. Without it the point belongs where it is: the
        contact holds it there and has no position error.
    name : str, optional
        Name of the constraint; the frame's name by default.

    Raises
    ------
    InvalidArgument
        If `frame` is no frame, or a number is not finite.

    Notes
    -----
    The force acts on the robot, in the axes of `frame` [N]. The contact is bilateral: it can also
    pull.
    """

    rows: ClassVar[int] = 3
    word: ClassVar[str] = "point"
    lengths: ClassVar[tuple[str, ...]] = ("offset", "anchor")

    frame: FrameLike
    offset: Vector3 = (0.0, 0.0, 0.0)
    anchor: Vector3 | None = None

    def __post_init__(self) -> None:
        set_frames(self, "frame")
        object.__setattr__(self, "offset", floats("offset", self.offset, 3))
        if self.anchor is not None:
            object.__setattr__(self, "anchor", floats("anchor", self.anchor, 3))
        self._set_name(self.frame)

    def bind(self, machine: FramedModel, rows: slice) -> BoundBetweenFrames:
        """Return the contact with c1 at the point, in the frame's axes, and c2 at the anchor."""
        joint, placement = machine.frame(self.frame)
        place = pin.SE3.Identity()
        if self.anchor:
            place = pin.XYZQUATToSE3(np.array((*self.anchor, 0.0, 0.0, 0.0, 1.0)))
        return BoundBetweenFrames(
            self.name, rows, joint, shifted_placement(placement, self.offset), 0, place, POINT,
            anchored=self.anchor is not None, lever=lever(machine, placement),
        )  # fmt: skip

    @property
    def support(self) -> Support:
        """A point."""
        return Support()

    @property
    def feet(self) -> tuple[Foot, ...]:
        """The point."""
        return (Foot(self.name, self.frame, self.offset),)

    @property
    def point(self) -> Vector3 | None:
        """Point in the axes of its frame, if the contact has no anchor."""
        return None if self.anchor else self.offset

    def anchored_at(self, c1: Any, c2: Any) -> PointContact:
        """Return the contact anchored at its point."""
        return replace(self, anchor=tuple(c1.translation.tolist()))


def point_of(contact: Any, name: str, offset: Array) -> PointContact:
    """Point contact of an extended contact, anchored at the same place."""
    anchor = None
    if contact.anchor is not None:
        anchor = tuple(pin.XYZQUATToSE3(np.array(contact.anchor)).act(offset))
    name = f"{contact.name}/{name}"
    return PointContact(contact.frame, tuple(offset), anchor, name=name, drift=contact.drift)
