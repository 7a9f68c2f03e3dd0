"""MinimumResidual: MINRES on the whole matrix, applied by sweeps over the tree, never formed."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array, ignore_float_errors
from condyn_pin._core.models import whole_data
from condyn_pin._core.tolerances import RANK, RUN_OF_MINRES
from condyn_pin.dynamics.at_state import without_gravity
from condyn_pin.dynamics.recursion import MatrixFreeSolver, inverse_delassus
from condyn_pin.dynamics.solvers.solver import BoundSolver, free_force
from condyn_pin.dynamics.workspace import Workspace


@dataclass(frozen=True)
class MinimumResidual(MatrixFreeSolver):
    """MINRES for a and lam at once, preconditioned, with sweeps over the tree in place of matrices.

    [ M   J^T   ] [ a - a_free ]   [           0              ]
    [ J  -mu I  ] [    -lam    ] = [ a_ref - gamma - J a_free ]

    The matrix is symmetric and indefinite, and singular where rows are redundant: MINRES takes
    both. M x is inverse dynamics at rest and without gravity, J x and J^T x are as in
    `ConjugateGradient`. The preconditioner is M^-1 by the articulated body algorithm, and the
    inverse of G = J M^-1 J^T at the nominal state; there the matrix has three eigenvalues, 1 and
    (1 +- sqrt(5)) / 2. The true residual of one run is the right side of the next, because the
    residual of the recurrence drifts from it.

    Parameters
    ----------
    tolerance : float, optional
        Iterate until |a_ref - gamma - J a - mu lam|_inf is below this [m/s^2]. By default a tenth
        of what a status of ok allows on the scene.
    max_iterations : int
        Upper limit, of all runs together. Cassie's loops and Talos's feet take about 30.
    mu : float
        Damping [1/kg]. Redundant rows need none. With mu > 0 a is off by about mu / sigma
        relative, sigma the smallest nonzero eigenvalue of G.

    Notes
    -----
    Cost O(n + m) of sweeps and O(m^2) of the preconditioner an iteration. It takes two to four
    times the iterations of `ConjugateGradient`, each with one sweep more: for these right sides
    every other step of MINRES hardly helps (Fischer, Ramage, Silvester, Wathen 1998).

    References
    ----------
    Paige, Saunders. Solution of sparse indefinite systems of linear equations. SIAM J. Numer.
    Anal. 12, 1975.
    Fischer, Ramage, Silvester, Wathen. Minimum residual methods for augmented systems. BIT 38,
    1998.
    Murphy, Golub, Wathen. A note on preconditioning for indefinite linear systems. SIAM J. Sci.
    Comput. 21, 2000.
    """

    title: ClassVar[str] = "MINRES"
    cost: ClassVar[str] = "O(n + m^2) an iteration, two to four iterations an independent row"
    use: ClassVar[str] = "to compare with; any rows, the whole matrix applied and never formed"
    takes_open: ClassVar[bool] = False

    max_iterations: int = 1000

    def start(self, workspace: Workspace) -> BoundSolver:
        """Return the iteration bound to the memory of `workspace`."""
        model, data = workspace.model, whole_data(workspace.model)
        nominal, mu, most = workspace.scene.nominal, self.mu, self.max_iterations
        P, n, m = inverse_delassus(nominal), model.nv, workspace.scene.rows
        enough = self.wanted(workspace)
        floating, still = without_gravity(model), np.zeros(n)
        latest, count = np.zeros(m), [0]

        @ignore_float_errors  # the status says it
        def acceleration(q: Array, v: Array, tau: Array) -> Array:
            equations = workspace.equations

            def kkt(x: Array) -> Array:
                a, lam = x[:n], -x[n:]
                forces = pin.rnea(floating, data, q, still, a, equations.wrenches(lam))
                return np.append(
                    forces - equations.torque(lam), equations.jacobian_product(q, a) + mu * lam
                )

            def precondition(x: Array) -> Array:
                return np.append(pin.aba(floating, data, q, still, x[:n]), P @ x[n:])

            def accelerated(lam: Array) -> Array:
                forces = free_force(tau, -equations.torque(lam))
                return np.array(pin.aba(model, data, q, v, forces, equations.wrenches(lam)))

            target, lam, count[0] = equations.target(q, v), np.zeros(m), 0
            best, smallest = still, np.inf
            while True:
                a = accelerated(lam)
                missing = target - equations.jacobian_product(q, a) - mu * lam
                residual = np.abs(missing).max(initial=0.0)
                if not residual < smallest:
                    return best if np.isfinite(smallest) else a  # numbers that overflow
                best, latest[:], smallest = a, lam, residual
                if residual <= enough or count[0] >= most:
                    return best
                right = np.append(still, missing)
                x, k = minimum_residual(kkt, precondition, right, RUN_OF_MINRES, most - count[0])
                lam, count[0] = lam - x[n:], count[0] + k

        return BoundSolver(acceleration, latest.copy, lambda: count[0])


def minimum_residual(
    product: Callable[[Array], Array],
    precondition: Callable[[Array], Array],
    b: Array,
    reduction: float,
    most: int,
) -> tuple[Array, int]:
    """Return x with |b - A x| < reduction |b|, and the iterations, `most` at most."""
    # `product` returns A x, of a symmetric A, and `precondition` P x of a symmetric and positive
    # definite P; the norm is |r|^2 = r^T P r. Lanczos' three terms make A tridiagonal, with delta
    # and gamma; each Givens rotation (c, s) removes one gamma, and leaves the residual eta. What no
    # x reduces, a part of b outside the range of A, stays.
    x, w, w_last, r, r_last = (np.zeros_like(b) for _ in range(5))
    r += b
    z = precondition(r)
    first = eta = gamma = math.sqrt(max(float(r @ z), 0.0))
    gamma_last, c, c_last, s, s_last, k = 1.0, 1.0, 1.0, 0.0, 0.0, 0
    while abs(eta) > reduction * first and k < most:
        u = z / gamma
        Au = product(u)
        delta = float(u @ Au)
        r_last, r = r, Au - (delta / gamma) * r - (gamma / gamma_last) * r_last
        z = precondition(r)
        gamma_last, gamma_next = gamma, math.sqrt(max(float(r @ z), 0.0))
        diagonal = c * delta - c_last * s * gamma
        if math.hypot(diagonal, c * gamma_next) < RANK:  # |A r| / |r|: the rest is out of range
            break
        rotated = math.hypot(diagonal, gamma_next)
        above = s * delta + c_last * c * gamma
        w_last, w = w, (u - s_last * gamma * w_last - above * w) / rotated
        c_last, s_last, c, s = c, s, diagonal / rotated, gamma_next / rotated
        x += c * eta * w
        eta, gamma, k = -s * eta, gamma_next, k + 1
    return x, k
