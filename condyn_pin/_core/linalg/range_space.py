"""The range-space method: independent rows, two Cholesky factorisations.

With M = U^T U and W = U^-T J^T, the Jacobian in the metric of M,

    G = J M^-1 J^T = W^T W,    z = U^-T x,    G lam = y - W^T z,    U a = z + W lam

solve M a - J^T lam = x, J a = y.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array


@dataclass(frozen=True, eq=False)
class RangeSpace:
    """The factors of one M and J with independent rows, or with rows that are damped.

    Attributes
    ----------
    U : (nv, nv) array
        Upper Cholesky factor of M; what is below its diagonal means nothing.
    W : (nv, m) array
        U^-T J^T.
    C : (m, m) array
        Upper Cholesky factor of G + diag(R).
    """

    U: Array
    W: Array
    C: Array

    def solve(self, x: Array, y: Array) -> tuple[Array, Array]:
        """Return (a, lam) for one or many right-hand sides x (nv, k), y (m, k)."""
        from scipy.linalg.lapack import dpotrs, dtrtrs

        z = dtrtrs(self.U, x, trans=1)[0]
        lam = np.zeros_like(y)
        if len(y):
            lam = dpotrs(self.C, y - self.W.T @ z)[0]
            z += self.W @ lam
        return dtrtrs(self.U, z, overwrite_b=1)[0], lam


def range_space(M: Array, J: Array, mu: float = 0.0) -> RangeSpace | None:
    """Factorise M and J; None if M is not positive definite or the rows are not independent.

    With mu > 0 [1/kg] the rows may be anything: G + mu I takes the place of G.
    """
    if mu:
        return damped_range_space(M, J, mu)
    # imported here: scipy.linalg takes as long to import as Pinocchio
    from scipy.linalg.lapack import dpotrf

    whitened = whiten(M, J)
    if whitened is None:
        return None
    U, W, G = whitened
    of_G = np.sqrt(G.diagonal())
    C, info = dpotrf(G, clean=0, overwrite_a=1)
    # a pivot is the part of its row that the rows before it do not have
    if info or not (C.diagonal() > tolerances.RANK * of_G).all():
        return None
    return RangeSpace(U, W, C)


def damped_range_space(M: Array, J: Array, R: float | Array) -> RangeSpace | None:
    """Factorise M and J with G + diag(R), R (m,) or the same for all rows [1/kg].

    None if M or G + diag(R) is not positive definite.
    """
    from scipy.linalg.lapack import dpotrf

    whitened = whiten(M, J)
    if whitened is None:
        return None
    U, W, G = whitened
    G[np.diag_indices_from(G)] += R
    C, info = dpotrf(G, clean=0, overwrite_a=1)
    return None if info else RangeSpace(U, W, C)


def whiten(M: Array, J: Array) -> tuple[Array, Array, Array] | None:
    """Return U, W and the upper triangle of G; None if M is not positive definite."""
    from scipy.linalg.blas import dsyrk
    from scipy.linalg.lapack import dpotrf, dtrtrs

    U, info = dpotrf(M, clean=0)
    if info:
        return None
    if not len(J):
        return U, np.zeros((len(M), 0)), np.zeros((0, 0))
    W = dtrtrs(U, J.T, trans=1)[0]
    return U, W, dsyrk(1.0, W, trans=1)
