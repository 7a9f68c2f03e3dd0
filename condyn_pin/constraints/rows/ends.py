"""The two ends of many loops at once: where the frames c1 and c2 are, and how they move.

E1, E2 are their placements in the world, R = R1^T R2, r = R1^T (p2 - p1), and every velocity and
acceleration is in the axes of its own frame; accelerations of origins are the classical ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from condyn_pin._core._pin import placement_view
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.rows.any_bound import OnFrames
from condyn_pin.constraints.rows.frames import Centripetal, Joints, centripetal


class Ends:
    """The ends of k loops, after forward kinematics into `data`."""

    def __init__(self, data: Any, bounds: Sequence[OnFrames]) -> None:
        self.k = len(bounds)
        # first the ends c1 of all loops, then the ends c2
        ends = [(b.joint1, b.placement1) for b in bounds]
        ends += [(b.joint2, b.placement2) for b in bounds]
        # views into data's own memory, one call copies them all: the axes of the joint, one a row,
        # and its origin
        self._sources = [placement_view(data.oMi[j]).T for j, _ in ends]
        self._of_joints = np.zeros((2, self.k, 4, 3))
        self._rows_of_joints = self._of_joints.reshape(-1, 3)
        self._in_joints = np.array([p.homogeneous.T for _, p in ends]).reshape(2, -1, 4, 4)
        self._joints = Joints(data, {j for j, _ in ends})
        linear, angular = self._joints.maps(ends)
        self._linearT = np.ascontiguousarray(linear.T)
        self._angularT = np.ascontiguousarray(angular.T)
        crossed = Centripetal(linear, angular).factors
        self._crossedT = np.ascontiguousarray(np.vstack([linear, crossed]).T)
        self._motion = np.zeros((2, self._joints.size))

    def placements(self) -> Array:
        """Return E (2, k, 4, 3): axes of c1 and c2 in the world, one a row, and their origins."""
        np.concatenate(self._sources, out=self._rows_of_joints)
        return self._in_joints @ self._of_joints

    def apart(self) -> tuple[Array, Array]:
        """Return R (k, 3, 3) and r (k, 3)."""
        one, two = self.placements()
        two[:, 3] -= one[:, 3]
        both = one[:, :3] @ two.swapaxes(1, 2)  # R1^T [R2, p2 - p1]
        return both[:, :, :3], both[:, :, 3]

    def linear(self) -> Array:
        """Return (2, 2, k, 3): velocity or acceleration, end, loop, component."""
        self._motion = self._joints.read()
        found, size = self._motion.dot(self._crossedT), 6 * self.k
        both = found[:, :size]
        both[1] += centripetal(found[0, size:])
        return both.reshape(2, 2, self.k, 3)  # type: ignore[no-any-return]

    def angular(self) -> Array:
        """Return the same of the turning, right after `linear`."""
        return np.asarray(self._motion.dot(self._angularT).reshape(2, 2, self.k, 3))
