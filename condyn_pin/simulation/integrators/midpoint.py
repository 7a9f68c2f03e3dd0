"""The midpoint rule, by an iteration to its end and by one solve a step."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.simulation.integrators.integrator import (
    Integrator,
    Order,
    Stepper,
    fixed_point_iteration,
)
from condyn_pin.simulation.system import System


@dataclass(frozen=True)
class ImplicitMidpoint(Integrator):
    """The midpoint rule, symmetric in time.

    v_m = v0 + dt/2 a_m,    a_m = a(t0 + dt/2, q0 exp(dt/2 v_m), v_m)
    v1  = v0 + dt a_m,      q1 = q0 exp(dt v_m)

    In the coordinates of a step, where floating bodies go straight (`Manifold`). Solved by an
    iteration on a_m in which the robot's springs and damping may be stiff, and torques
    of a function too (`System.iterated`); all else has to change little in a step. The constraints
    are held by accelerations and drift.

    References
    ----------
    Hairer, Lubich, Wanner. Geometric Numerical Integration. Springer, 2006, chapter V.
    """

    title: ClassVar[str] = "implicit midpoint"
    order: ClassVar[Order] = Order(2, 2, 2)
    solves_per_step: ClassVar[float] = 7
    use: ClassVar[str] = "a symmetric method, for trees"
    damps_implicitly: ClassVar[bool] = True
    uses_torque_jacobian: ClassVar[bool] = True

    def start(self, system: System, dt: float) -> Stepper:
        """Return this integrator at work on `system`."""
        acceleration, manifold, half = system.acceleration, system.manifold, dt / 2
        middle = _StepMiddle(system, dt)

        def step(t: float, q: Array, v: Array) -> tuple[Array, Array, Array]:
            a = acceleration(t, q, v)
            A = manifold.straight(v, a)

            def iteration() -> float:
                nonlocal A
                found = middle.improved(t, q, v, A)
                change, A = found - A, found
                return dt**2 * float(np.abs(change).max())

            fixed_point_iteration(iteration, self.title, t, dt, system.size(q))
            return *manifold.place(q, dt * (v + half * A), v + dt * A), a

        return Stepper(middle.system.retried(step))


@dataclass(frozen=True)
class LinearlyImplicitMidpoint(Integrator):
    """Order 2 with one solve per step, however stiff springs and damping are.

    v_m = v0 + dt/2 a_before,    q_m = q0 exp(dt/2 v_m)
    (M + dt/2 D + dt^2/4 K) (a_m - a_before) = f(t0 + dt/2, q_m, v_m) - M a_before + J^T lam
    v1 = v0 + dt a_m,            q1 = q0 exp(dt (v0 + dt/2 a_m))

    with M, J and all forces f, springs and damping among them, at (q_m, v_m), in the coordinates of
    a step (`Manifold`). It is
    `ImplicitMidpoint` with one iteration that begins with the a_m of the step before: a_before is
    wrong by order dt, v_m by order dt^2, and so is what depends on it. Springs and damping are
    linear, so that the one iteration solves for them exactly: they do not limit dt. The first
    step has two iterations, and begins with zero: of an a(t0, q0, v0) that stiff damping ends at
    once, dt/2 would be a velocity that nothing has.

    A torque function counts as springs and dampers if its derivatives are known: those that you
    pass, or differences if it is stiff at the start. Otherwise it follows the function up to omega
    dt = 1.4, which it damps a little, and d dt = m. With `Baumgarte` a step is one solve; a
    projection needs another one at its end.

    References
    ----------
    Ascher, Ruuth, Wetton. Implicit-explicit methods for time-dependent partial differential
    equations. SIAM Journal on Numerical Analysis 32, 1995.
    """

    title: ClassVar[str] = "linearly implicit midpoint"
    order: ClassVar[Order] = Order(2, 2, 2)
    solves_per_step: ClassVar[float] = 1
    use: ClassVar[str] = "order 2 for one solve a step, with stiff springs and damping"
    damps_implicitly: ClassVar[bool] = True
    uses_torque_jacobian: ClassVar[bool] = True

    def start(self, system: System, dt: float) -> Stepper:
        """Return this integrator at work on `system`."""
        manifold, middle = system.manifold, _StepMiddle(system, dt)
        h, half = np.array(dt), np.array(dt / 2)  # numpy multiplies by these faster than by floats
        before: Array | None = None  # V' in the middle of the step before, in the axes of its end

        def step(t: float, q: Array, v: Array) -> tuple[Array, Array, Array]:
            nonlocal before
            if before is None:
                middle.system.difference_if_stiff(t, q, v)
                before = middle.improved(t, q, v, np.zeros(len(v)))
            A = middle.improved(t, q, v, before)
            y = h * (v + half * A)
            before = manifold.own(y, A)
            return *manifold.place(q, y, v + h * A), middle.a

        return Stepper(step)


class _StepMiddle:
    """The middle of a step: V' there, from a V' that is nearly it."""

    def __init__(self, system: System, dt: float) -> None:
        self._manifold, self._half = system.manifold, np.array(dt / 2)
        self.a = np.zeros(0)  # (nv,) the last acceleration found, in the axes of the middle
        # whose springs and damping act where the iteration ends
        self.system = system.iterated(dt / 2, lambda: self.a)

    def improved(self, t: float, q: Array, v: Array, A: Array) -> Array:
        """Return the V' of a solve at the place and with the velocity that A leads to."""
        manifold, half = self._manifold, self._half
        V = v + half * A
        y = half * V
        q, v = manifold.place(q, y, V)
        self.a = manifold.of_own(y, v, A)
        self.a = self.system.acceleration(t + half.item(), q, v)
        return manifold.carried(y, v, self.a)
