"""The range-space method: independent rows, two Cholesky factorisations.

    G = J M^-1 J^T,    G lam = y - J M^-1 x,    a = M^-1 (x + J^T lam)

solve M a - J^T lam = x, J a = y.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from condyn_pin import tolerances
from condyn_pin.arrays import Array


@dataclass(frozen=True, eq=False)
class RangeSpace:
    """The factors of one M and J with independent rows.

    Attributes
    ----------
    L : (nv, nv) array
        Upper Cholesky factor of M; what is below its diagonal means nothing.
    Y : (nv, m) array
        M^-1 J^T.
    C : (m, m) array
        Upper Cholesky factor of G.
    J : (m, nv) array
    """

    L: Array
    Y: Array
    C: Array
    J: Array

    def solve(self, x: Array, y: Array) -> tuple[Array, Array]:
        """Return (a, lam) for one or many right-hand sides x (nv, k), y (m, k)."""
        from scipy.linalg.lapack import dpotrs

        a = dpotrs(self.L, x)[0]
        if not len(self.J):
            return a, np.zeros_like(y)
        lam = dpotrs(self.C, y - self.J @ a)[0]
        a += self.Y @ lam
        return a, lam


def range_space(M: Array, J: Array) -> RangeSpace | None:
    """Factorise M and J; None if M is not positive definite or the rows are not independent."""
    # imported here: scipy.linalg takes as long to import as Pinocchio
    from scipy.linalg.lapack import dpotrf, dpotrs

    L, info = dpotrf(M, clean=0)
    if info:
        return None
    if not len(J):
        return RangeSpace(L, np.zeros((len(M), 0)), np.zeros((0, 0)), J)
    Y = dpotrs(L, J.T)[0]
    C, info = dpotrf(J @ Y, clean=0)
    pivots = np.abs(C.diagonal())
    if info or not pivots.min() > tolerances.RANK * pivots.max():
        return None
    return RangeSpace(L, Y, C, J)
