"""Gaps: how far each loop is open, in metres and radians."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from condyn_pin.arrays import Array
from condyn_pin.binding import Bound


class Gap(NamedTuple):
    """How far apart the two sides of a constraint are."""

    length: float  # [m], or [m/s] of a velocity
    angle: float  # [rad], or [rad/s]

    @property
    def size(self) -> float:
        """The larger of the two numbers."""
        return max(self.length, self.angle)

    def text(self, per: str = "") -> str:
        """Return it in mm and degrees, with what follows the units, such as "/s"."""
        parts = []
        if self.length or not self.angle:
            parts.append(f"{1e3 * self.length:.3g} mm{per}")
        if self.angle:
            parts.append(f"{math.degrees(self.angle):.3g} deg{per}")
        return " and ".join(parts)

    def __str__(self) -> str:
        return self.text()


def gaps(bounds: Iterable[Bound], c: Array) -> dict[str, Gap]:
    """Return how far each constraint that has a position is open, from c (m,)."""
    return sizes([bound for bound in bounds if bound.anchored], c)


def sizes(bounds: Iterable[Bound], rows: Array) -> dict[str, Gap]:
    """Return the norms of the linear and of the angular rows of each constraint."""
    return {bound.name: _gap(bound, rows[bound.rows]) for bound in bounds}


def _gap(bound: Bound, rows: Array) -> Gap:
    angular = np.array([name.rsplit(".", 1)[-1].startswith("r") for name in bound.row_names])
    return Gap(float(np.linalg.norm(rows[~angular])), float(np.linalg.norm(rows[angular])))
