"""Shapes of bodies that touch: points, balls, capsules and boxes.

What of a shape meets a plane are its contact points, points with a radius: the gap of one at p over
a plane n . x = height is n . p - height - radius, and the gap of the shape is the least of them.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

from condyn_pin._core.arguments import enter
from condyn_pin.constraints.constraint_fields import Vector3, check_positive
from condyn_pin.constraints.contacts.cores import Core, box_core, points_core
from condyn_pin.constraints.support import Patch

# All shapes by the names of their classes, by which archives find them.
SHAPES: dict[str, type[Shape]] = {}


class ContactPoint(NamedTuple):
    """A point of a shape that may touch first, in the axes of the shape."""

    called: str  # among those of its shape; empty for the only one
    middle: Vector3  # [m]
    radius: float  # [m]


class Shape(ABC):
    """What has contact points."""

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        enter(SHAPES, cls.__name__, cls, f"a shape named {cls.__name__}")

    @property
    @abstractmethod
    def contact_points(self) -> tuple[ContactPoint, ...]:
        """The points that may touch a plane."""

    @property
    def patch(self) -> Patch | None:
        """What it is drawn as; None for what has no size."""
        return None

    @property
    def core(self) -> Core:
        """Itself without its round skin; what contact points there are make a ball or a capsule."""
        radius = self.contact_points[0].radius
        return points_core(*(each.middle for each in self.contact_points), radius=radius)


@dataclass(frozen=True)
class Point(Shape):
    """A point: a tip, a stud, the middle of a small foot."""

    @property
    def contact_points(self) -> tuple[ContactPoint, ...]:
        """Itself."""
        return (ContactPoint("", (0.0, 0.0, 0.0), 0.0),)


@dataclass(frozen=True)
class Ball(Shape):
    """A ball round the origin.

    Parameters
    ----------
    radius : float
        Radius [m].

    Raises
    ------
    InvalidArgument
        If the radius is not positive.
    """

    radius: float  # [m]

    def __post_init__(self) -> None:
        check_positive("length [m]", radius=self.radius)
        object.__setattr__(self, "radius", float(self.radius))

    @property
    def contact_points(self) -> tuple[ContactPoint, ...]:
        """Its middle."""
        return (ContactPoint("", (0.0, 0.0, 0.0), self.radius),)

    @property
    def patch(self) -> Patch:
        """Itself."""
        return Patch("ball", (self.radius,))


@dataclass(frozen=True)
class Capsule(Shape):
    """A rod with round ends, along z.

    Parameters
    ----------
    radius : float
        Radius [m].
    half_length : float
        Half the distance between the middles of its two ends [m].

    Raises
    ------
    InvalidArgument
        If a length is not positive.
    """

    radius: float  # [m]
    half_length: float  # [m]

    def __post_init__(self) -> None:
        check_positive("length [m]", radius=self.radius, half_length=self.half_length)
        object.__setattr__(self, "radius", float(self.radius))
        object.__setattr__(self, "half_length", float(self.half_length))

    @property
    def contact_points(self) -> tuple[ContactPoint, ...]:
        """The middles of its ends."""
        return (
            ContactPoint("end 1", (0.0, 0.0, self.half_length), self.radius),
            ContactPoint("end 2", (0.0, 0.0, -self.half_length), self.radius),
        )

    @property
    def patch(self) -> Patch:
        """Itself."""
        return Patch("capsule", (self.radius, 2.0 * self.half_length))


@dataclass(frozen=True)
class Box(Shape):
    """A box round the origin.

    Parameters
    ----------
    x, y, z : float
        Half of its edges [m].

    Raises
    ------
    InvalidArgument
        If an edge is not positive.
    """

    x: float  # [m]
    y: float  # [m]
    z: float  # [m]

    def __post_init__(self) -> None:
        check_positive("half of an edge [m]", x=self.x, y=self.y, z=self.z)
        for edge in "xyz":
            object.__setattr__(self, edge, float(getattr(self, edge)))

    @property
    def contact_points(self) -> tuple[ContactPoint, ...]:
        """Its corners, from (x, y, z) to (-x, -y, -z); the sign of z changes fastest."""
        corners = product((self.x, -self.x), (self.y, -self.y), (self.z, -self.z))
        return tuple(ContactPoint(f"corner {i}", at, 0.0) for i, at in enumerate(corners, start=1))

    @property
    def patch(self) -> Patch:
        """Itself."""
        return Patch("box", (2.0 * self.x, 2.0 * self.y, 2.0 * self.z))

    @property
    def core(self) -> Core:
        """The box."""
        return box_core(self.x, self.y, self.z)
