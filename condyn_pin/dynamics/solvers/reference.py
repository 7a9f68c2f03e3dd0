"""Reference: the slow method that the others are judged by."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core.arguments import check_count, check_share
from condyn_pin._core.arrays import Array, ignore_float_errors
from condyn_pin._core.linalg import add, exact_residual, factorise
from condyn_pin._core.threads import one_blas_thread
from condyn_pin.constraints.rows.bound import Terms
from condyn_pin.dynamics.solvers.solver import BoundSolver, Singular, Solver
from condyn_pin.errors import InvalidModel

if TYPE_CHECKING:
    from condyn_pin.dynamics.workspace import Workspace


@dataclass(frozen=True)
class Reference(Solver):
    """Rank-revealing, minimum-norm, refined in extended precision.

    With M = L L^T, Jw = J L^-T and a_free = M^-1 (tau - h), Gauss's principle reads

        a = a_free + L^-T Jw^+ (a_ref - gamma - J a_free),    M a + h = tau + J^T lam,

    with lam the solution of smallest norm. The pseudo-inverse is the singular value decomposition
    cut at `rank_tolerance`. Then x = (a, lam) is refined: the residual of the KKT system is summed
    exactly in double-double products, the correction is solved in double, and x itself is kept as
    a sum of two doubles.

    Parameters
    ----------
    rank_tolerance : float
        Singular values of Jw below this share of the largest belong to redundant rows, and so do
        those that rounding of J can make up, where bodies are light or far away.
    refinements : int
        Corrections. Each gains the digits that conditioning leaves to the factors; two reach the
        rounding of the answer for every scene in the tests.

    Raises
    ------
    InvalidArgument
        If `rank_tolerance` is not between 0 and 1, or `refinements` is no count.

    Notes
    -----
    Cost O(n^3 + m^2 n), and milliseconds for the exact sums: for judging, not for loops. The
    products are split by Dekker's method and the sums are `math.fsum`, so nothing relies on a
    wider long double, which some machines do not have.

    References
    ----------
    Ogita, Rump, Oishi. Accurate sum and dot product. SIAM J. Sci. Comput. 26, 2005.
    Udwadia, Kalaba. A new perspective on constrained motion. Proc. R. Soc. A 439, 1992.
    """

    title: ClassVar[str] = "Reference"
    cost: ClassVar[str] = "O(n^3 + m^2 n), with exact sums"
    use: ClassVar[str] = "the truth that others are compared with; any rows"
    takes_redundant: ClassVar[bool] = True

    rank_tolerance: float = tolerances.REFERENCE_RANK
    refinements: int = 3

    def __post_init__(self) -> None:
        super().__post_init__()
        check_share("rank_tolerance", self.rank_tolerance)
        check_count("refinements", self.refinements, least=0)

    def start(self, workspace: Workspace) -> BoundSolver:
        """Return the reference bound to the memory of `workspace`."""
        latest = np.zeros(workspace.scene.rows)

        @one_blas_thread
        @ignore_float_errors  # the status says it
        def acceleration(q: Array, v: Array, tau: Array) -> Array:
            equations = workspace.equations
            terms = equations.consistent_terms(q, v)
            a, latest[:] = self.solve(terms, tau, equations.cancellation(q))
            return a

        return BoundSolver(acceleration, latest.copy, lambda: 1 + self.refinements)

    def solve(self, terms: Terms, tau: Array, P: Array | None = None) -> tuple[Array, Array]:
        """Return a and the minimum-norm lam of the given terms.

        With P, what J is a difference of, singular values that rounding of J makes up do not count.
        """
        m, n = terms.J.shape
        try:
            factors = factorise(terms.M, terms.J, self.rank_tolerance)
        except InvalidModel as error:
            raise Singular from error
        if P is not None:
            factors = factors.above_rounding(P)
        K = np.block([[terms.M, -terms.J.T], [terms.J, np.zeros((m, m))]])
        b = (np.concatenate([tau, terms.a_ref]), -np.concatenate([terms.h, terms.gamma]))
        unit = _power_of_two(*b)  # splitting a huge number overflows
        b = (b[0] / unit, b[1] / unit)
        r = b[0] + b[1] + 0.0  # of x = 0, rounded once as it is; no zero is negative
        x = (np.concatenate(factors.solve(r[:n], r[n:])), np.zeros(n + m))
        for _ in range(self.refinements):
            r = exact_residual(K, b, x)
            x = add(x, np.concatenate(factors.solve(r[:n], r[n:])))
        return unit * x[0][:n], unit * x[0][n:]


def _power_of_two(*parts: Array) -> float:
    """Return a power of two by which huge numbers are divided without rounding; 1 for all else."""
    largest = max(float(np.abs(part).max(initial=0.0)) for part in parts)
    return 2.0 ** math.frexp(largest)[1] if 1e150 < largest < 8e307 else 1.0
