"""Elimination: accelerations that keep the loops, and torques that the motors then give.

With J_l the rows that are held, J_l a = r, Q_1 R P^T = J_l^T by pivoted QR,

    a = a_0 + N z,    a_0 = Q_1 R^-T (P^T r),    N = Q_2,

and with the columns of the motors, S = N^T E = X_1 s Y_1^T, of what the motors have to give

    N^T E t = N^T f    is    t = (Y_1 s^-1 X_1^T) N^T f + Y_2 w,    X_2^T N^T f = 0.

w is there where motors work against each other through the loops. Without loops N = 1, and what
motors have to give, and what none reaches, are entries of f.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array, entries


@dataclass(frozen=True, eq=False)
class Elimination:
    """The maps of one configuration.

    Attributes
    ----------
    N : (nv, k) array
        Orthonormal basis of the accelerations that the held rows leave.
    inner : (motors, w) array
        Torques that do nothing: Y_2.
    """

    N: Array
    inner: Array
    _drive: Any  # Y_1 s^-1 X_1^T; or the entries that it takes
    _undriven: Any  # X_2^T, likewise
    _Q: Array
    _R: Array
    _rest: Array  # R', of rows that are redundant
    _pivots: NDArray[np.int_]

    @property
    def holds(self) -> bool:
        """Whether anything is eliminated: without held rows z is a, and a_0 = 0."""
        return len(self._pivots) > 0

    def along(self, rows: Array) -> Array:
        """Return what is over accelerations (..., nv), a row or many, over z: times N."""
        return rows @ self.N if self.holds else rows

    def within(self, M: Array) -> Array:
        """Return a symmetric matrix over accelerations (nv, nv), over z: N^T M N."""
        return self.N.T @ M @ self.N if self.holds else M

    def torques(self, f: Array) -> Array:
        """Return the torques of the motors for N^T f (k, ...)."""
        return np.asarray(self._drive @ f if self.holds else f[self._drive])

    def unreached(self, f: Array) -> Array:
        """Return what no motor reaches of N^T f (k, ...)."""
        return np.asarray(self._undriven @ f if self.holds else f[self._undriven])

    @classmethod
    def free(cls, nv: int, columns: NDArray[np.int_]) -> Elimination:
        """Return the maps without held rows, with motors in some entries of v."""
        nothing, none = np.zeros((0, 0)), np.zeros(0, np.int_)
        others = np.setdiff1d(np.arange(nv), columns)
        inner = np.zeros((len(columns), 0))
        drive, undriven = entries(columns), entries(others)
        return cls(np.eye(nv), inner, drive, undriven, nothing, nothing, nothing, none)

    @classmethod
    def of(cls, J: Array, columns: NDArray[np.int_]) -> Elimination:
        """Return the maps of held rows J (m, nv) and motors in some entries of v."""
        if not len(J):
            return cls.free(J.shape[1], columns)
        Q, R, pivots, rank = _pivoted_qr(J.T, J.shape[1])
        if not rank:
            return cls.free(J.shape[1], columns)
        N = Q[:, rank:]
        X, s, Yt = np.linalg.svd(N[columns].T)
        reached = int(np.count_nonzero(s > tolerances.RANK))
        drive = (Yt[:reached].T / s[:reached]) @ X[:, :reached].T
        inner, undriven = Yt[reached:].T, X[:, reached:].T
        R, rest = R[:rank, :rank], R[:rank, rank:]
        return cls(N, inner, drive, undriven, Q[:, :rank], R, rest, pivots)

    def particular(self, r: Array) -> Array:
        """Return a_0, the smallest acceleration with J a = r (m,)."""
        if not self.holds:
            return np.zeros(len(self.N))
        # imported here: scipy.linalg takes as long to import as Pinocchio
        from scipy.linalg.lapack import dtrtrs

        independent = self._pivots[: len(self._R)]
        return np.asarray(self._Q @ dtrtrs(self._R, r[independent], trans=1)[0])

    def forces(self, f: Array) -> Array:
        """Return lam (m,) of the held rows with J^T lam = f, the smallest if many.

        Where rows are redundant, J^T P = Q_1 (R, R'), it is, with W = R^-1 R',

            P^T lam = (y, W^T y),    (1 + W W^T) y = R^-1 Q_1^T f.
        """
        from scipy.linalg.lapack import dtrtrs

        rank = len(self._R)
        y, lam = dtrtrs(self._R, self._Q.T @ f)[0], np.empty(len(self._pivots))
        if self._rest.size:
            W = dtrtrs(self._R, self._rest)[0]
            y = np.linalg.solve(np.eye(rank) + W @ W.T, y)
            lam[self._pivots[rank:]] = W.T @ y
        lam[self._pivots[:rank]] = y
        return lam


def reached(J: Array, r: Array) -> tuple[Array, int]:
    """Return what is nearest to r (m,) of all J z, and the rank of J (m, k)."""
    if not J.size:
        return r, 0
    Q, _, _, rank = _pivoted_qr(J, min(J.shape))
    return (Q[:, :rank] @ (Q[:, :rank].T @ r) if rank < len(J) else r), rank


def _pivoted_qr(A: Array, columns: int) -> tuple[Array, Array, NDArray[np.int_], int]:
    """Return Q (m, columns), R, pivots and rank of A (m, n) with Q R = A[:, pivots].

    R is in the upper triangle; what is below is no part of it. LAPACK is asked itself: for matrices
    of this size what `scipy.linalg.qr` does around it takes as long.
    """
    # imported here: scipy.linalg takes as long to import as Pinocchio
    from scipy.linalg.lapack import dgeqp3, dorgqr

    R, order, reflectors, _, _ = dgeqp3(A)
    start = np.zeros((len(A), columns), order="F")
    kept = min(A.shape[1], columns)
    start[:, :kept] = R[:, :kept]
    Q = dorgqr(start, reflectors, overwrite_a=1)[0]
    sizes = np.abs(R.diagonal())
    return Q, R, order - 1, int(np.count_nonzero(sizes > tolerances.RANK * sizes[0]))
