"""What of a contact lies on the floor: its size, the points of it that touch, and its picture."""

from __future__ import annotations

from typing import Literal, NamedTuple

from condyn_pin.constraints.constraint_fields import Vector3


class Support(NamedTuple):
    """What of a contact lies on the floor, in the axes of its frame: a point by default."""

    half_length: float | None = 0.0  # [m]; None where nothing says it
    half_width: float | None = 0.0  # [m]
    axis: int | None = None  # of an edge: it lies along x, y or z

    @property
    def is_point(self) -> bool:
        """Whether it has no size at all."""
        return self.half_length == 0.0


class Foot(NamedTuple):
    """A point of the robot, or the middle of a ball, that touches a floor."""

    name: str
    frame: str
    offset: Vector3  # in the axes of the frame [m]
    radius: float = 0.0  # [m]


class Patch(NamedTuple):
    """The shape that a contact is drawn with."""

    shape: Literal["ball", "box", "capsule", "rod"]
    size: tuple[float, ...]  # [m]: radius; three edges; radius and length between the ends
    along: Vector3 = (0.0, 0.0, 1.0)  # axis of a rod
    turns: bool = True  # with the body; else its axes are the world's
