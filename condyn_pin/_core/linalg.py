"""Linear algebra of the two equations: saddle-point solves, numerical rank, exact residuals.

Gauss's principle with redundant rows: a is unique, lam is the smallest one.

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

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from math import isfinite, nan
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array, read_only
from condyn_pin._core.threads import one_blas_thread
from condyn_pin.errors import InvalidModel

_EPS = float(np.finfo(np.float64).eps)
_NONE, _EMPTY = np.zeros(0), np.zeros((0, 0))


class MinimumNorm(NamedTuple):
    """Factors of one M and J for minimum-norm constraint forces."""

    mass: MassFactor  # M = L L^T
    # (m, m) left singular vectors of Jw; the columns from `rank` on span the redundancy of the rows
    U: Array
    S: Array  # (min(m, nv),) singular values of Jw, all of them
    V: Array  # (nv, rank) right singular vectors that belong to nonzero singular values
    rank: int  # number of singular values above the tolerance

    @property
    def L(self) -> Array:
        """Lower Cholesky factor of M (nv, nv)."""
        return self.mass.L

    @property
    def weights(self) -> Array:
        """Weights W (nv,): square roots of the diagonal of M^-1."""
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
        """Component of lam (m,) along redundant combinations of rows."""
        U = self.U[:, : self.rank]
        return np.asarray(lam - U @ (U.T @ lam))

    def closing(self, c: Array) -> Array:
        """Smallest move dq (nv,), in the metric of M, that closes c (m,): J dq = -c."""
        along = c.dot(self.U[:, : self.rank]) / -self.S[: self.rank]
        return np.asarray(lapack().dtrtrs(self.L.T, self.V.dot(along))[0])

    def moved(self, s: Array) -> Array:
        """Change of a (nv,) by errors s (m,) of J a, independent from row to row."""
        from scipy.linalg.lapack import dtrtrs

        if not self.rank:
            return np.zeros(len(self.L))
        along = dtrtrs(self.L.T, self.V / self.S[: self.rank])[0]
        return np.asarray(np.linalg.norm((along @ self.U[:, : self.rank].T) * s, axis=1))

    def pushed(self, r: Array) -> Array:
        """Largest change of a (nv,) by errors r (nv,) of the torques, all positive."""
        # |L^-T (1 - V V^T) L^-1| r: bodies that do not touch do not move each other.
        whitened = self.mass.L_inv
        free = whitened - self.V @ (self.V.T @ whitened)
        return np.asarray(np.abs(whitened.T @ free) @ r)

    def solve_mass(self, r: Array) -> Array:
        """Return M^-1 r for one or many right-hand sides (nv, k)."""
        from scipy.linalg import cho_solve

        return np.asarray(cho_solve((self.L, True), r, check_finite=False))

    def blur(self, P: Array) -> float:
        """Rounding error of Jw, eps |P w|, where J is a difference of terms of size P."""
        return _EPS * float(np.linalg.norm(P * self.weights))

    def at_most(self, rank: int) -> MinimumNorm:
        """Factors truncated to the largest `rank` singular values."""
        if rank >= self.rank:
            return self
        return self._replace(V=self.V[:, :rank], rank=rank)

    def above_rounding(self, P: Array) -> MinimumNorm:
        """Factors without singular values within the rounding error of J."""
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
    """Factorise M (nv, nv) and J (m, nv); InvalidModel if M is not definite, or J not finite."""
    # Singular values of J L^-T count above a share `rank_tolerance` of the largest, and above
    # `least`. `why` says why M is not positive definite; a text that may be empty.
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
    """Smallest d (nv,), in the metric of M, with J d = s; for consistent rows."""
    # L^T d = Q R^-T s    with    J L^-T = R^T Q^T, the rows pivoted, as many as are independent
    # A third of the time of `factorise` and its `solve`: pivots say the rank, no singular values.
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


# Rank: which singular values count, directions left free, and independent columns by pivots.
#
# Of pivots the largest comes first, and among equals the first column. With R_0 = A, and u_k the
# direction of the column chosen in step k,
#
#     p_k = the first j with |r_j| > (1 - TIED) max_i |r_i|,    R_(k+1) = (I - u_k u_k^T) R_k.
#
# Column-pivoted QR of LAPACK takes the largest itself: of two columns that are equal, that which
# rounding made the larger, and another processor rounds otherwise.


_PREFERENCE = 1e3  # of redundant rows that are named before those that are not


def pivots(A: Array, least: float) -> tuple[list[int], Array]:
    """Return columns of A (m, n) that are independent, and an orthonormal basis (m, r) of them."""
    # `least` is the norm of what others leave of a column that counts as nothing.
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
    """Index of the first entry that equals the largest one to rounding."""
    return int(np.argmax(sizes >= (1.0 - tolerances.TIED) * sizes.max()))


def redundant_rows(
    null_space: Array, names: Sequence[str], first: Sequence[str] = ()
) -> tuple[str, ...]:
    """Names of rows that can be dropped without lowering the rank."""
    # A set of k rows can go if and only if its k x k block of the left null space N (m, k) is
    # regular: pivots of N^T are such a set, the best conditioned first; those named in `first`
    # before others, if they can go. Among equals the later rows go.
    weights = np.where(np.isin(names, first), _PREFERENCE, 1.0)[:, None]
    order, _ = pivots((weights * null_space)[::-1].T, 0.0)
    return tuple(names[i] for i in sorted(len(names) - 1 - np.array(order, dtype=np.int_)))


def above_tolerance(
    S: NDArray[np.floating[Any]], share: float = tolerances.RANK
) -> NDArray[np.bool_]:
    """Flag of each singular value: above a share of the largest, by default rounding."""
    return np.asarray(share * S.max(initial=0.0) < S)


def rank_of(S: NDArray[np.floating[Any]], share: float = tolerances.RANK) -> int:
    """Numerical rank: number of singular values above a share of the largest."""
    return int(np.count_nonzero(above_tolerance(S, share)))


def null_space(A: Array) -> Array:
    """Orthonormal basis of the null space of A (m, n), (n - rank, n)."""
    _, S, Vt = np.linalg.svd(A)
    return np.asarray(Vt[rank_of(S) :])


# The range-space method: independent rows, two Cholesky factorisations.
#
# With M = U^T U and W = U^-T J^T, the Jacobian in the metric of M,
#
#     G = J M^-1 J^T = W^T W,    z = U^-T x,    G lam = y - W^T z,    U a = z + W lam
#
# solve M a - J^T lam = x, J a = y.


@dataclass(frozen=True, eq=False)
class RangeSpace:
    """Factors of one M and J with independent rows, or with rows that are damped."""

    U: Array  # (nv, nv) upper Cholesky factor of M; what is below its diagonal means nothing
    W: Array  # (nv, m) U^-T J^T
    C: Array  # (m, m) upper Cholesky factor of G + diag(R)

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
    """Factorise M and J; None if M is not positive definite or the rows are not independent."""
    # With mu > 0 [1/kg] the rows may be anything: G + mu I takes the place of G.
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
    """Factorise M and J with G + diag(R), R (m,) or the same for all rows [1/kg]."""
    # None if M or G + diag(R) is not positive definite.
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


# Motions that constraints hold, and those that they leave free, orthonormal in the metric of M.
#
# With M = L L^T, LAPACK's complete orthogonal factorisation of the whitened Jacobian J L^-T is
#
#     L^-1 J^T P = Q [ T  0 ] Z,        T upper triangular,    K^T = [ T^-T  0 ] Z P^T
#                    [ 0  0 ]
#
# Rows of B = Q^T L^-1 are motions with B M B^T = 1. The first, B_h, are held, one for each
# independent row, and J^T K = M B_h^T: columns of K are the smallest forces that push against them.
# The others are free, J B_f^T = 0. With them
#
#     M a - J^T lam = x,  J a = y      is solved by      a  = B_h^T K^T y + B_f^T B_f x,
#                                                       lam = K (K^T y - B_h x),
#
# and nothing has to cancel: what constraints hold is told apart from the rest before it is divided
# by M. Where rows are redundant, K gives the smallest lam, and the last columns N of P Z^T span
# what they contradict each other by, J^T N = 0.
#
# References
# ----------
# Golub, Van Loan. Matrix Computations, 5.5: complete orthogonal decompositions.


# Columns that LAPACK turns at once.
_BLOCK: Final = 32


class ConstraintBasis(NamedTuple):
    """Basis of constrained and free motions of one M and J."""

    B: Array  # (nv, nv) motions, one a row: first those that are held
    K: Array  # (m, rank) forces that push against one of these each
    N: Array  # (m, m - rank) orthonormal forces that redundant rows carry among themselves

    def solve(self, x: Array, y: Array) -> tuple[Array, Array]:
        """Return (a, lam) for one or many right-hand sides x (nv, k), y (m, k)."""
        return self.motion(x, y), self.force(x, y)

    def motion(self, x: Array, y: Array) -> Array:
        """Acceleration a (nv,) or (nv, k)."""
        moved = self.B.dot(x)
        moved[: self.K.shape[1]] = self.K.T.dot(y)
        a: Array = self.B.T.dot(moved)
        return a

    def force(self, x: Array, y: Array) -> Array:
        """Constraint forces lam (m,) or (m, k)."""
        asked = self.K.T.dot(y)
        asked -= self.B[: self.K.shape[1]].dot(x)
        lam: Array = self.K.dot(asked)
        return lam

    def held(self, y: Array) -> Array:
        """Motion (nv,) with J a = y (m,) and no component along free motions."""
        a: Array = self.K.T.dot(y).dot(self.B[: self.K.shape[1]])
        return a

    @property
    def mobility(self) -> Array:
        """Mobility B_f^T B_f (nv, nv): map from torques to accelerations along free motions."""
        free = self.B[self.K.shape[1] :]
        return np.asarray(free.T.dot(free))

    @property
    def support(self) -> Array:
        """Map -K B_h (m, nv) from torques to constraint forces."""
        return np.asarray(-self.K.dot(self.B[: self.K.shape[1]]))


def held_and_free(L_inv: Array, J: Array, share: float, most: int | None = None) -> ConstraintBasis:
    """Return the constrained and the free motions of M = L L^T and J (m, nv)."""
    # Rows count as independent whose part of J L^-T is more than a share of the largest, and no
    # more of them than `most`.
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
    return ConstraintBasis(B, K_T.T, ZP_T[rank:].T)


@cache
def _numbered(m: int) -> Array:
    """Columns of the unit matrix (m, m + 1) by their pivot numbers, counted from 1 as in LAPACK."""
    return read_only(np.eye(m, m + 1, 1))


def _all_free(L_inv: Array, m: int) -> ConstraintBasis:
    return ConstraintBasis(L_inv, np.zeros((m, 0)), np.eye(m))


# The factor of one mass matrix, M = L L^T, and what it says whatever is constrained.


_NOT_POSITIVE: Final = "the mass matrix is not positive definite at this q"


@dataclass(eq=False)
class MassFactor:
    """Factors of one mass matrix."""

    M: Array  # (nv, nv)
    L: Array  # (nv, nv) its lower Cholesky factor

    @cached_property
    def L_inv(self) -> Array:
        """Inverse factor L^-1 (nv, nv): ten times as fast as LAPACK's solve of many columns."""
        return np.asarray(lapack().dtrtri(self.L, lower=1)[0])

    @cached_property
    def weights(self) -> Array:
        """Weights W (nv,): square roots of the diagonal of M^-1."""
        return np.asarray(np.sqrt(np.einsum("ij,ij->j", self.L_inv, self.L_inv)))

    @cached_property
    @one_blas_thread
    def rounding(self) -> float:
        """Rounding error of the best acceleration: eps cond(D M D), D = diag(M_jj^-1/2)."""
        rows = np.linalg.norm(self.L, axis=1)  # M_jj^1/2
        return _EPS * float(np.linalg.cond(self.L / rows[:, None])) ** 2

    @cached_property
    @one_blas_thread
    def condition(self) -> float:
        """Condition number of M."""
        return float(np.linalg.cond(self.M))

    @cached_property
    def pivots(self) -> Array:
        """Pivots D (nv,) of M = U D U^T."""
        return cholesky_pivots(self.M)

    def condition_exceeds(self, limit: float) -> bool:
        """True if the condition number is above a limit; traces rule out most cases at less cost.

        |M| |M^-1| <= tr M tr M^-1
        """
        at_most = float(self.M.trace()) * float((self.weights**2).sum())
        return not at_most <= limit and self.condition > limit


def factorise_mass(M: Array, *, why: Callable[[], str] = str) -> MassFactor:
    """Factorise M (nv, nv), or raise InvalidModel; `why` says why M is not positive definite."""
    upper, info = lapack().dpotrf(M.T)  # what is below the diagonal, as in np.linalg.cholesky
    if info:
        raise InvalidModel(why() or _NOT_POSITIVE)
    return MassFactor(M, upper.T)


def inverse_factor(M: Array) -> Array:
    """Inverse Cholesky factor L^-1 (nv, nv) of M = L L^T; InvalidModel if there is none."""
    of = lapack()
    upper, info = of.dpotrf(M.T)
    if info:
        raise InvalidModel(_NOT_POSITIVE)
    return of.dtrtri(upper, 0, 0, 1)[0].T  # type: ignore[no-any-return]


def cholesky_pivots(M: Array) -> Array:
    """Pivots D (nv,) of M = U D U^T; NaN if M is not positive definite."""
    from_the_tips = M.ravel()[::-1].copy().reshape(M.shape)
    factor, info = lapack().dpotrf(from_the_tips.T, 1, 0, 1)  # M is symmetric
    if info:
        return np.full(len(M), np.nan)
    roots = factor.diagonal()[::-1]
    return np.asarray(roots * roots)


@cache
def lapack() -> Any:
    """LAPACK's own routines: half the time of numpy's at the size of robots."""
    from scipy.linalg import lapack  # takes as long to import as Pinocchio

    return lapack


# Inverses that are NaN where there is none, for steps that look at their answer anyway.


def inverse(A: Array) -> Array:
    """Return A^-1 (n, n); NaN if A is singular."""
    try:
        return np.asarray(np.linalg.inv(A), dtype=np.float64)
    except np.linalg.LinAlgError:
        return np.full_like(A, nan)


# Residuals of a linear system, summed exactly: extended precision on any machine.
#
# A product of two doubles is the sum of two doubles, found by splitting each factor in halves
# (Veltkamp, Dekker). `math.fsum` adds any number of doubles with one rounding at the end.
#
# References
# ----------
# Dekker. A floating-point technique for extending the available precision. Numer. Math. 18, 1971.
# Ogita, Rump, Oishi. Accurate sum and dot product. SIAM J. Sci. Comput. 26, 2005.


_SPLITTER = 2.0**27 + 1.0


def split(x: Array) -> tuple[Array, Array]:
    """Return two arrays of 26-bit numbers whose sum is x exactly."""
    c = _SPLITTER * x
    high = c - (c - x)
    return high, x - high


def exact_product(x: Array, y: Array) -> tuple[Array, Array]:
    """Return p and e with p + e = x y exactly, elementwise."""
    p = x * y
    (x1, x2), (y1, y2) = split(x), split(y)
    return p, x2 * y2 - (((p - x1 * y1) - x2 * y1) - x1 * y2)


def exact_residual(A: Array, b: Sequence[Array], x: tuple[Array, Array]) -> Array:
    """Return sum(b) - A (x[0] + x[1]) (k,), rounded once; NaN in rows whose sum is not finite."""
    # Both are sums, so that forming them costs no digits; x[1] is the smaller part of the unknown.
    with np.errstate(over="ignore", invalid="ignore"):  # what overflows becomes NaN in its row
        p, e = exact_product(A, x[0])
        rows = np.column_stack([*b, -p, -e, -A * x[1]])
    return np.array([_sum(row) for row in rows.tolist()])  # a list is read three times as fast


def _sum(row: list[float]) -> float:
    try:
        return math.fsum(row)
    except (OverflowError, ValueError):
        return math.nan


def add(x: tuple[Array, Array], y: Array) -> tuple[Array, Array]:
    """Return x + y as a sum of two doubles (Knuth's two-sum, then renormalised)."""
    s = x[0] + y
    t = s - x[0]
    low = x[1] + ((x[0] - (s - t)) + (y - t))
    high = s + low
    return high, low - (high - s)
