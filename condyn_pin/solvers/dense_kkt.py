"""DenseKKT: assemble the whole matrix and factorise it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from condyn_pin import tolerances
from condyn_pin.errors import InvalidArgument
from condyn_pin.robot import Vector
from condyn_pin.solvers.base import Method, Singular, Solver

if TYPE_CHECKING:
    from condyn_pin.equations import Terms
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

    Notes
    -----
    Cost O((n + m)^3); the yardstick that sparse methods are compared with. Bunch-Kaufman pivoting
    and a condition estimate, LAPACK dsytrf, dsycon, dsytrs. The matrix is scaled by its diagonal
    and its row norms first, so that neither units nor light bodies look like a singularity.

    References
    ----------
    Bunch, Kaufman. Some stable methods for calculating inertia and solving symmetric linear
    systems. Mathematics of Computation 31, 1977.
    """

    title: ClassVar[str] = "Dense KKT"
    cost: ClassVar[str] = "O((n + m)^3)"
    takes_redundant: ClassVar[bool] = False

    mu: float = 0.0  # [1/kg]

    def __post_init__(self) -> None:
        if not (np.isfinite(self.mu) and self.mu >= 0):
            raise InvalidArgument(f"mu = {self.mu!r}: a finite number >= 0 [1/kg] is needed")

    def start(self, workspace: Workspace) -> Method:
        """Return the assembled solve bound to the memory of `workspace`."""
        equations, mu, n = workspace.equations, self.mu, workspace.model.nv
        latest = np.zeros(equations.m)

        def acceleration(q: Vector, v: Vector, tau: Vector) -> Vector:
            x = solve_kkt(equations.terms(q, v), tau, mu)
            latest[:] = -x[n:]
            return x[:n]

        return Method(acceleration, lambda: equations.sign * latest, lambda: 1)


def solve_kkt(terms: Terms, tau: Vector, mu: float) -> Vector:
    """Return (a, -lam) of the KKT system with -mu I in its lower right block.

    Raises
    ------
    Singular
        If the scaled matrix has a reciprocal condition number below the tolerance.
    """
    # imported on the first solve: scipy.linalg takes as long to import as Pinocchio
    from scipy.linalg.lapack import dsycon, dsytrf, dsytrs

    M, J = terms.M, terms.J
    n, m = M.shape[0], J.shape[0]
    # D K D with D = diag(M_ii^-1/2, 1/|J_i M_d^-1/2|): ones on the diagonal, unit rows of J
    d = np.empty(n + m)
    d[:n] = 1 / np.sqrt(M.diagonal())
    K = np.zeros((n + m, n + m), order="F")
    K[:n, :n] = M
    K[n:, :n] = J
    scaled = J * d[:n]
    norms = np.sqrt(np.einsum("ij,ij->i", scaled, scaled))
    d[n:] = 1 / np.where(norms > 0, norms, 1.0)
    K[range(n, n + m), range(n, n + m)] = -mu
    K *= d
    K *= d[:, None]
    size = np.abs(K).sum(axis=0).max()
    factor, pivots, info = dsytrf(K, lower=1, overwrite_a=1)
    if info > 0 or dsycon(factor, pivots, size, lower=1)[0] < tolerances.SINGULAR:
        raise Singular
    rhs = d * np.concatenate([tau - terms.h, terms.a_ref - terms.gamma])
    x, _ = dsytrs(factor, pivots, rhs, lower=1)
    return d * x.ravel()
