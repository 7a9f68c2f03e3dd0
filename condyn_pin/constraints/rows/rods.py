"""Rods: loops whose one row is a distance.

With p1, p2 the origins of c1 and c2 in the world, r = p2 - p1, n = r / |r| and s = p1' - p2',

    c = L - |r|,    J v = n . s,    J a + gamma = n . s' - (|s|^2 - (n . s)^2) / |r|.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.constraints.rows.bound import Bound
from condyn_pin.constraints.rows.ends import Ends
from condyn_pin.constraints.rows.frames import FrameJacobian, rows_of

_SMALLEST = 1e-300  # keeps 0/0 out of a direction that does not exist


class Rods:
    """All rods of one scene."""

    def __init__(self, ends: Ends, bounds: Sequence[Bound]) -> None:
        self._bounds, self._ends = tuple(bounds), ends
        self._rows = rows_of(bounds)
        self._lengths = np.array([b.length for b in bounds])
        k = len(bounds)
        self._n = np.zeros((2, k, 3))  # in the axes of c1, and of c2
        # rows (v, 0), (a, 0) and (0, 1) of each end: times its placement v, a and p in the world
        self._motion = np.zeros((2, k, 3, 4))
        self._motion[:, :, 2, 3] = 1.0
        self._linear = self._motion[:, :, :2, :3].transpose(2, 0, 1, 3)  # a view

    def evaluate(self, c: Array, velocity: Array, acceleration: Array) -> None:
        """Write the rows of these loops into the three vectors of all rows."""
        E = self._ends.placements()
        self._linear[:] = self._ends.linear()
        one, two = self._motion @ E
        both = one - two  # s, s' and -r of each rod
        s_s, s_r, a_r, r_r = (both @ both.swapaxes(1, 2))[:, (0, 0, 1, 2), (0, 2, 2, 2)].T
        distance = np.sqrt(r_r)
        per_distance = -1.0 / np.maximum(distance, _SMALLEST)
        along = s_r * per_distance
        c[self._rows] = self._lengths - distance
        velocity[self._rows] = along
        acceleration[self._rows] = (a_r + s_s - along * along) * per_distance
        self._n = ((E[:, :, :3] @ both[:, 2, :, None])[..., 0]) * per_distance[:, None]

    def stack(self, lam: Array, f1: Array, f2: Array) -> None:
        """Write the forces (3 k) at the origins of c1 and c2, each in its axes."""
        one, two = lam[self._rows][:, None] * self._n
        f1[:], f2[:] = one.reshape(-1), two.reshape(-1)

    def jacobian(self, J: Array, of_frame: FrameJacobian) -> None:
        """Write the rows of these loops into J (m, nv), at the last evaluation."""
        for b, n1, n2 in zip(self._bounds, *self._n, strict=True):
            J1, J2 = of_frame(b.joint1, b.placement1), of_frame(b.joint2, b.placement2)
            J[b.rows] = n1 @ J1[:3] - n2 @ J2[:3]
