"""ConjugateGradient: the Delassus operator applied by sweeps over the tree, never formed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array, ignore_float_errors
from condyn_pin._core.models import whole_data
from condyn_pin._core.tolerances import RANK
from condyn_pin.dynamics.at_state import without_gravity
from condyn_pin.dynamics.recursion import MatrixFreeSolver, inverse_delassus
from condyn_pin.dynamics.solvers.solver import BoundSolver
from condyn_pin.dynamics.workspace import Workspace


@dataclass(frozen=True)
class ConjugateGradient(MatrixFreeSolver):
    """Conjugate gradients for lam, with sweeps over the tree in place of matrices.

    (G + mu I) lam = a_ref - gamma - J a_free,    G x = J ABA(J^T x),    a = ABA(tau + J^T lam)

    J^T x are wrenches on the joints, ABA is the articulated body algorithm, and J a the
    acceleration of the constraints by forward kinematics: at a state neither M nor J nor G is
    formed. The iteration starts at lam = 0 and ends where |J a + gamma - a_ref| is small, or stops
    falling; the best lam on the way is the answer. The only matrix, (m, m), is made once for a
    scene: the preconditioner, the inverse of G at the nominal state.

    Parameters
    ----------
    tolerance : float, optional
        Iterate until |a_ref - gamma - J a - mu lam|_inf is below this [m/s^2]. By default a tenth
        of what a status of ok allows on the scene.
    max_iterations : int
        Upper limit. In exact arithmetic as many as there are independent rows are enough; Cassie's
        20 take 18, Talos's 12 take 12.
    mu : float
        Damping [1/kg]. Redundant rows need none: the right side lies in the range of G. With
        mu > 0 rows that contradict each other have an answer too, and a is off by about
        mu / sigma relative, sigma the smallest nonzero eigenvalue of G.

    Notes
    -----
    Cost O(n + m) of sweeps and O(m^2) of the preconditioner an iteration. Below a hundred joints
    dense methods are as fast or faster (`benchmarks/solvers.py conjugate_gradient`). Of many lam
    that redundant rows allow, the smallest is found where the same rows are redundant, in the same
    way, as at the nominal state; else one near it.

    References
    ----------
    Hestenes, Stiefel. Methods of conjugate gradients for solving linear systems. J. Res. Nat. Bur.
    Standards 49, 1952.
    Featherstone. Rigid body dynamics algorithms, chapter 7. Springer, 2008.
    """

    title: ClassVar[str] = "Conjugate gradient"
    cost: ClassVar[str] = "O(n + m^2) an iteration, about as many iterations as independent rows"
    use: ClassVar[str] = "any rows on models so large that no matrix is to be factorised"
    takes_open: ClassVar[bool] = False

    def start(self, workspace: Workspace) -> BoundSolver:
        """Return the iteration bound to the memory of `workspace`."""
        model, data = workspace.model, whole_data(workspace.model)
        nominal, mu = workspace.scene.nominal, self.mu
        precondition = inverse_delassus(nominal)
        enough = self.wanted(workspace)
        # at rest and without gravity, all of tau accelerates: ABA is M^-1
        floating = without_gravity(model)
        still = np.zeros(model.nv)
        latest, count = np.zeros(workspace.scene.rows), [0]

        @ignore_float_errors  # the status says it
        def acceleration(q: Array, v: Array, tau: Array) -> Array:
            equations = workspace.equations

            def damped_delassus(x: Array) -> Array:
                torque, wrenches = equations.torque(x), equations.wrenches(x)
                a = pin.aba(floating, data, q, still, torque, wrenches)
                return equations.jacobian_product(q, a) + mu * x

            missing = equations.target(q, v) - equations.jacobian_product(
                q, pin.aba(model, data, q, v, tau)
            )
            latest[:], count[0] = conjugate_gradients(
                damped_delassus, missing, precondition, enough, self.max_iterations
            )
            forces = tau + equations.torque(latest)
            return np.array(pin.aba(model, data, q, v, forces, equations.wrenches(latest)))

        return BoundSolver(acceleration, latest.copy, lambda: count[0])


def conjugate_gradients(
    product: Callable[[Array], Array], b: Array, P: Array, enough: float, most: int
) -> tuple[Array, int]:
    """Return x with |b - A x|_inf < enough, or the best one met, and the iterations."""
    # `product` returns A x, of a symmetric and positive semidefinite A; P is an approximate inverse
    # of A. `most` limits the iterations. They also end where m of them in a row have brought
    # nothing, or lead far away, as they do when what is left of b is rounding outside the range of
    # A.
    x, r, p = np.zeros_like(b), b.copy(), np.zeros_like(b)
    residual = smallest = np.abs(r).max(initial=0.0)
    best, idle, last, k = x.copy(), 0, 1.0, 0
    while smallest > enough and residual * RANK < smallest and idle < len(b) and k < most:
        z = P @ r
        size = float(r @ z)
        p = z + (size / last) * p
        Ap = product(p)
        curvature = float(p @ Ap)
        if not curvature > 0:
            break
        step, last, k = size / curvature, size, k + 1
        x += step * p
        r -= step * Ap
        residual = np.abs(r).max()
        idle = 0 if residual < smallest else idle + 1
        if not idle:
            smallest, best = residual, x.copy()
    return best, k
