"""Rotation matrices: whether nine numbers are one, and the least that turns z to a direction."""

from __future__ import annotations

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array


def rotation_fault(R: Array) -> str:
    """Return what is wrong with a rotation matrix; nothing if it is one."""
    if not np.isfinite(R).all():
        return "it is not finite"
    error = float(np.abs(R @ R.T - np.eye(3)).max())
    if error > tolerances.ROTATION:
        return f"its axes are not orthonormal, R R^T - 1 has an entry of {error:.3g}"
    return "it is left-handed, det R = -1" if np.linalg.det(R) < 0 else ""


def z_along(direction: Array) -> Array:
    """Return the least rotation (3, 3) that turns z to a direction (3,), of any length."""
    turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), direction)
    return np.array(turn.matrix())
