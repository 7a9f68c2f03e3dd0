"""Gaps: how far one constraint is open, in metres and radians, and how fast its sides part."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.rows.any_bound import AnyBound

_TINY = 1e-3  # [mm, deg]


class ConstraintViolation(NamedTuple):
    """By how much a constraint is violated, or by how much a joint is beyond its limits.

    Attributes
    ----------
    length : float
        Of its rows that are lengths [m], or [m/s] of a velocity.
    angle : float
        Of its rows that are angles [rad], or [rad/s].
    """

    length: float  # [m], or [m/s] of a velocity
    angle: float  # [rad], or [rad/s]

    @property
    def size(self) -> float:
        """The larger of the two numbers."""
        return max(self.length, self.angle)

    def text(self, per: str = "") -> str:
        """Return it in mm and degrees, `per` behind the units, such as "/s".

        A part that is rounding beside the other is left out.
        """
        least = tolerances.CLOSED if self.size > tolerances.CLOSED else 0.0
        parts = []
        if self.length > least or not self.angle > least:
            parts.append(f"{_digits(1e3 * self.length)} mm{per}")
        if self.angle > least:
            parts.append(f"{_digits(math.degrees(self.angle))} deg{per}")
        return " and ".join(parts)

    def __str__(self) -> str:
        return self.text()


def beyond_text(beyond: Mapping[str, ConstraintViolation]) -> str:
    """Return for a sentence which joints are beyond their limits, and how far."""
    return ", ".join(f"{joint} is {by} beyond its limits" for joint, by in beyond.items())


def closed(gap: Mapping[str, ConstraintViolation]) -> bool:
    """Whether every gap is within tolerance (1e-10)."""
    return all(each.size <= tolerances.CLOSED for each in gap.values())


def worst(gap: Mapping[str, ConstraintViolation]) -> tuple[str, ConstraintViolation]:
    """Return the name and the gap of what is open furthest."""
    return max(gap.items(), key=lambda item: item[1].size)


def gap_of(model: Any, bound: AnyBound, c: Array) -> ConstraintViolation:
    """Return how far one constraint is open, from its rows of c."""
    return ConstraintViolation(*bound.opening(model, c))


def velocity_of(model: Any, bound: AnyBound, rows: Array) -> ConstraintViolation:
    """Return how fast the sides of one constraint move apart, from its rows of J v."""
    return ConstraintViolation(*bound.rates(model, rows))


def _digits(x: float) -> str:
    """Return three digits of a number, as a decimal fraction unless it is tiny."""
    if not _TINY <= x < math.inf:
        return f"{x:.3g}"
    return np.format_float_positional(float(f"{x:.3g}"), trim="-")
