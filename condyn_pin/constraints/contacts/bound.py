"""Contacts bound to a model: the joints, points and coordinates that their rows are made of."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

from condyn_pin._core.arrays import Array
from condyn_pin.constraints.base import Patch


class Touch(NamedTuple):
    """A feeler of one body over a plane of another: three rows."""

    name: str
    joint: int
    centre: Array  # (3,), on the joint [m]
    radius: float  # [m]
    ground: int  # the joint that carries the plane; 0 for the world
    plane: Any  # pin.SE3 on that joint, z out of the ground
    friction: float
    restitution: float


class Stop(NamedTuple):
    """An end of the range of a joint: one row, sign (q - limit) >= 0."""

    name: str
    iq: int
    iv: int
    sign: float
    limit: float  # [rad, m]


class Dry(NamedTuple):
    """Dry friction along a coordinate of v: one row, |lam| <= limit."""

    name: str
    iv: int
    limit: float  # [N m, N]


class Solid(NamedTuple):
    """A shape on a joint, for who draws it."""

    joint: int
    placement: Any  # pin.SE3 on that joint
    patch: Patch


@dataclass(frozen=True, eq=False)
class BoundContact:
    """A contact on the joints of a model; most kinds fill one of the lists."""

    name: str
    touches: tuple[Touch, ...] = ()
    stops: tuple[Stop, ...] = ()
    dry: tuple[Dry, ...] = ()
    solids: tuple[Solid, ...] = ()

    @property
    def candidates(self) -> tuple[str, ...]:
        """Names of its cones, half-lines and intervals."""
        cones, stops = (touch.name for touch in self.touches), (stop.name for stop in self.stops)
        return (*cones, *stops, *(each.name for each in self.dry))
