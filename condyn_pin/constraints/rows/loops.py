"""Loops that Pinocchio has itself: balls and welds between two bodies.

With E1, E2 the frames c1, c2 in the world, R = R1^T R2, and every velocity and acceleration in the
axes of its own frame,

    3 rows:  c = -R1^T (p2 - p1)    J v = v1 - R v2            J a + gamma = a1 - R a2
    6 rows:  c = -log6(E1^-1 E2)    J v = v1 - X v2 =: s    J a + gamma = a1 - X a2 + s x X v2

with the classical acceleration of the points in the first line, spatial ones in the second, and
X the action of E1^-1 E2. The last term is the turning of c1's axes, in which v2 is written.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.rows.bound import Bound
from condyn_pin.constraints.rows.frames import rows_of
from condyn_pin.constraints.rows.point_ends import PointEnds

if TYPE_CHECKING:
    from condyn_pin.constraints.rows.many import ManyEnds


class Balls:
    """All 3-row loops at once: R1^T times the difference of both ends in the world.

    `ends` are those of one state, or of many, whose forces are not needed.
    """

    def __init__(self, ends: PointEnds | ManyEnds, bounds: Sequence[Bound]) -> None:
        self._ends = ends
        self._rows = rows_of(bounds)
        of_all = np.zeros((3, len(bounds), 3))
        self._of_each, self._of_all = of_all.swapaxes(0, 1), tuple(of_all.reshape(3, -1))

    def evaluate(self, c: Array, velocity: Array, acceleration: Array) -> None:
        """Write the rows of these loops into the three vectors of all rows."""
        rows = self._rows
        R1, apart = self._ends.evaluate()
        np.matmul(apart, R1, out=self._of_each)
        c[rows], velocity[rows], acceleration[rows] = self._of_all

    def violation(self, c: Array) -> None:
        """Write c of these loops: placements in `data` are enough."""
        one, two = self._ends.placements()
        c[self._rows] = ((one[:, 3:] - two[:, 3:]) @ one[:, :3].swapaxes(1, 2)).reshape(-1)

    def stack(self, lam: Array, _: Array, f2: Array) -> None:
        """Write R^T lam, the forces in the axes of c2, for the rows of these loops."""
        assert isinstance(self._ends, PointEnds)
        f2[self._rows] = self._ends.push(lam[self._rows].reshape(-1, 1, 3)).reshape(-1)


class Weld:
    """One 6-row loop."""

    def __init__(self, data: Any, bound: Bound) -> None:
        self._data, self._bound = data, bound  # data keeps alive what the next lines refer to
        self._oMi1, self._oMi2 = data.oMi[bound.joint1], data.oMi[bound.joint2]
        self._v1, self._v2 = data.v[bound.joint1], data.v[bound.joint2]
        self._a1, self._a2 = data.a[bound.joint1], data.a[bound.joint2]
        self._c1Mc2 = pin.SE3.Identity()  # of the last evaluation

    def evaluate(self, c: Array, velocity: Array, acceleration: Array) -> None:
        """Write the rows of this loop into the three vectors of all rows."""
        self.violation(c)
        b, one, two = self._bound, self._bound.placement1, self._bound.placement2
        between = self._c1Mc2
        v2, a2 = between.act(two.actInv(self._v2)), between.act(two.actInv(self._a2))
        s = one.actInv(self._v1) - v2
        velocity[b.rows] = s.vector
        acceleration[b.rows] = (one.actInv(self._a1) - a2 + s.cross(v2)).vector

    def violation(self, c: Array) -> None:
        """Write c of this loop: placements in `data` are enough."""
        b = self._bound
        self._c1Mc2 = (self._oMi1 * b.placement1).actInv(self._oMi2 * b.placement2)
        c[b.rows] = -pin.log6(self._c1Mc2).vector

    def stack(self, lam: Array, _: Array, f2: Array) -> None:
        """Write X^T lam, the wrench in the axes and at the origin of c2."""
        rows = self._bound.rows
        f2[rows] = self._c1Mc2.toActionMatrix().T @ lam[rows]
