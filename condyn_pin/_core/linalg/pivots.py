"""Rank: which singular values count, directions left free, and independent columns by pivots.

Of pivots the largest comes first, and among equals the first column. With R_0 = A, and u_k the
direction of the column chosen in step k,

    p_k = the first j with |r_j| > (1 - TIED) max_i |r_i|,    R_(k+1) = (I - u_k u_k^T) R_k.

Column-pivoted QR of LAPACK takes the largest itself: of two columns that are equal, that which
rounding made the larger, and another processor rounds otherwise.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array

_PREFERENCE = 1e3  # of redundant rows that are named before those that are not


def pivots(A: Array, least: float) -> tuple[list[int], Array]:
    """Return columns of A (m, n) that are independent, and an orthonormal basis (m, r) of them.

    Parameters
    ----------
    A : (m, n) array
    least : float
        Norm of what others leave of a column that counts as nothing.
    """
    chosen: list[int] = []
    left, basis = A.copy(), np.zeros((len(A), 0))
    while len(chosen) < min(A.shape):
        sizes = np.linalg.norm(left, axis=0)
        p = first_of_largest(sizes)
        if not sizes[p] > least:
            break
        u = left[:, p] / sizes[p]
        u -= basis @ (basis.T @ u)  # once more: what cancelled left rounding behind
        u /= np.linalg.norm(u)
        left -= np.outer(u, u @ left)
        left[:, p] = 0.0
        basis = np.column_stack((basis, u))
        chosen.append(p)
    return chosen, basis


def first_of_largest(sizes: Array) -> int:
    """Return where the first entry stands that is as large as the largest, but for rounding."""
    return int(np.argmax(sizes >= (1.0 - tolerances.TIED) * sizes.max()))


def redundant_rows(
    null_space: Array, names: Sequence[str], first: Sequence[str] = ()
) -> tuple[str, ...]:
    """Return rows that can go without lowering the rank.

    A set of k rows can go if and only if its k x k block of the left null space N (m, k) is
    regular: pivots of N^T are such a set, the best conditioned first; those named in `first` before
    others, if they can go. Among equals the later rows go.
    """
    weights = np.where(np.isin(names, first), _PREFERENCE, 1.0)[:, None]
    order, _ = pivots((weights * null_space)[::-1].T, 0.0)
    return tuple(names[i] for i in sorted(len(names) - 1 - np.array(order, dtype=np.int_)))


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
