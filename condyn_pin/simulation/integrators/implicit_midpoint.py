"""ImplicitMidpoint: the acceleration in the middle of the step, for all of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.simulation.integrators.base import Integrator, Order, Stepper
from condyn_pin.simulation.iteration import fixed_point_iteration

if TYPE_CHECKING:
    from condyn_pin.simulation.system import System


@dataclass(frozen=True)
class ImplicitMidpoint(Integrator):
    """The midpoint rule, symmetric in time.

    v_m = v0 + dt/2 a_m,    a_m = a(t0 + dt/2, q0 exp(dt/2 v_m), v_m)
    v1  = v0 + dt a_m,      q1 = q0 exp(dt v_m)

    Solved by an iteration on a_m in which the robot's springs and damping may be stiff, and torques
    of a function too (`System.iterated`); all else has to change little in a step. The constraints
    are held by accelerations and drift.

    References
    ----------
    Hairer, Lubich, Wanner. Geometric Numerical Integration. Springer, 2006, chapter V.
    """

    title: ClassVar[str] = "implicit midpoint"
    order: ClassVar[Order] = Order(2, 2, 2)
    symplectic: ClassVar[bool] = False
    solves_per_step: ClassVar[float] = 7
    use: ClassVar[str] = "a symmetric method, for trees"
    takes_stiff_damping: ClassVar[bool] = True
    takes_jacobian: ClassVar[bool] = True

    def start(self, system: System, dt: float) -> Stepper:
        """Return this integrator at work on `system`."""
        acceleration, integrate, half = system.acceleration, system.integrate, dt / 2
        a_middle = np.zeros(0)
        improved = system.iterated(half, lambda: a_middle)

        def step(t: float, q: Array, v: Array) -> tuple[Array, Array, Array]:
            nonlocal a_middle
            a = a_middle = acceleration(t, q, v)

            def iteration() -> float:
                nonlocal a_middle
                v_middle = v + half * a_middle
                found = improved.acceleration(t + half, integrate(q, half * v_middle), v_middle)
                change, a_middle = found - a_middle, found
                return dt**2 * float(np.abs(change).max())

            fixed_point_iteration(iteration, self.title, t, dt, system.size(q))
            return integrate(q, dt * (v + half * a_middle)), v + dt * a_middle, a

        return Stepper(improved.slopes.retried(step))
