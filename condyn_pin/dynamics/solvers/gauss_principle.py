"""GaussPrinciple: Udwadia and Kalaba's formula."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core.arguments import check_share
from condyn_pin._core.arrays import Array, ignore_float_errors
from condyn_pin._core.linalg import factorise
from condyn_pin._core.threads import one_blas_thread
from condyn_pin.dynamics.solvers.solver import BoundSolver, Singular, Solver, free_force
from condyn_pin.dynamics.workspace import Workspace
from condyn_pin.errors import InvalidModel


@dataclass(frozen=True)
class GaussPrinciple(Solver):
    """Of all motions that the constraints allow, the one nearest to the free motion.

    Gauss's principle of least constraint, min |a - a_free|_M with J a + gamma = a_ref, has the
    answer of Udwadia and Kalaba,

        a = a_free + M^-1/2 (J M^-1/2)^+ (a_ref - gamma - J a_free),    a_free = M^-1 (tau - h).

    Any root of M will do; here it is the Cholesky factor, M = L L^T, and J L^-T is taken apart by
    the singular value decomposition, whose left side gives the smallest lam as well.

    Parameters
    ----------
    rank_tolerance : float
        Singular values of J L^-T below this share of the largest belong to redundant rows, and so
        do those that rounding of J can make up, as measured at the nominal state.

    Raises
    ------
    InvalidArgument
        If `rank_tolerance` is not between 0 and 1.

    Notes
    -----
    Cost O(n^3 + m^2 n), of which the singular values take most. No other factorisation shows the
    rank as clearly, or is as accurate: J L^-T is never squared. `Reference` is this one, refined.

    References
    ----------
    Udwadia, Kalaba. A new perspective on constrained motion. Proc. R. Soc. A 439, 1992.
    """

    title: ClassVar[str] = "Gauss principle"
    cost: ClassVar[str] = "O(n^3 + m^2 n), singular values"
    use: ClassVar[str] = "redundant rows of any kind, where accuracy counts more than time"
    takes_redundant: ClassVar[bool] = True

    rank_tolerance: float = tolerances.RANK

    def __post_init__(self) -> None:
        super().__post_init__()
        check_share("rank_tolerance", self.rank_tolerance)

    def start(self, workspace: Workspace) -> BoundSolver:
        """Return the formula bound to the equations of `workspace`."""
        rank_tolerance = self.rank_tolerance
        least = tolerances.BLURRED * workspace.scene.nominal.estimator.blur
        latest = np.zeros(workspace.scene.rows)

        @one_blas_thread
        @ignore_float_errors  # the status says it
        def acceleration(q: Array, v: Array, tau: Array) -> Array:
            terms = workspace.equations.consistent_terms(q, v)
            try:
                factors = factorise(terms.M, terms.J, rank_tolerance, least)
            except InvalidModel as error:
                raise Singular from error
            a, latest[:] = factors.solve(free_force(tau, terms.h), terms.a_ref - terms.gamma)
            return a

        return BoundSolver(acceleration, latest.copy, lambda: 1)
