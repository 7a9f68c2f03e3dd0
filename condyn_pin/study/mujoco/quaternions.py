"""Quaternions x y z w, one or many: the last axis is theirs."""

from __future__ import annotations

from typing import Any

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array


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
