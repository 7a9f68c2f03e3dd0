"""Motions that constraints hold, and those that they leave free, orthonormal in the metric of M.

With M = L L^T, LAPACK's complete orthogonal factorisation of the whitened Jacobian J L^-T is

    L^-1 J^T P = Q [ T  0 ] Z,        T upper triangular,    K^T = [ T^-T  0 ] Z P^T
                   [ 0  0 ]

Rows of B = Q^T L^-1 are motions with B M B^T = 1. The first, B_h, are held, one for each
independent row, and J^T K = M B_h^T: columns of K are the smallest forces that push against them.
The others are free, J B_f^T = 0. With them

    M a - J^T lam = x,  J a = y      is solved by      a  = B_h^T K^T y + B_f^T B_f x,
                                                      lam = K (K^T y - B_h x),

and nothing has to cancel: what constraints hold is told apart from the rest before it is divided by
M. Where rows are redundant, K gives the smallest lam, and the last columns N of P Z^T span what
they contradict each other by, J^T N = 0.

References
----------
Golub, Van Loan. Matrix Computations, 5.5: complete orthogonal decompositions.
"""

from __future__ import annotations

from functools import cache
from typing import Final, NamedTuple

import numpy as np

from condyn_pin._core.arrays import Array, read_only
from condyn_pin._core.linalg.mass_factor import lapack

# Columns that LAPACK turns at once.
_BLOCK: Final = 32


class HeldAndFree(NamedTuple):
    """The motions of one M and J.

    Attributes
    ----------
    B : (nv, nv) array
        Motions, one a row: first those that are held.
    K : (m, rank) array
        Forces that push against one of these each.
    N : (m, m - rank) array
        Orthonormal forces that redundant rows carry among themselves.
    """

    B: Array
    K: Array
    N: Array

    def solve(self, x: Array, y: Array) -> tuple[Array, Array]:
        """Return (a, lam) for one or many right-hand sides x (nv, k), y (m, k)."""
        return self.motion(x, y), self.force(x, y)

    def motion(self, x: Array, y: Array) -> Array:
        """Return a (nv,) or (nv, k)."""
        moved = self.B.dot(x)
        moved[: self.K.shape[1]] = self.K.T.dot(y)
        a: Array = self.B.T.dot(moved)
        return a

    def force(self, x: Array, y: Array) -> Array:
        """Return lam (m,) or (m, k)."""
        asked = self.K.T.dot(y)
        asked -= self.B[: self.K.shape[1]].dot(x)
        lam: Array = self.K.dot(asked)
        return lam

    def held(self, y: Array) -> Array:
        """Return the motion (nv,) with J a = y (m,) that has no part along what is free."""
        a: Array = self.K.T.dot(y).dot(self.B[: self.K.shape[1]])
        return a

    @property
    def mobility(self) -> Array:
        """B_f^T B_f (nv, nv): how torques accelerate what is free."""
        free = self.B[self.K.shape[1] :]
        return np.asarray(free.T.dot(free))

    @property
    def support(self) -> Array:
        """-K B_h (m, nv): what constraints push back when torques push."""
        return np.asarray(-self.K.dot(self.B[: self.K.shape[1]]))


def held_and_free(L_inv: Array, J: Array, share: float, most: int | None = None) -> HeldAndFree:
    """Return the motions of M = L L^T and J (m, nv).

    Rows count as independent whose part of J L^-T is more than a share of the largest, and no more
    of them than `most`.
    """
    m, n = J.shape
    if not m:
        return _all_free(L_inv, m)
    of = lapack()
    # arguments by place: by name they take half as long again
    T, order, reflectors, _, _ = of.dgeqp3(L_inv.dot(J.T), 3 * (m + 1), 1)
    rank = len(reflectors) if most is None else min(most, len(reflectors))  # pivots fall
    sizes = T.diagonal().tolist()
    while rank and abs(sizes[rank - 1]) <= share * abs(sizes[0]):
        rank -= 1
    if not rank:
        return _all_free(L_inv, m)
    B = of.dormqr("L", "T", T[:, : len(reflectors)], reflectors, L_inv, _BLOCK * n)[0]
    ZP_T = _numbered(m).take(order, axis=1).T
    if rank < m:
        T, turns, _ = of.dtzrzf(T[:rank])
        ZP_T = of.dormrz(T, turns, ZP_T, "L", "N", m, 1)[0]
    K_T = of.dtrtrs(T[:rank, :rank], ZP_T[:rank], 0, 1)[0]
    return HeldAndFree(B, K_T.T, ZP_T[rank:].T)


@cache
def _numbered(m: int) -> Array:
    """Return the columns of the unit matrix (m, m + 1) by their numbers, from 1 as in LAPACK."""
    return read_only(np.eye(m, m + 1, 1))


def _all_free(L_inv: Array, m: int) -> HeldAndFree:
    return HeldAndFree(L_inv, np.zeros((m, 0)), np.eye(m))
