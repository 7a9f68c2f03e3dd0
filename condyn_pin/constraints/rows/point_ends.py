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
        What is known of c1 and of c2, in the world: overwritten by the next evaluation. All others
        are views of it.
    axes1 : (k, 3, 3) array
        Axes of c1, one a row.
    of_c1, of_c2 : (k, 2, 3) array
        p'' and the force, which is on c2 alone.
    known : (2 k, 15) array
        All but axes, of c1 and behind all of them c2.
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
        self._make_rows(ends, joints)
        self._name_places(k)

    def _make_rows(self, ends: Sequence[tuple[int, Any]], joints: Joints) -> None:
        """Make the rows of each end in its joint: axes, s, u and p'', and what finds the last two.

        Times [R^T, t] they are those in the world.
        """
        k, aligned = len(ends) // 2, [(j, pin.SE3(np.eye(3), p.translation)) for j, p in ends]
        self._rows = np.zeros((2, k, 6, 4))
        self._rows[:, :, :4] = np.array([p.homogeneous.T for _, p in ends]).reshape(2, k, 4, 4)
        self._moving_rows = self._rows[:, :, 4:, :3].transpose(2, 0, 1, 3)
        linear, angular = joints.maps(aligned)
        crossed = Centripetal(linear, angular).factors
        self._map = np.ascontiguousarray(np.vstack([linear, crossed]).T)
        # u of all ends, and what w x u is made of; below, a + alpha x s, and what is of no use
        self._found = np.zeros((2, 30 * k))
        self._moving = self._found[:, : 6 * k].reshape(2, 2, k, 3)
        self._a = self._moving[1]
        self._w, self._across = self._found[0, 6 * k :].reshape(2, 2, 2, k, 3)
        self._products = np.zeros((2, 2, k, 3))
        self._forth, self._back = self._products

    def _name_places(self, k: int) -> None:
        """Make `places`, and views of it."""
        self.places = np.zeros((2, k, ROWS, 3))
        self.places[:, :, ONE, 0] = 1.0
        self.known = self.places.reshape(2 * k, 3 * ROWS)[:, 3 * AXES.stop :]
        self._in_world, (one, two) = self.places[:, :, : MOVING.stop], self.places
        self.axes1, self._force = one[:, AXES], two[:, FORCE]
        self._axes1T, self._axes2T = one[:, AXES].swapaxes(1, 2), two[:, AXES].swapaxes(1, 2)
        self.of_c1, self.of_c2 = one[:, MOVING.stop - 1 : ONE], two[:, MOVING.stop - 1 : ONE]
        self._between = np.zeros((k, ROWS, 3))
        self._evaluated = self._axes1T, self._between[:, MOVING]
        self._one, self._two = one, two

    def evaluate(self) -> tuple[Array, Array]:
        """Return R1 (k, 3, 3), and p, p' and p'' (k, 3, 3) of c1 less those of c2, a row each."""
        np.concatenate(self._sources, out=self._read)
        np.dot(self._motion, self._map, out=self._found)
        np.multiply(self._w, self._across, out=self._products)
        self._a += np.subtract(self._forth, self._back, out=self._forth)
        self._moving_rows[:] = self._moving
        np.matmul(self._rows, self._of_joints, out=self._in_world)
        np.subtract(self._one, self._two, out=self._between)  # the whole is quicker than a part
        return self._evaluated

    def push(self, lam: Array) -> Array:
        """Take lam (k, 1, 3), in the axes of c1, for the force; return it in those of c2."""
        force = np.matmul(lam, self.axes1, out=self._force)
        return force @ self._axes2T

    def placements(self) -> Array:
        """Return E (2, k, 4, 3): axes of c1 and c2 in the world, one a row, and their origins."""
        np.concatenate(self._sources, out=self._read)
        return self._rows[:, :, :4] @ self._of_joints
