"""DelassusCholesky: two small Cholesky factorisations, of M and of J M^-1 J^T."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from condyn_pin._core.arguments import WEIGHTS, Grid, check_damping
from condyn_pin._core.arrays import Array, ignore_float_errors
from condyn_pin._core.linalg import range_space
from condyn_pin._core.threads import one_blas_thread
from condyn_pin.dynamics.solvers.solver import BoundSolver, Singular, Solver, free_force
from condyn_pin.dynamics.workspace import Workspace


@dataclass(frozen=True)
class DelassusCholesky(Solver):
    """The range-space method: eliminate a, and solve for lam with the Delassus matrix G.

    G = J M^-1 J^T,    (G + mu I) lam = a_ref - gamma - J a_free,    a = a_free + M^-1 J^T lam

    with a_free = M^-1 (tau - h).

    Parameters
    ----------
    mu : float
        Damping [1/kg]. With 0 the answer is exact where the rows are independent, and `singular`
        where they are not. With mu > 0 it always exists, and a is off by about mu / sigma
        relative, sigma the smallest nonzero eigenvalue of G.

    Raises
    ------
    InvalidArgument
        If `mu` is negative or not finite.

    Notes
    -----
    Cost O(n^3 + n^2 m + m^3), with the smallest constants of all dense methods: LAPACK's dpotrf of
    M, one triangular solve for all rows, half a matrix product for G (dsyrk), and dpotrf of G. The
    condition of G is the square of that of J L^-T, which `Reference` does not suffer.

    References
    ----------
    Featherstone. Rigid body dynamics algorithms, section 8.4. Springer, 2008.
    """

    title: ClassVar[str] = "Delassus Cholesky"
    cost: ClassVar[str] = "O(n^3 + n^2 m + m^3)"
    use: ClassVar[str] = "independent rows of any kind; few rows on many joints"
    takes_redundant: ClassVar[bool] = False
    sweeps: ClassVar[tuple[Grid, ...]] = ({"mu": WEIGHTS},)

    mu: float = 0.0  # [1/kg]

    def __post_init__(self) -> None:
        super().__post_init__()
        check_damping(self.mu)

    def start(self, workspace: Workspace) -> BoundSolver:
        """Return the two factorisations bound to the equations of `workspace`."""
        mu = self.mu
        latest = np.zeros(workspace.scene.rows)

        @one_blas_thread
        @ignore_float_errors  # the status says it
        def acceleration(q: Array, v: Array, tau: Array) -> Array:
            terms = workspace.equations.consistent_terms(q, v)
            factors = range_space(terms.M, terms.J, mu)
            if factors is None:
                raise Singular
            a, latest[:] = factors.solve(free_force(tau, terms.h), terms.a_ref - terms.gamma)
            return a

        return BoundSolver(acceleration, latest.copy, lambda: 1)
