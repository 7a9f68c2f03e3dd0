"""The two ends of many points at once: axes, places and motions in the world, and forces on them.

A point at s in the axes of its joint, which is placed at (R, t) in the world and has there, in its
own axes, the velocity (v, w) and the acceleration (a, alpha), spatial ones, moves by

    p = R s + t,    p' = R u,    p'' = R (a + alpha x s + w x u),    u = v + w x s
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from condyn_pin._core._pin import pin, placement_view
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.rows.any_bound import OnFrames
from condyn_pin.constraints.rows.frames import Centripetal, Joints

# The rows of an end in `PointEnds.places`, of three numbers each: axes of its frame in the world,
# p, p' and p'', the force on it, and a one with two zeros.
AXES, MOVING, FORCE, ONE, ROWS = slice(3), slice(3, 6), slice(6, 7), 7, 8


class PointEnds:
    """The ends of k points, after forward kinematics into `data`.

    Attributes
    ----------
    places : (2, k, 8, 3) array
        What is known of c1 and of c2, in the world: overwritten by the next evaluation.
    """

    def __init__(self, data: Any, bounds: Sequence[OnFrames]) -> None:
        k = len(bounds)
        ends = [(b.joint1, b.placement1) for b in bounds]
        ends += [(b.joint2, b.placement2) for b in bounds]
        joints = Joints(data, {joint for joint, _ in ends})
        # views into data's own memory, one call copies them all: [R^T, t] of the joint of each end,
        # and then how joints move
        placements = [placement_view(data.oMi[joint]).T.reshape(-1) for joint, _ in ends]
        self._sources = [*placements, *joints.sources]
        self._read = np.zeros(24 * k + 2 * joints.size)
        self._of_joints = self._read[: 24 * k].reshape(2, k, 4, 3)
        self._motion = self._read[24 * k :].reshape(2, joints.size)
        self._make_room(ends, joints)
        self.places = np.zeros((2, k, ROWS, 3))
        self.places[:, :, ONE, 0] = 1.0
        self._found = self.places[:, :, : MOVING.stop]
        self._axes1, self._force = self.places[0, :, AXES], self.places[1, :, FORCE]
        self._axes2T = self.places[1, :, AXES].swapaxes(1, 2)

    def _make_room(self, ends: Sequence[tuple[int, Any]], joints: Joints) -> None:
        """Make the rows of each end in its joint: axes, s, u and p'', and what finds the last two.

        Times [R^T, t] they are those in the world.
        """
        k, aligned = len(ends) // 2, [(j, pin.SE3(np.eye(3), p.translation)) for j, p in ends]
        self._rows = np.zeros((2, k, 6, 4))
        self._rows[:, :, :4] = np.array([p.homogeneous.T for _, p in ends]).reshape(2, k, 4, 4)
        self._rows_u, self._rows_a = self._rows[:, :, 4, :3], self._rows[:, :, 5, :3]
        linear, angular = joints.maps(aligned)
        crossed = Centripetal(linear, angular).factors
        self._map = np.ascontiguousarray(np.vstack([linear, crossed]).T)
        # u of all ends, and what w x u is made of; below, a + alpha x s, and what is of no use
        of_joints = np.zeros((2, 30 * k))
        self._moved, (self._u, self._a) = of_joints, of_joints[:, : 6 * k].reshape(2, 2, k, 3)
        self._w, self._across = of_joints[0, 6 * k :].reshape(2, 2, 2, k, 3)
        self._products = np.zeros((2, 2, k, 3))
        self._forth, self._back = self._products

    def evaluate(self) -> Array:
        """Find axes, p, p' and p''; return `places`."""
        np.concatenate(self._sources, out=self._read)
        np.dot(self._motion, self._map, out=self._moved)
        np.multiply(self._w, self._across, out=self._products)
        w_x_u = np.subtract(self._forth, self._back, out=self._forth)
        self._rows_u[:] = self._u
        np.add(self._a, w_x_u, out=self._rows_a)
        np.matmul(self._rows, self._of_joints, out=self._found)
        return self.places

    def push(self, lam: Array) -> Array:
        """Take lam (k, 1, 3), in the axes of c1, for the force; return it in those of c2."""
        force = np.matmul(lam, self._axes1, out=self._force)
        return np.asarray(force @ self._axes2T)

    def placements(self) -> Array:
        """Return E (2, k, 4, 3): axes of c1 and c2 in the world, one a row, and their origins."""
        np.concatenate(self._sources, out=self._read)
        return np.asarray(self._rows[:, :, :4] @ self._of_joints)
