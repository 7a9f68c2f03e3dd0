"""DenseKKT: assemble the whole matrix and factorise it."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import TYPE_CHECKING, ClassVar, Final

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core.arguments import WEIGHTS, Grid, check_damping, check_refinements
from condyn_pin._core.arrays import Array, ignore_float_errors
from condyn_pin._core.threads import one_blas_thread
from condyn_pin.constraints.rows.bound import Terms
from condyn_pin.dynamics.solvers.solver import BoundSolver, Singular, Solver, free_force

if TYPE_CHECKING:
    from condyn_pin.dynamics.workspace import Workspace

# Random right-hand sides. Near a singularity each K^-1 x is |K^-1| times a normal number: that two
# are both below 1e-3, a tenth of what lies between a redundant row and what is called one, is one
# in a million.
PROBES: Final = 2
# The matrix is scaled to entries of size one, so 1 stands for its norm.
LARGEST: Final = PROBES / tolerances.SINGULAR**2
# Columns that LAPACK factorises at once: what it asks for itself.
BLOCK: Final = 64


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
        make up for mu and for rounding; each costs as much as the verification in `solve`.

    Raises
    ------
    InvalidArgument
        If `mu` is negative or not finite, or `refinements` is not from 0 to 100.

    Notes
    -----
    Cost O((n + m)^3); Bunch-Kaufman pivoting, one call of LAPACK's dsysv. The matrix is scaled
    first, by the diagonal of M and the rows of J at the nominal state, so that neither units nor
    light bodies look like a singularity. How close it is to a singularity, without mu, is estimated
    by solving for random right-hand sides as well: with x of unit variance,

        E |K^-1 x|^2 = |K^-1|_F^2.

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
        super().__post_init__()
        check_damping(self.mu)
        check_refinements(self.refinements)

    def start(self, workspace: Workspace) -> BoundSolver:
        """Return the assembled solve bound to the memory of `workspace`."""
        # imported here: scipy.linalg takes as long to import as Pinocchio
        from scipy.linalg.lapack import dsysv, dsytrs

        n, d = workspace.model.nv, scaling(workspace.scene.nominal.terms)
        size, drift, corrections = len(d), workspace.drift, range(self.refinements)
        scale = np.asfortranarray(np.outer(d, d))
        # K, of which the lower triangle is read, and D K D, where LAPACK writes its factor
        K, factored = np.zeros((size, size), order="F"), np.empty((size, size), order="F")
        M, J = K[:n, :n].T, K[n:, :n]
        K[n:, n:] = -self.mu * np.eye(size - n)
        # rows that say nothing have pivots of mu: what solves with them is proved like any other
        largest = inf if self.mu else LARGEST
        # one after the other: the right side and the random ones; D times each, and the answers
        # take their places
        sides = np.concatenate([np.zeros(size), probing(size)])
        answers = np.zeros(len(sides))
        signed = np.concatenate([d[:n], -d[n:]])  # gamma changes sides, and so does lam
        scales = np.concatenate([signed, np.ones(PROBES * size)])
        force, gamma = sides[:n], sides[n:size]
        y, probed = answers[:size], answers[size:]
        y_n, y_m, d_n, d_m = y[:n], y[n:], signed[:n], signed[n:]
        columns, work = answers.reshape(-1, size).T, BLOCK * size
        in_place = 1, 1, 1  # lower, overwrite_a, overwrite_b: by name they take half as long again

        @one_blas_thread
        @ignore_float_errors  # the status says it
        def acceleration(q: Array, v: Array, tau: Array) -> Array:
            equations = workspace.equations
            M[:], h, J[:], gamma[:] = equations.parts(q, v)
            if drift:
                gamma[:] -= equations.a_ref()
            left = None
            if equations.redundancy is not None:
                left = equations.left_out(J, equations.violation(q))
            if left is not None:
                J[:], gamma[:] = left.kept(J), left.kept(gamma)
            free_force(tau, h, force)
            np.multiply(K, scale, factored)
            np.multiply(sides, scales, answers)
            factor, pivots, _, info = dsysv(factored, columns, work, *in_place)
            if info > 0 or not probed.dot(probed) < largest:
                raise Singular
            for _ in corrections:
                r, s = equations.residuals(q, v, tau, d_n * y_n, d_m * y_m)
                missing = np.concatenate((r, s if left is None else left.kept(s)))
                y[:] -= dsytrs(factor, pivots, missing * d, lower=1)[0].ravel()
            return d_n * y_n

        return BoundSolver(acceleration, lambda: d_m * y_m, lambda: 1 + len(corrections))


def probing(size: int) -> Array:
    """Return the random right-hand sides, one after the other; the same in every process."""
    return np.random.default_rng(0).standard_normal(PROBES * size)


def scaling(terms: Terms) -> Array:
    """Return d such that diag(d) K diag(d) has ones on M's diagonal and unit rows of J."""
    of_M = 1 / np.sqrt(terms.M.diagonal())
    norms = np.linalg.norm(terms.J * of_M, axis=1)
    # a row that is nothing at that state is scaled like the largest, not blown up
    largest = norms.max(initial=0.0) or 1.0
    return np.concatenate([of_M, 1 / np.where(norms > tolerances.RANK * largest, norms, largest)])
