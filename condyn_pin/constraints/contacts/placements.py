"""Placements of some joints side by side, from which points and axes of many bodies follow at once.

    (p_1, p_2, ...) = (R_1, o_1, R_2, o_2, ...) L

with the local points, and a 1 below each, in the four rows of L that belong to its joint; an axis
has a 0 there.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from condyn_pin._core._pin import placement_view
from condyn_pin._core.arrays import Array


class Placements:
    """Placements of joints in the world; not to be shared between threads.

    Parameters
    ----------
    joints : iterable of int
        The world, 0, may be among them.
    """

    def __init__(self, joints: Iterable[int]) -> None:
        self._joints = sorted(set(joints))
        self._place = {joint: 4 * i for i, joint in enumerate(self._joints)}
        self._now = np.zeros((3, self.size))
        self._of: Any = None

    @property
    def size(self) -> int:
        """Number of rows of L."""
        return 4 * len(self._joints)

    def rows(self, joint: int) -> slice:
        """Return the four rows of L that belong to a joint."""
        return slice(self._place[joint], self._place[joint] + 4)

    def read(self, data: Any) -> Array:
        """Return (3, size) from data.oMi, in memory of this object."""
        if self._of is not data:  # views into the memory of data: to fetch them costs more
            self._of = data
            self._sources = [placement_view(data.oMi[joint]) for joint in self._joints]
        if self._joints:
            np.concatenate(self._sources, axis=1, out=self._now)
        return self._now
