"""VelocityMap: X of qvel = X v, applied and never formed, at one state or at many.

With R the rotation of a free body in the world, and the joints in the order of either,

    X = diag(R, 1, 1, ...),    X' Xdot v = omega x v in the linear rows of a free joint, else 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.study.mujoco.pairs import Pair


class VelocityMap:
    """X of one robot, by its joints in both engines."""

    def __init__(self, model: Any, pairs: Sequence[Pair]) -> None:
        self._model = model
        dofs = [dof for pair in pairs for dof in range(pair.dof.start, pair.dof.stop)]
        self._dofs = np.array(dofs, dtype=np.int_)
        self._free = tuple(pair for pair in pairs if pair.kind == "free")

    def spread(self, q: Array, x: Array, out: Array) -> Array:
        """Write X x into `out`, which keeps the entries of joints that the robot has not."""
        out[..., self._dofs] = x
        for pair in self._free:
            linear = slice(pair.dof.start, pair.dof.start + 3)
            out[..., linear] = turned(self._orientation(q, pair), out[..., linear])
        return out

    def gather(self, q: Array, y: Array) -> Array:
        """Return X' y."""
        x: Array = np.take(y, self._dofs, axis=-1)
        for pair in self._free:
            linear = slice(pair.v.start, pair.v.start + 3)
            back = self._orientation(q, pair) * np.array([-1.0, -1.0, -1.0, 1.0])
            x[..., linear] = turned(back, x[..., linear])
        return x

    def turning(self, v: Array) -> Array:
        """Return X' Xdot v."""
        found = np.zeros_like(v)
        for pair in self._free:
            k = pair.v.start
            found[..., k : k + 3] = np.cross(v[..., k + 3 : k + 6], v[..., k : k + 3])
        return found

    def _orientation(self, q: Array, pair: Pair) -> Array:
        """Return the quaternion x y z w of a free body in the world."""
        placement = self._model.jointPlacements[pair.here]
        return product(quaternion(placement.rotation), q[..., pair.q][..., 3:])


# Quaternions x y z w, one or many: the last axis is theirs


def reordered(x: Array, by: int) -> Array:
    """Return x with the quaternion at its end rolled: by 1 to w x y z, by -1 back."""
    n = x.shape[-1]
    return x[..., [*range(n - 4), *np.roll(range(n - 4, n), by)]]


def moved(M: Any, pose: Array) -> Array:
    """Return M times a pose (x y z, quaternion x y z w)."""
    by = quaternion(M.rotation)
    # entry by entry, as all here: a product of matrices is rounded otherwise for many than for one
    position = turned(by, pose[..., :3]) + M.translation
    return np.concatenate((position, product(by, pose[..., 3:])), axis=-1)


def quaternion(rotation: Array) -> Array:
    """Return the quaternion of a rotation matrix."""
    return np.array(pin.Quaternion(rotation).coeffs())


def product(one: Array, two: Array) -> Array:
    """Return the product of quaternions x y z w."""
    a, b, s, t = one[..., :3], two[..., :3], one[..., 3:], two[..., 3:]
    vector = s * b + t * a + np.cross(a, b)
    return np.concatenate((vector, s * t - (a * b).sum(axis=-1, keepdims=True)), axis=-1)


def turned(quaternion: Array, x: Array) -> Array:
    """Return vectors turned by quaternions x y z w."""
    u, w = quaternion[..., :3], quaternion[..., 3:]
    twice = 2.0 * np.cross(u, x)
    return x + w * twice + np.cross(u, twice)
