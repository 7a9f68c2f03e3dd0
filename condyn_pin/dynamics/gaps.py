"""Gaps of a scene: how far each loop is open, and how fast its sides move apart."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.constraints.rows.cancellation import ROUNDED, cancellation_scale
from condyn_pin.constraints.violation import ConstraintViolation, gap_of, slip_of
from condyn_pin.dynamics.kept import equations_of

if TYPE_CHECKING:
    from condyn_pin.dynamics.scene import Scene


def gaps(scene: Scene, c: Array) -> dict[str, ConstraintViolation]:
    """Return how far each constraint that has a position is open, from c (m,)."""
    model = scene.robot.model
    return {b.name: gap_of(model, b, c[b.rows]) for b in scene.bounds if b.positioned}


def slips(scene: Scene, velocity: Array) -> dict[str, ConstraintViolation]:
    """Return how fast the sides of each constraint move apart, from J v (m,)."""
    return {b.name: slip_of(scene.robot.model, b, velocity[b.rows]) for b in scene.bounds}


def rounding(scene: Scene, q: Array, x: Array) -> dict[str, float]:
    """Return what rounding of J x leaves of each constraint, where its two sides move together.

    A slip is the difference of two velocities: 1e-13 of what the joints bring to either.
    """
    sides = ROUNDED * (cancellation_scale(equations_of(scene), q) @ np.abs(x))
    return {b.name: float(sides[b.rows].max()) for b in scene.bounds}
