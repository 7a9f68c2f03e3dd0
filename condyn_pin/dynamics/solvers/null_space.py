"""NullSpace: split the motion into what the constraints fix and what they leave free."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core.arguments import check_share
from condyn_pin._core.arrays import Array, ignore_float_errors
from condyn_pin._core.threads import one_blas_thread
from condyn_pin.constraints.rows.bound import Terms
from condyn_pin.dynamics.solvers.solver import BoundSolver, Singular, Solver, free_force

if TYPE_CHECKING:
    from condyn_pin.dynamics.workspace import Workspace


@dataclass(frozen=True)
class NullSpace(Solver):
    """QR of J^T: its columns Y carry the constraints, the others, Z, the free motion.

    With D = diag(M_jj^-1/2), so that units do not count, and column pivoting,

        D J^T P = [Y Z] [R; 0],    a = D (Y y + Z z),
        R^T y = P^T (a_ref - gamma),
        Z^T D M D Z z = Z^T D (tau - h - M D Y y),
        R P^T lam = Y^T D (M a + h - tau).

    Rows beyond the rank are left out of the second line, and the fourth is solved by the smallest
    lam.

    Parameters
    ----------
    rank_tolerance : float
        Rows of R whose pivot is below this share of the largest belong to redundant rows, and so do
        those that rounding of J can make up, as measured at the nominal state.

    Raises
    ------
    InvalidArgument
        If `rank_tolerance` is not between 0 and 1.

    Notes
    -----
    Cost O(n^2 m + n^2 (n - m) + (n - m)^3): the matrix that is factorised is as small as the
    mobility, 1 for a four-bar. Nothing is inverted but M seen by the free motion, and J is never
    squared. lam is computed when it is asked for.

    References
    ----------
    Benzi, Golub, Liesen. Numerical solution of saddle point problems, section 6. Acta Numerica 14,
    2005.
    """

    title: ClassVar[str] = "Null space"
    cost: ClassVar[str] = "O(n^2 m + n^2 (n - m) + (n - m)^3)"
    use: ClassVar[str] = "redundant rows of any kind; mechanisms with few freedoms left"
    takes_redundant: ClassVar[bool] = True

    rank_tolerance: float = tolerances.RANK

    def __post_init__(self) -> None:
        super().__post_init__()
        check_share("rank_tolerance", self.rank_tolerance)

    def start(self, workspace: Workspace) -> BoundSolver:
        """Return the factorisation bound to the equations of `workspace`."""
        rank_tolerance, nominal = self.rank_tolerance, workspace.scene.nominal
        reached = workspace.equations.cancellation(nominal.q) / np.sqrt(nominal.terms.M.diagonal())
        least = tolerances.BLURRED * float(np.finfo(float).eps * np.linalg.norm(reached))
        latest: list[tuple[_Split, Array]] = []

        @one_blas_thread
        @ignore_float_errors  # the status says it
        def acceleration(q: Array, v: Array, tau: Array) -> Array:
            terms = workspace.equations.consistent_terms(q, v)
            split = _Split(terms, rank_tolerance, least)
            x = free_force(tau, terms.h)
            a = split.acceleration(x, terms.a_ref - terms.gamma)
            latest[:] = [(split, terms.M @ a - x)]
            return a

        @one_blas_thread
        def lam() -> Array:
            split, missing = latest[-1]
            return split.forces(missing)

        return BoundSolver(acceleration, lam, lambda: 1)


class _Split:
    """The two spaces of one M and J."""

    def __init__(self, terms: Terms, rank_tolerance: float, least: float) -> None:
        # imported here: scipy.linalg takes as long to import as Pinocchio
        from scipy.linalg.lapack import dgeqp3, dormqr

        n, self.m = terms.J.shape[1], len(terms.J)
        diagonal = terms.M.diagonal()
        if not (diagonal > 0).all():
            raise Singular
        self.D = 1 / np.sqrt(diagonal)
        self.M = self.D[:, None] * terms.M * self.D
        self.order, self.R, self.rank = np.zeros(0, dtype=int), np.zeros((n, 0)), 0
        Q = np.eye(n, order="F")
        if self.m:
            self.R, order, reflectors, _, _ = dgeqp3((terms.J * self.D).T)
            self.order = order - 1  # LAPACK counts from one
            pivots = np.abs(self.R.diagonal())
            self.rank = int(np.count_nonzero(pivots > max(rank_tolerance * pivots[0], least)))
            columns = self.R[:, : len(reflectors)]
            Q = dormqr("L", "N", columns, reflectors, Q, 64 * n, overwrite_c=1)[0]
        self.Y, self.Z = Q[:, : self.rank], Q[:, self.rank :]

    def acceleration(self, x: Array, b: Array) -> Array:
        """Return a with J a = b, and M a - x among the forces of the constraints."""
        from scipy.linalg.lapack import dposv, dtrtrs

        D, Z, r = self.D, self.Z, self.rank
        a = np.zeros(len(D))
        if r:
            a = self.Y @ dtrtrs(self.R[:r, :r], b[self.order[:r]], trans=1)[0]
        if Z.shape[1]:
            _, z, info = dposv(Z.T @ self.M @ Z, Z.T @ (D * x - self.M @ a))
            if info:
                raise Singular
            a += Z @ z
        return np.asarray(D * a)

    def forces(self, missing: Array) -> Array:
        """Return the smallest lam with J^T lam = missing."""
        from scipy.linalg.lapack import dgels

        lam, r = np.zeros(self.m), self.rank
        if r:
            wanted = np.zeros(self.m)
            wanted[:r] = self.Y.T @ (self.D * missing)
            lam[self.order] = dgels(np.triu(self.R[:r]), wanted)[1]
        return lam
