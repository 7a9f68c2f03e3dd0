"""Numerical rank: which singular values count, and the directions that a matrix leaves free."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array


def counted(S: NDArray[np.floating[Any]], share: float = tolerances.RANK) -> NDArray[np.bool_]:
    """Return which singular values are more than a share of the largest, by default rounding."""
    return np.asarray(share * S.max(initial=0.0) < S)


def rank_of(S: NDArray[np.floating[Any]], share: float = tolerances.RANK) -> int:
    """Return how many singular values count."""
    return int(np.count_nonzero(counted(S, share)))


def null_space(A: Array) -> Array:
    """Return an orthonormal basis of what A (m, n) takes to zero, (n - rank, n)."""
    _, S, Vt = np.linalg.svd(A)
    return np.asarray(Vt[rank_of(S) :])
