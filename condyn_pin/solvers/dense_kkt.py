"""DenseKKT: assemble the whole matrix and factorise it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from condyn_pin import tolerances
from condyn_pin.arrays import Array
from condyn_pin.blas_threads import one_blas_thread
from condyn_pin.knobs import WEIGHTS, Grid, check_damping, check_refinements
from condyn_pin.solvers.base import Method, Singular, Solver

if TYPE_CHECKING:
    from condyn_pin.rows.terms import Terms
    from condyn_pin.workspace import Workspace


@dataclass(frozen=True)
class DenseKKT(Solver):
    """Symmetric indefinite solve of the assembled matrix: the textbook method.

    [ M   J^T  ] [   a  ]   [  tau - h      ]
    [ J  -mu I ] [ -lam ] = [ a_ref - gamma ]

    Parameters
    ----------
    mu : float
        Regularisation of the lower right block [1/kg]. With 0 the answer is exact where the rows
        are independent, and `singular` where they are not. With mu > 0 it always exists, and a is
        off by about mu / sigma relative, sigma the smallest nonzero eigenvalue of J M^-1 J^T.
    refinements : int
        Corrections by residuals of Newton-Euler and forward kinematics with the same factor: they
        make up for mu and for rounding, each for the price of a look as in `solve`.

    Notes
    -----
    Cost O((n + m)^3); the yardstick that sparse methods are compared with. Bunch-Kaufman pivoting
    and a condition estimate: LAPACK's dsytrf, dsycon, dsytrs. The matrix is scaled first, by the
    diagonal of M and the rows of J at the nominal state, so that neither units nor light bodies
    look like a singularity.

    References
    ----------
    Bunch, Kaufman. Some stable methods for calculating inertia and solving symmetric linear
    systems. Mathematics of Computation 31, 1977.
    """

    title: ClassVar[str] = "Dense KKT"
    cost: ClassVar[str] = "O((n + m)^3)"
    use: ClassVar[str] = "to compare with; independent rows of any kind"
    takes_redundant: ClassVar[bool] = False
    sweeps: ClassVar[tuple[Grid, ...]] = ({"mu": WEIGHTS},)

    mu: float = 0.0  # [1/kg]
    refinements: int = 0

    def __post_init__(self) -> None:
        check_damping(self.mu)
        check_refinements(self.refinements)

    def start(self, workspace: Workspace) -> Method:
        """Return the assembled solve bound to the memory of `workspace`."""
        # imported here: scipy.linalg takes as long to import as Pinocchio
        from scipy.linalg.lapack import dsycon, dsytrf, dsytrs

        n, d = workspace.model.nv, scaling(workspace.scene.audit.terms)
        size = len(d)
        scale = np.asfortranarray(np.outer(d, d))
        empty = np.zeros((size, size), order="F")
        empty[range(n, size), range(n, size)] = -self.mu
        answer = np.zeros(size)

        @one_blas_thread
        @np.errstate(over="ignore", invalid="ignore")  # the status says it
        def acceleration(q: Array, v: Array, tau: Array) -> Array:
            terms = workspace.equations.terms(q, v)
            K = empty.copy(order="F")
            K[:n, :n] = terms.M
            K[n:, :n] = terms.J  # the lower triangle is enough
            K *= scale
            factor, pivots, info = dsytrf(K, lower=1, overwrite_a=1)
            # D K D has entries of size one, so 1 stands for its norm
            if info > 0 or not dsycon(factor, pivots, 1.0, lower=1)[0] > tolerances.SINGULAR:
                raise Singular
            # concatenated first, so that a tau of another size is refused, not broadcast
            rhs = np.concatenate([tau, terms.a_ref]) - np.concatenate([terms.h, terms.gamma])
            rhs *= d
            np.multiply(d, dsytrs(factor, pivots, rhs, lower=1)[0].ravel(), out=answer)
            for _ in range(self.refinements):
                left = workspace.equations.residuals(q, v, tau, answer[:n], -answer[n:])
                rhs = d * np.concatenate(left)
                answer[:] -= d * dsytrs(factor, pivots, rhs, lower=1)[0].ravel()
            return answer[:n].copy()

        return Method(acceleration, lambda: -answer[n:], lambda: 1 + self.refinements)


def scaling(terms: Terms) -> Array:
    """Return d such that diag(d) K diag(d) has ones on M's diagonal and unit rows of J."""
    of_M = 1 / np.sqrt(terms.M.diagonal())
    norms = np.linalg.norm(terms.J * of_M, axis=1)
    return np.concatenate([of_M, 1 / np.where(norms > 0, norms, 1.0)])
