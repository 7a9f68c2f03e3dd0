"""Gaps: how far one constraint is open, in metres and radians, and how fast its sides part."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.joints import lengths
from condyn_pin.constraints.rows.bound import FRAME, AnyBound, Bound, Coupled

_TINY = 1e-3  # [mm, deg]


class Gap(NamedTuple):
    """How far apart the two sides of a constraint are, or how far a joint is beyond its limits."""

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


def beyond_text(beyond: Mapping[str, Gap]) -> str:
    """Return for a sentence which joints are beyond their limits, and how far."""
    return ", ".join(f"{joint} is {by} beyond its limits" for joint, by in beyond.items())


def closed(gap: Mapping[str, Gap]) -> bool:
    """Whether every gap is within tolerance (1e-10)."""
    return all(each.size <= tolerances.CLOSED for each in gap.values())


def worst(gap: Mapping[str, Gap]) -> tuple[str, Gap]:
    """Return the name and the gap of what is open furthest."""
    return max(gap.items(), key=lambda item: item[1].size)


def gap_of(model: Any, bound: AnyBound, c: Array) -> Gap:
    """Return how far one constraint is open, from its rows of c.

    Those of a weld are log6 of the placement of one frame in the other: the length of that is no
    distance, but along a screw. What is told is how far the frames are apart, and turned.
    """
    if isinstance(bound, Bound) and bound.selection == FRAME:
        apart = pin.exp6(pin.Motion(np.ascontiguousarray(c))).translation
        return Gap(math.hypot(*apart), math.hypot(*c[3:]))
    return slip_of(model, bound, c)


def slip_of(model: Any, bound: AnyBound, rows: Array) -> Gap:
    """Return how fast the sides of one constraint move apart, from its rows of J v."""
    if isinstance(bound, Coupled):
        angular = np.array([not _slides(model, bound.velocity[0])])
    else:
        angular = np.array([row > 2 for row in bound.selection] or [False])
    return Gap(math.hypot(*rows[~angular]), math.hypot(*rows[angular]))  # no square overflows


def _slides(model: Any, iv: int) -> bool:
    """Whether the coordinate at a velocity index is a length."""
    joint = next(j for j in model.joints if j.idx_v <= iv < j.idx_v + j.nv)
    return lengths(joint)[iv - int(joint.idx_v)]


def _digits(x: float) -> str:
    """Return three digits of a number, as a decimal fraction unless it is tiny."""
    if not _TINY <= x < math.inf:
        return f"{x:.3g}"
    return np.format_float_positional(float(f"{x:.3g}"), trim="-")
