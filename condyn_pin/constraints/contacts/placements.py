"""Placements of joints in the world side by side, from which points of many bodies follow at once.

    (p_1, p_2, ...) = (R_1, o_1, R_2, o_2, ...) L

with the local points, and a 1 below each, in the four rows of L that belong to their joint; an axis
has a 0 there. Pinocchio keeps the placements of all joints so: nothing is copied, and joints that
lie between the first and the last have rows too, of zeros.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from condyn_pin._core._pin import placements_view
from condyn_pin._core.arrays import Array


class Placements:
    """Placements of joints in the world; not to be shared between threads.

    Parameters
    ----------
    joints : iterable of int
        The world, 0, may be among them.
    """

    def __init__(self, joints: Iterable[int]) -> None:
        all_of_them = set(joints)
        self._first = min(all_of_them, default=0)
        self._count = max(all_of_them) - self._first + 1 if all_of_them else 0
        self._now, self._of = np.zeros((3, 0)), None

    @property
    def size(self) -> int:
        """Number of rows of L."""
        return 4 * self._count

    def rows(self, joint: int) -> slice:
        """Return the four rows of L that belong to a joint."""
        place = 4 * (joint - self._first)
        return slice(place, place + 4)

    def read(self, data: Any) -> Array:
        """Return (3, size) from data.oMi: a view that follows it, not to be written to."""
        if self._of is not data and self._count:  # to fetch it costs more than what is done with it
            self._of, self._now = data, placements_view(data.oMi, self._first, self._count)
        return self._now
