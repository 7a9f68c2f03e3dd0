"""Constraints on the velocity alone: blades, wheels and balls that roll.

    A(q) v = 0,        A a + Adot v = a_ref = -2 alpha A v

Such a row takes a direction away from the velocity and none from the position: a blade gets to
every place of the plane. It has no gap, so nothing is there to assemble, and of Baumgarte's two
terms only alpha acts. Its force is J^T lam as of any other row (d'Alembert), and does no work
where A v = 0.

The exception is the height of what rolls: that row is the rate of a distance, and has a gap where
the plane has a height.
"""

from __future__ import annotations

from abc import ABC
from collections.abc import Callable
from dataclasses import replace
from typing import Any, ClassVar, Literal, Self, get_args

from condyn_pin.constraints.constraint import (
    FramedModel,
    Support,
    Vector3,
    WithWorld,
    check_positive,
    direction,
    floats,
    plane,
)
from condyn_pin.constraints.places import WORLD, FrameLike, set_frames
from condyn_pin.constraints.rows.bound import BoundConstraint
from condyn_pin.constraints.rows.special import BoundRolling, BoundRollingOver, RollingOver

Direction = Literal["rolling", "lateral", "normal"]

EVERY: tuple[Direction, ...] = get_args(Direction)


class Nonholonomic(WithWorld, ABC):
    """A constraint with rows on the velocity alone."""

    @property
    def on_velocity(self) -> bool:
        """True: some rows are on the velocity alone."""
        return True

    def bind_to_drive(self, machine: FramedModel, rows: slice) -> BoundConstraint:
        """Return the constraint as it is: its rows are driven by the rate of a path."""
        return self.bind(machine, rows)


class OnPlane(Nonholonomic, ABC):
    """Rolling contact with a plane of the world, or of another body."""

    has_normal: ClassVar[bool] = True
    lengths: ClassVar[tuple[str, ...]] = ("radius", "height")
    unitless: ClassVar[tuple[str, ...]] = ("normal",)

    radius: float  # [m]
    normal: Vector3
    height: float | None  # [m]
    on: FrameLike

    def _check(self) -> None:
        set_frames(self, "frame", "on")
        check_positive("length [m]", radius=self.radius)
        object.__setattr__(self, "radius", float(self.radius))
        object.__setattr__(self, "normal", direction("normal", self.normal))
        if self.height is not None:
            object.__setattr__(self, "height", floats("height", [self.height], 1)[0])

    def _rolled(
        self, machine: FramedModel, rows: slice, holds: tuple[int, ...], axle: int | None
    ) -> BoundRolling | BoundRollingOver:
        (joint, at), anchored = machine.frame(self.on), self.height is not None
        ground = at * plane(self.normal, self.height)
        if joint:
            over = RollingOver(self.radius, axle, holds, anchored)
            ends = (*machine.frame(self.frame), joint, ground)
            return BoundRollingOver(self.name, rows, *ends, over, anchored)
        return BoundRolling(
            self.name, rows, *machine.frame(self.frame), ground, holds, self.radius, axle,
            anchored=anchored,
        )  # fmt: skip

    @property
    def presses(self) -> bool:
        """True if it is held to the plane."""
        return self._support is not None

    @property
    def support(self) -> Support | None:
        """A point on the floor, if it is held to a plane of the world."""
        return self._support if self.on in WORLD else None

    @property
    def _support(self) -> Support | None:
        """A point, if the normal row is there."""
        return Support()

    def sides(self, machine: FramedModel) -> tuple[int, int]:
        """Return the joints that carry the frame and the plane."""
        return machine.frame(self.frame)[0], machine.frame(self.on)[0]

    def acting(self, *, swapped: bool) -> tuple[str, str, str]:
        """Return the frame, what carries the plane, and the frame of the rows' axes."""
        return self.frame, self.on, f"{self.name}/touching"

    def renamed(self, new: Callable[[str], str]) -> Self:
        """Return the contact between frames of other names."""
        on = self.on if self.on in WORLD else new(self.on)
        return replace(super().renamed(new), on=on)  # type: ignore[call-arg, return-value]

    def anchored_at(self, c1: Any, c2: Any) -> Self:
        """Return the contact with the plane through its lowest point."""
        height = float(c2.rotation[:, 2].dot(c1.translation - c2.translation))
        return replace(self, height=height)  # type: ignore[call-arg]
