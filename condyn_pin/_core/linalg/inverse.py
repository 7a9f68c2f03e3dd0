"""Inverses that are NaN where there is none, for steps that look at their answer anyway."""

from __future__ import annotations

from math import nan

import numpy as np

from condyn_pin._core.arrays import Array


def inverse(A: Array) -> Array:
    """Return A^-1 (n, n); NaN if A is singular."""
    try:
        return np.asarray(np.linalg.inv(A), dtype=np.float64)
    except np.linalg.LinAlgError:
        return np.full_like(A, nan)
