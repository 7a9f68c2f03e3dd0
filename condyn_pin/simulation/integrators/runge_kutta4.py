"""RungeKutta4: the classic method of order 4, on the manifold of configurations."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.simulation.integrators.base import Integrator, Order, Stepper

if TYPE_CHECKING:
    from condyn_pin.simulation.system import System


@dataclass(frozen=True)
class RungeKutta4(Integrator):
    """Four stages in the coordinates theta of the step, q = integrate(q0, theta).

    theta' = Jr(theta)^-1 v,    v' = a(t, integrate(q0, theta), v)

    In these coordinates the classic method keeps its order 4 on free-flyers and balls, where
    averaging the velocities of the stages would have order 2.

    References
    ----------
    Munthe-Kaas. High order Runge-Kutta methods on manifolds. Applied Numerical Mathematics 29,
    1999.
    """

    title: ClassVar[str] = "Runge-Kutta 4"
    order: ClassVar[Order] = Order(4, 4, 4)
    symplectic: ClassVar[bool] = False
    solves_per_step: ClassVar[float] = 4
    use: ClassVar[str] = "by default: the least error for its time where motion is smooth"

    def start(self, system: System, dt: float) -> Stepper:
        """Return this integrator at work on `system`."""
        acceleration, slope, integrate = system.acceleration, system.slope, system.integrate
        later = dt / 2
        # numpy multiplies by arrays faster than by floats
        h, half, sixth, two = (np.array(x) for x in (dt, dt / 2, dt / 6, 2.0))

        def step(t: float, q: Array, v: Array) -> tuple[Array, Array, Array]:
            a1 = acceleration(t, q, v)
            r2, a2 = slope(t + later, q, half * v, v + half * a1)
            r3, a3 = slope(t + later, q, half * r2, v + half * a2)
            r4, a4 = slope(t + dt, q, h * r3, v + h * a3)
            q1 = integrate(q, sixth * (v + two * (r2 + r3) + r4))
            return q1, v + sixth * (a1 + two * (a2 + a3) + a4), a1

        return Stepper(step)
