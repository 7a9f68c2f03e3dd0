"""Gauss's principle with redundant rows: a is unique, lam is the smallest one.

With M = L L^T, the whitened Jacobian Jw = J L^-T = U S V^T, and S cut at a relative tolerance,

    M a - J^T lam = r,  J a = s      is solved by
    y = L^-1 r,   z = S^+ U^T (s - Jw y),   L^T a = y + V z,   lam = U S^+ z.

J is rounded, by eps P where it is the difference of numbers of the size P, and L^-1 carries that
to Jw, largest where bodies are light. A singular value that is no more than this,

    |dJw| <= eps |P w|,    w_j^2 = (M^-1)_jj,

says nothing about a row, whatever its share of the largest.

References
----------
Udwadia, Kalaba. A new perspective on constrained motion. Proc. R. Soc. A 439, 1992.
"""

from __future__ import annotations

from collections.abc import Callable
from math import isfinite
from typing import NamedTuple

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array
from condyn_pin._core.linalg.mass_factor import MassFactor, factorise_mass, lapack
from condyn_pin.errors import InvalidModel

_EPS = float(np.finfo(np.float64).eps)
_NONE, _EMPTY = np.zeros(0), np.zeros((0, 0))


class MinimumNorm(NamedTuple):
    """The factors of one M and J.

    Attributes
    ----------
    mass : MassFactor
        M = L L^T.
    U : (m, m) array
        Left singular vectors of Jw; the columns from `rank` on span the redundancy of the rows.
    S : (min(m, nv),) array
        Singular values of Jw, all of them.
    V : (nv, rank) array
        Right singular vectors that belong to nonzero singular values.
    rank : int
        Number of singular values above the tolerance.
    """

    mass: MassFactor
    U: Array
    S: Array
    V: Array
    rank: int

    @property
    def L(self) -> Array:
        """Lower Cholesky factor of M (nv, nv)."""
        return self.mass.L

    @property
    def weights(self) -> Array:
        """W (nv,): square roots of the diagonal of M^-1."""
        return self.mass.weights

    def solve(self, r: Array, s: Array) -> tuple[Array, Array]:
        """Return (a, lam) for one or many right-hand sides r (nv, k), s (m, k)."""
        dtrtrs = lapack().dtrtrs
        U, S = self.U[:, : self.rank], self.S[: self.rank]
        y = dtrtrs(self.L.T, r, trans=1)[0]  # LAPACK reads columns: L^T is no copy
        if not self.rank:
            return dtrtrs(self.L.T, y)[0], np.zeros_like(s)
        z = ((U.T @ s).T / S).T - self.V.T @ y
        return dtrtrs(self.L.T, y + self.V @ z)[0], U @ (z.T / S).T

    def left_out(self, lam: Array) -> Array:
        """Return the part of lam (m,) along combinations of rows that count as redundant."""
        U = self.U[:, : self.rank]
        return np.asarray(lam - U @ (U.T @ lam))

    def closing(self, c: Array) -> Array:
        """Return the least move (nv,) in the metric of M that takes c (m,) back: J dq = -c."""
        along = c.dot(self.U[:, : self.rank]) / -self.S[: self.rank]
        return np.asarray(lapack().dtrtrs(self.L.T, self.V.dot(along))[0])

    def moved(self, s: Array) -> Array:
        """Return how far a (nv,) moves where J a is off by about s (m,), each row by itself."""
        from scipy.linalg.lapack import dtrtrs

        if not self.rank:
            return np.zeros(len(self.L))
        along = dtrtrs(self.L.T, self.V / self.S[: self.rank])[0]
        return np.asarray(np.linalg.norm((along @ self.U[:, : self.rank].T) * s, axis=1))

    def pushed(self, r: Array) -> Array:
        """Largest changes of a (nv,) by torques that are off by r (nv,), all positive.

        |L^-T (1 - V V^T) L^-1| r: bodies that do not touch do not move each other.
        """
        whitened = self.mass.L_inv
        free = whitened - self.V @ (self.V.T @ whitened)
        return np.asarray(np.abs(whitened.T @ free) @ r)

    def solve_mass(self, r: Array) -> Array:
        """Return M^-1 r for one or many right-hand sides (nv, k)."""
        from scipy.linalg import cho_solve

        return np.asarray(cho_solve((self.L, True), r, check_finite=False))

    def blur(self, P: Array) -> float:
        """Return eps |P w|, what rounding of J does to Jw, for P what J is a difference of."""
        return _EPS * float(np.linalg.norm(P * self.weights))

    def at_most(self, rank: int) -> MinimumNorm:
        """Return the same with the largest singular values only."""
        if rank >= self.rank:
            return self
        return self._replace(V=self.V[:, :rank], rank=rank)

    def above_rounding(self, P: Array) -> MinimumNorm:
        """Return the same without the singular values that rounding of J makes up."""
        least = tolerances.BLURRED * self.blur(P)
        return self.at_most(len(self.S) - int(np.count_nonzero(least >= self.S)))

    def tangent(self, v: Array) -> Array:
        """Return the nearest velocity, in the metric of M, with J v = 0."""
        from scipy.linalg import solve_triangular

        x = self.L.T @ v
        projected: Array = solve_triangular(
            self.L, x - self.V @ (self.V.T @ x), lower=True, trans="T"
        )
        return projected

    def at_rates(self, v: Array, s: Array) -> Array:
        """Return the nearest velocity, in the metric of M, with J v = s."""
        tangent = self.tangent(v)
        return tangent - self.closing(s) if s.any() else tangent


def factorise(
    M: Array,
    J: Array,
    rank_tolerance: float,
    least: float = 0.0,
    *,
    why: Callable[[], str] = str,
) -> MinimumNorm:
    """Factorise M and J.

    Parameters
    ----------
    M, J : (nv, nv), (m, nv) array
    rank_tolerance, least : float
        Singular values of J L^-T count above a share of the largest, and above `least`.
    why : callable, optional
        Says why M is not positive definite; a text that may be empty.

    Raises
    ------
    InvalidModel
        If M is not positive definite, or J not finite.
    """
    return factorise_rows(factorise_mass(M, why=why), J, rank_tolerance, least)


def factorise_rows(
    mass: MassFactor, J: Array, rank_tolerance: float, least: float = 0.0
) -> MinimumNorm:
    """Factorise J in the metric of M, as `factorise` does."""
    n = len(mass.L)
    if not len(J):
        return MinimumNorm(mass, _EMPTY, _NONE, mass.L[:, :0], 0)
    Jw = lapack().dtrtrs(mass.L.T, J.T, trans=1)[0].T
    # all of U, whose last columns are the redundancy, but only so much of V as can be needed
    U, S, Vt, info = lapack().dgesdd(Jw, full_matrices=len(J) > n)
    if info or not isfinite(S[0]):
        raise InvalidModel("the constraint Jacobian is not finite at this q")
    rank = int(np.count_nonzero(max(rank_tolerance * S[0], least) < S))
    return MinimumNorm(mass, U, S, Vt[:rank].T, rank)


def least_change(mass: MassFactor, J: Array, s: Array, rank_tolerance: float) -> Array:
    """Return the least d (nv,), in the metric of M, with J d = s; for rows that agree.

    L^T d = Q R^-T s    with    J L^-T = R^T Q^T, the rows pivoted, as many as are independent

    A third of the time of `factorise` and its `solve`: pivots say the rank, no singular values.
    """
    routines = lapack()
    Jw = routines.dtrtrs(mass.L.T, J.T, trans=1)[0]
    packed, pivots, tau, _, _ = routines.dgeqp3(Jw)
    sizes = np.abs(packed.diagonal())
    if not isfinite(sizes[0]):
        raise InvalidModel("the constraint Jacobian is not finite at this q")
    rank = int(np.count_nonzero(sizes > rank_tolerance * sizes[0]))
    along = routines.dtrtrs(packed[:rank, :rank], s[pivots[:rank] - 1], trans=1)[0]
    Q = routines.dorgqr(packed[:, :rank], tau[:rank])[0]
    return np.asarray(routines.dtrtrs(mass.L.T, Q.dot(along))[0])
