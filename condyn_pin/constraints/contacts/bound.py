"""Contacts bound to a model: the joints, points and coordinates that their rows are made of."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

from condyn_pin._core.arrays import Array
from condyn_pin.constraints.contacts.cores import Core
from condyn_pin.constraints.contacts.meetings import most_meetings
from condyn_pin.constraints.support import Patch


class Touch(NamedTuple):
    """A contact point of one body over a plane of another: three rows."""

    name: str
    joint: int
    centre: Array  # (3,), on the joint [m]
    radius: float  # [m]
    ground: int  # the joint that carries the plane; 0 for the world
    plane: Any  # pin.SE3 on that joint, z out of the ground
    friction: float
    restitution: float


class Pair(NamedTuple):
    """A shape of one body near one of another: three rows for each place of a point."""

    name: str
    joint: int
    placement: Any  # pin.SE3 of the shape on that joint
    shape: Core
    ground: int  # the joint that carries the other; 0 for the world
    ground_placement: Any
    ground_shape: Core
    friction: float
    restitution: float

    @property
    def points(self) -> int:
        """Number of places."""
        return most_meetings(self.shape, self.ground_shape)

    @property
    def candidates(self) -> tuple[str, ...]:
        """Names of the places."""
        if self.points == 1:
            return (self.name,)
        return tuple(f"{self.name}/point {i}" for i in range(1, self.points + 1))


class Stop(NamedTuple):
    """An end of the range of a joint: one row, sign (q - limit) >= 0."""

    name: str
    iq: int
    iv: int
    sign: float
    limit: float  # [rad, m]
    is_length: bool


class Dry(NamedTuple):
    """Dry friction along a coordinate of v: one row, |lam| <= limit."""

    name: str
    iv: int
    limit: float  # [N m, N]


class Solid(NamedTuple):
    """A shape on a joint, to be drawn."""

    joint: int
    placement: Any  # pin.SE3 on that joint
    patch: Patch


@dataclass(frozen=True, eq=False)
class BoundContact:
    """A contact on the joints of a model; most kinds fill one of the lists."""

    name: str
    touches: tuple[Touch, ...] = ()
    pairs: tuple[Pair, ...] = ()
    stops: tuple[Stop, ...] = ()
    dry: tuple[Dry, ...] = ()
    solids: tuple[Solid, ...] = ()

    @property
    def cones(self) -> tuple[tuple[str, int], ...]:
        """Name of each of its cones, and the joint that carries what it touches."""
        on_planes = [(touch.name, touch.ground) for touch in self.touches]
        of_pairs = [(name, pair.ground) for pair in self.pairs for name in pair.candidates]
        return (*on_planes, *of_pairs)

    @property
    def candidates(self) -> tuple[str, ...]:
        """Names of its cones, half-lines and intervals."""
        cones = [name for name, _ in self.cones]
        return (*cones, *(stop.name for stop in self.stops), *(each.name for each in self.dry))
