"""RadauIIA: collocation with the constraints at every stage."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt
from typing import ClassVar

import numpy as np

from condyn_pin._core.arguments import is_whole
from condyn_pin._core.arrays import Array
from condyn_pin._core.linalg import inverse
from condyn_pin.errors import InvalidArgument
from condyn_pin.simulation.integrators.integrator import (
    Integrator,
    Order,
    Partials,
    Residuals,
    Stepper,
    fixed_point_iteration,
)
from condyn_pin.simulation.system import System

_S6 = sqrt(6.0)

# The coefficients of the methods, by their number of stages; the last node is the end of the step.
_TABLEAUS = {
    1: np.array([[1.0]]),
    2: np.array([[5 / 12, -1 / 12], [3 / 4, 1 / 4]]),
    3: np.array(
        [
            [(88 - 7 * _S6) / 360, (296 - 169 * _S6) / 1800, (-2 + 3 * _S6) / 225],
            [(296 + 169 * _S6) / 1800, (88 + 7 * _S6) / 360, (-2 - 3 * _S6) / 225],
            [(16 - _S6) / 36, (16 + _S6) / 36, 1 / 9],
        ]
    ),
}


@dataclass(frozen=True)
class _Radau(Integrator):
    """Common base of both Radau IIA methods."""

    solves_per_step: ClassVar[float] = 12
    a_at = "end"
    keeps_constraints: ClassVar[bool] = True
    uses_torque_jacobian: ClassVar[bool] = True

    stages: int = 2

    def __post_init__(self) -> None:
        if not is_whole(self.stages) or self.stages not in _TABLEAUS:
            raise InvalidArgument(f"stages = {self.stages!r}: 1, 2 or 3")


@dataclass(frozen=True)
class RadauIIA(_Radau):
    """Radau IIA at the position level (index 3), in the coordinates y and V of a step (`Manifold`).

    Y_i = dt sum_j A_ij Y_j',    V_i = v0 + dt sum_j A_ij V_j',    c(Q_i) = 0,
    M(Q_i) a_i + h(Q_i, v_i) = tau + J(Q_i)^T lam_i

    The order is 2 s - 1 for q, s for v and s - 1 for lam with s stages (Hairer, Lubich, Roche; for
    all s Jay). One stage is implicit Euler, whose orders are 1 from the second step on: a and lam
    of the first, also of that after an event, are wrong by a part that no dt makes smaller.
    Newton's iteration with one matrix a step, of size s (nv + m), in which the derivatives of
    Newton-Euler's equations, of springs, damping and torques of a function are: for stiff systems.

    Parameters
    ----------
    stages : int
        1 (implicit Euler), 2 or 3.

    References
    ----------
    Hairer, Lubich, Roche. The Numerical Solution of Differential-Algebraic Systems by Runge-Kutta
    Methods. Springer, 1989.
    Jay. Convergence of Runge-Kutta methods for differential-algebraic systems of index 3. Applied
    Numerical Mathematics 17, 1995.
    """

    title: ClassVar[str] = "Radau IIA, index 3"
    use: ClassVar[str] = "to compare: with the second multiplier v and lam are better"
    needs_positions: ClassVar[bool] = True

    @property
    def order(self) -> Order:
        """2 s - 1, s and s - 1; all are 1 with one stage."""
        s = self.stages
        return Order(2 * s - 1, s, max(s - 1, 1))

    def start(self, system: System, dt: float) -> Stepper:
        """Return this integrator at work on `system`."""
        return _stepper(system, dt, self.stages, self.title, stabilised=False)


@dataclass(frozen=True)
class GearGuptaLeimkuhler(_Radau):
    """Radau IIA with a second multiplier, so that both levels hold (index 2).

    q' = v + M^-1 J^T mu,    c(q) = 0,    J v = 0

    at every stage of `RadauIIA`; mu is zero but for the error of the step. The order is 2 s - 1 for
    q and v, and s for lam: that of Radau IIA at index 2 (Hairer, Wanner, section VII.4).

    Parameters
    ----------
    stages : int
        1 (implicit Euler), 2 or 3.

    References
    ----------
    Gear, Leimkuhler, Gupta. Automatic integration of Euler-Lagrange equations with constraints.
    Journal of Computational and Applied Mathematics 12-13, 1985.
    Hairer, Wanner. Solving Ordinary Differential Equations II. Springer, 1996, sections VII.1 and
    VII.4.
    """

    title: ClassVar[str] = "Radau IIA, GGL"
    use: ClassVar[str] = "for stiff systems with loops that stay closed at both levels"

    @property
    def order(self) -> Order:
        """2 s - 1, 2 s - 1 and s."""
        s = self.stages
        return Order(2 * s - 1, 2 * s - 1, s)

    def start(self, system: System, dt: float) -> Stepper:
        """Return this integrator at work on `system`."""
        return _stepper(system, dt, self.stages, self.title, stabilised=True)


def _stepper(system: System, dt: float, s: int, title: str, *, stabilised: bool) -> Stepper:
    residuals, A = Residuals(system), _TABLEAUS[s]
    nodes, n, m = A.sum(axis=1), system.model.nv, system.scene.rows
    from_velocities = np.linalg.inv(dt * A)
    from_gaps = from_velocities @ from_velocities
    forces, manifold = [np.zeros(0)], system.manifold
    # a row of velocities alone leaves no gap for the second multiplier to close
    placed = [row for bound in system.scene.bounds for row in bound.positioned]

    def step(t: float, q: Array, v: Array) -> tuple[Array, Array, Array]:
        residuals.begin(q)
        a0 = system.acceleration(t, q, v)
        A0 = manifold.straight(v, a0)
        # a is V'
        a, lam, mu = np.tile(A0, (s, 1)), np.tile(system.lam(), (s, 1)), np.zeros((s, len(placed)))
        Y, Q, own, of_own = np.outer(dt * nodes, v), [q] * s, [v] * s, [a0] * s
        middle = manifold.place(q, dt / 2 * v, v + dt / 2 * A0)
        of = residuals.partials(t + dt / 2, *middle, a0, lam[0])
        newton = _newton(of, A, dt, residuals.damping)
        pull, hold = _second_multiplier(of.M, of.J[placed], residuals.damping)

        def iteration() -> float:
            nonlocal a, lam, mu, Y, Q, own, of_own
            V = v + dt * A.dot(a)
            moving = V + mu.dot(pull) if stabilised else V
            rates = [manifold.rate(*pair) for pair in zip(Y, moving, strict=True)]
            before, Y = Y, dt * A.dot(rates)
            Q = [manifold.integrate(q, y) for y in Y]
            own = [manifold.own(*pair) for pair in zip(Y, V, strict=True)]
            of_own = [manifold.of_own(*each) for each in zip(Y, own, a, strict=True)]
            left = [
                residuals.at(t + nodes[i] * dt, Q[i], own[i], of_own[i], lam[i]) for i in range(s)
            ]
            gaps = np.array([each.c for each in left])
            if stabilised:
                velocities = np.array([each.velocity for each in left])
                wanted = from_velocities.dot(velocities)
            else:
                wanted = from_gaps.dot(gaps)
            rhs = np.hstack([[each.r for each in left], wanted])
            change = newton.dot(rhs.ravel()).reshape(s, n + m)
            moved = [manifold.of_start(*pair) for pair in zip(Y, change[:, :n], strict=True)]
            a, lam = a - moved, lam - change[:, n:]
            if stabilised:
                mu = mu - (from_velocities.dot(gaps) - velocities)[:, placed].dot(hold)
            largest = dt**2 * np.abs(change[:, :n]).max()
            return float(max(np.abs(Y - before).max(), largest, np.abs(gaps).max(initial=0)))

        fixed_point_iteration(iteration, title, t, dt, system.size(q))
        forces[0] = lam[-1]
        return Q[-1], own[-1], of_own[-1]

    return Stepper(system.retried(step), lambda: forces[0])


def _newton(of: Partials, A: Array, dt: float, damping: float) -> Array:
    """Return the inverse of the matrix of all stages, its rows of c divided by dt^2 A^2."""
    (m, n), s = of.J.shape, len(A)
    saddle = np.block([[of.M, -of.J.T], [of.J, damping * np.eye(m)]])
    by_state = np.zeros((2, n + m, n + m))
    by_state[0, :n, :n], by_state[1, :n, :n] = of.r_v, of.r_q
    whole = np.kron(np.eye(s), saddle)
    whole += np.kron(dt * A, by_state[0]) + np.kron(dt**2 * A @ A, by_state[1])
    return inverse(whole)


def _second_multiplier(M: Array, J: Array, damping: float) -> tuple[Array, Array]:
    """M^-1 J^T, transposed (k, nv), by which mu moves q, and (J M^-1 J^T)^-1 (k, k)."""
    Y: Array = np.asarray(np.linalg.solve(M, J.T), dtype=np.float64)
    return Y.T, inverse(J @ Y + damping * np.eye(len(J)))
