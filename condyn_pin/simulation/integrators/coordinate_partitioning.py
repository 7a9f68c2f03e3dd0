"""CoordinatePartitioning: motion in independent coordinates, the others by the constraints."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from condyn_pin._core.arrays import Array, Indices
from condyn_pin._core.linalg import pivots
from condyn_pin.errors import StepFailed
from condyn_pin.simulation.integrators.integrator import (
    Integrator,
    Order,
    Stepper,
    fixed_point_iteration,
)
from condyn_pin.simulation.system import System

# Norm of what other columns of J leave of one that counts as nothing, as a share of the largest.
_NOTHING = 1e-9

# What the dependent velocities may be off from Runge's and Kutta's, as a share of the largest one:
# on the way of robots it is the error of a step, 1e-5 and less; across a dead point it is one. What
# is slower is at rest, and rounding [m/s, rad/s].
_JUMP = 0.1
_AT_REST = 1e-9

_WEIGHTS = np.array([1.0, 2.0, 2.0, 1.0]) / 6.0  # of Runge's and Kutta's stages


@dataclass(frozen=True)
class CoordinatePartitioning(Integrator):
    """Runge-Kutta 4 in the independent coordinates: an ordinary differential equation.

    y = (y_I, y_D) and V = (V_I, V_D) are the coordinates of a step (`Manifold`), D the largest
    independent columns of J, anew in every step. At each stage

        c(q) = 0 gives y_D,    J_D V_D = -J_I V_I gives V_D,    y_I' and V_I' are those of y and V.

    Both levels of the constraints hold at rounding, without gains and without projection: what is
    integrated are the nv - rank J degrees of freedom. Where a step passes a dead point of the
    chosen coordinates, Newton's iteration fails or velocities jump, which raises `StepFailed`.

    References
    ----------
    Wehage, Haug. Generalized coordinate partitioning for dimension reduction in analysis of
    constrained dynamic systems. Journal of Mechanical Design 104, 1982.
    """

    title: ClassVar[str] = "coordinate partitioning"
    order: ClassVar[Order] = Order(4, 4, 4)
    solves_per_step: ClassVar[float] = 12
    use: ClassVar[str] = "to compare: independent coordinates, closed at both levels"
    keeps_constraints: ClassVar[bool] = True
    needs_positions: ClassVar[bool] = True

    @property
    def damps_implicitly(self) -> bool:
        """True if joint damping does not limit dt; never, for the method is explicit."""
        return False

    def start(self, system: System, dt: float) -> Stepper:
        """Return this integrator at work on `system`."""
        manifold = system.manifold

        def step(t: float, q: Array, v: Array) -> tuple[Array, Array, Array]:
            chart = _Chart(system, q, t, dt)
            I = chart.independent  # noqa: E741
            a1 = system.acceleration(t, q, v)
            y, rates, slopes = np.zeros(len(v)), [v], [manifold.straight(v, a1)]
            for share in (0.5, 0.5, 1.0):
                now = t + share * dt
                y[I] = share * dt * rates[-1][I]
                at, V = chart.closed(now, y, v[I] + share * dt * slopes[-1][I])
                v_at = manifold.own(y, V)
                both = manifold.rates(y, V, v_at, system.acceleration(now, at, v_at))
                rates.append(both[0])
                slopes.append(both[1])
            mean, change = (_WEIGHTS @ np.array(each) for each in (rates, slopes))
            y[I] = dt * mean[I]
            q1, V = chart.closed(t + dt, y, v[I] + dt * change[I])
            _check_jump(t, dt, v, V, v + dt * change)
            return q1, manifold.own(y, V), a1

        return Stepper(step)


def _check_jump(t: float, dt: float, v: Array, v1: Array, smooth: Array) -> None:
    """Refuse a step at whose end J_D v_D = -J_I v_I is not where the accelerations lead."""
    jump = float(np.abs(v1 - smooth).max(initial=0.0))
    if jump > _JUMP * float(np.abs((v, v1)).max(initial=_AT_REST)):
        raise StepFailed(
            f"{CoordinatePartitioning.title} at t = {t + dt:g} s: the dependent velocities jump by "
            f"{jump:.1e} (m/s, rad/s), as at a dead point; take a smaller dt than {dt:g} s, or "
            "RungeKutta4()"
        )


class _Chart:
    """The coordinates y of one step, and which of them the others determine."""

    def __init__(self, system: System, q: Array, t: float, dt: float) -> None:
        self._system, self._q, self._t, self._dt = system, q, t, dt
        self._kept = system.kept_rows(q)
        self._J = J = self._kept(system.equations.jacobian(q))
        chosen, _ = pivots(J, _NOTHING * float(np.abs(J).max(initial=0.0)))
        self._dependent: Indices = np.array(sorted(chosen[: system.scene.nominal.rank]), dtype=int)
        self.independent: Indices = np.setdiff1d(np.arange(J.shape[1]), self._dependent)

    def closed(self, t: float, y: Array, V_I: Array) -> tuple[Array, Array]:
        """Return q and V at t; `y` keeps its independent part, the other one is written."""
        system, D, q = self._system, self._dependent, self._q

        def iteration() -> float:
            nonlocal q
            q = system.manifold.integrate(self._q, y)
            c, J = map(self._kept, system.equations.position_level(q))
            self._J = system.manifold.rows(J, y)
            y[D] -= _solved(self._J[:, D], c)
            return float(np.abs(c).max(initial=0.0))

        system.at(t)
        fixed_point_iteration(iteration, CoordinatePartitioning.title, t, self._dt, system.size(q))
        V = np.zeros(len(y))
        V[self.independent] = V_I
        wanted = self._kept(system.equations.wanted[1])
        V[D] = _solved(self._J[:, D], wanted - self._J @ V)
        return q, V


def _solved(A: Array, b: Array) -> Array:
    """Return x of A x = b with rows that may depend on one another."""
    return np.asarray(np.linalg.lstsq(A, b, rcond=None)[0]) if A.size else np.zeros(A.shape[1])
