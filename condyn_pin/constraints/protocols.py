"""What constraints are bound to, and what they are written to."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

from condyn_pin.constraints.constraint_fields import Vector3


class Machine(Protocol):
    """What constraints are bound to: a `pinocchio.Model` with frames by name, such as a `Robot`."""

    @property
    def model(self) -> Any:
        """The `pinocchio.Model`."""

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints, the world's not among them."""

    @property
    def longest_link(self) -> float:
        """The longest way from a joint to the next one [m]."""

    def frame(self, name: str) -> tuple[int, Any]:
        """Return the joint that carries a frame and its placement on it, or raise UnknownName."""


class MjcfGeomWriter(Protocol):
    """What a contact writes itself to as MJCF."""

    def collide(
        self,
        name: str,
        first: tuple[str, Vector3, Any],
        second: Any,
        friction: float,
    ) -> None:
        """Write a frame, an offset in it and a shape; and the plane, or frame and shape, below."""

    def dry(self, joint: str, torque: float | None) -> None:
        """Write the dry friction of a joint [N m, N]."""


class MjcfWriter(Protocol):
    """What a constraint writes itself to as MJCF."""

    robot: Any

    def equate(self, tag: str, **words: str | Sequence[float]) -> None:
        """Write an equality."""

    def fixed_tendon(self, name: str, weights: Mapping[str, float]) -> str:
        """Return the name of a new tendon: a weighted sum of joint coordinates."""

    def site(self, frame: str, new: str) -> str:
        """Return the site of a frame; it is made, and called `new`, where there is none."""

    def site_beside(self, frame: str, new: str, shift: Vector3) -> str:
        """Return a new site, shifted from a frame in its axes [m]."""

    def coordinate(self, joint: str) -> float:
        """Return the coordinate of a joint where the file draws the model [rad or m]."""
