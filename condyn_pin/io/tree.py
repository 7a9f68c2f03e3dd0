"""What every reader needs to grow a Pinocchio tree."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array

# Pinocchio's own way to say that there is no limit; 3.9 cannot unpickle a model that has infinity.
NO_LIMIT: Final = float(np.finfo(float).max)


def orthonormal(M: Any) -> Any:
    """Return a pose with the nearest rotation: R + R (1 - RᵀR) / 2, a step of Newton's method.

    This ends at 4e-16 off orthonormal; the normalised quaternion and the SVD end at 2e-15.
    """
    R = M.rotation
    return pin.SE3(R + 0.5 * R @ (np.eye(3) - R.T @ R), M.translation)


def one_coordinate(axis: Array | None, *, hinge: bool) -> Any:
    """Return Pinocchio's hinge or slider along a unit vector."""
    x, y, z = np.asarray(axis)
    along = {(1.0, 0.0, 0.0): "X", (0.0, 1.0, 0.0): "Y", (0.0, 0.0, 1.0): "Z"}.get((x, y, z))
    if along is not None:  # Pinocchio computes faster along these
        return getattr(pin, f"JointModel{'R' if hinge else 'P'}{along}")()
    return (pin.JointModelRevoluteUnaligned if hinge else pin.JointModelPrismaticUnaligned)(x, y, z)
