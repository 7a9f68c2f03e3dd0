"""Loops between bodies, and contacts with an anchor: what has a position error.

With E1, E2 the frames c1, c2 in the world, R = R1^T R2, and every velocity and acceleration in the
axes of its own frame,

    3 rows:  c = -R1^T (p2 - p1)    J v = v1 - R v2            J a + gamma = a1 - R a2
    6 rows:  c = -log6(E1^-1 E2)    J v = v1 - X v2 =: slip    J a + gamma = a1 - X a2 + slip x X v2

with the classical acceleration of the points in the first line, spatial ones in the second, and
X the action of E1^-1 E2. The last term is the turning of c1's axes, in which v2 is written.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from condyn_pin._pin import LOCAL, pin
from condyn_pin.arrays import Array
from condyn_pin.binding import Bound
from condyn_pin.frames import Centripetal, Joints, rows_of


class Balls:
    """All 3-row loops at once.

    Parameters
    ----------
    data : pin.Data
    bounds : sequence of Bound

    """

    def __init__(self, data: Any, bounds: Sequence[Bound]) -> None:
        k = len(bounds)
        self._rows = rows_of(bounds)
        self._joints = Joints(data, {j for b in bounds for j in (b.joint1, b.joint2)})
        numbers = self._joints.numbers
        self._placements = np.zeros((len(numbers), 4, 4))
        self._sources = [(data.oMi[j], self._placements[i]) for i, j in enumerate(numbers)]
        # first the ends c1 of all loops, then the ends c2
        ends = [(b.joint1, b.placement1) for b in bounds] + [
            (b.joint2, b.placement2) for b in bounds
        ]
        self._end_joints = np.array([numbers.index(joint) for joint, _ in ends], dtype=np.int_)
        self._in_joints = np.array([p.homogeneous for _, p in ends]).reshape(2 * k, 4, 4)
        linear, angular = self._joints.maps(ends)
        self._linearT = np.ascontiguousarray(linear.T)
        self._centripetal = Centripetal(linear, angular)
        self._rotation = np.zeros((k, 3, 3))

    def evaluate(self, c: Array, velocity: Array, acceleration: Array) -> None:
        """Write the rows of these loops into the three vectors of all rows."""
        k, rows = len(self._rotation), self._rows
        for placement, place in self._sources:
            place[:] = placement.homogeneous
        E = self._placements[self._end_joints] @ self._in_joints
        R1T = E[:k, :3, :3].transpose(0, 2, 1)
        self._rotation = R1T @ E[k:, :3, :3]
        c[rows] = (R1T @ (E[:k, :3, 3:] - E[k:, :3, 3:])).ravel()
        motion = self._joints.read()
        both = motion.dot(self._linearT)
        both[1] += self._centripetal.of(motion[0])
        ends = both.reshape(2, 2, k, 3, 1)  # velocity or acceleration; end; loop
        relative = ends[:, 0] - self._rotation @ ends[:, 1]
        velocity[rows], acceleration[rows] = relative.reshape(2, -1)

    def turn(self, lam: Array, out: Array) -> None:
        """Write R^T lam, the forces in the axes of c2, for the rows of these loops."""
        forces = lam[self._rows].reshape(-1, 3, 1)
        out[self._rows] = (self._rotation.transpose(0, 2, 1) @ forces).ravel()

    def action(self, k: int) -> Array:
        """Return R of loop k, at the last evaluation."""
        R: Array = self._rotation[k]
        return R


class Weld:
    """One 6-row loop."""

    def __init__(self, model: Any, data: Any, bound: Bound) -> None:
        self._model, self._data, self._bound = model, data, bound
        self._oMi1, self._oMi2 = data.oMi[bound.joint1], data.oMi[bound.joint2]
        self._c1Mc2 = pin.SE3.Identity()  # of the last evaluation

    def evaluate(self, c: Array, velocity: Array, acceleration: Array) -> None:
        """Write the rows of this loop into the three vectors of all rows."""
        model, data, b = self._model, self._data, self._bound
        self._c1Mc2 = (self._oMi1 * b.placement1).actInv(self._oMi2 * b.placement2)
        c[b.rows] = -pin.log6(self._c1Mc2).vector
        one = (model, data, b.joint1, b.placement1, LOCAL)
        two = (model, data, b.joint2, b.placement2, LOCAL)
        v2 = self._c1Mc2.act(pin.getFrameVelocity(*two))
        a2 = self._c1Mc2.act(pin.getFrameAcceleration(*two))
        slip = pin.getFrameVelocity(*one) - v2
        velocity[b.rows] = slip.vector
        acceleration[b.rows] = (pin.getFrameAcceleration(*one) - a2 + slip.cross(v2)).vector

    def turn(self, lam: Array, out: Array) -> None:
        """Write X^T lam, the wrench in the axes and at the origin of c2."""
        rows = self._bound.rows
        out[rows] = self.action().T @ lam[rows]

    def action(self) -> Array:
        """Return X, at the last evaluation."""
        X: Array = self._c1Mc2.toActionMatrix()
        return X
