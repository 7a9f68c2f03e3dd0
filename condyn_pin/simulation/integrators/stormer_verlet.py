"""StormerVerlet: half a kick, a drift, half a kick."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from condyn_pin._core.arrays import Array
from condyn_pin.simulation.integrators.base import Integrator, Order, Stepper

if TYPE_CHECKING:
    from condyn_pin.simulation.system import System


@dataclass(frozen=True)
class StormerVerlet(Integrator):
    """The velocity form, with accelerations that may depend on the velocity.

    v_h = v0 + dt/2 a(t0, q0, v0),      q1 = q0 exp(dt v_h)
    v1  = v_h + dt/2 a(t1, q1, v_h + dt/2 a(t0, q0, v0))

    Symplectic only where M and the forces do not depend on v, as for particles; `Rattle` is where
    they do.

    References
    ----------
    Hairer, Lubich, Wanner. Geometric numerical integration illustrated by the Störmer-Verlet
    method. Acta Numerica 12, 2003.
    """

    title: ClassVar[str] = "Störmer-Verlet"
    order: ClassVar[Order] = Order(2, 2, 2)
    symplectic: ClassVar[bool] = False
    solves_per_step: ClassVar[float] = 2
    use: ClassVar[str] = "order 2 for two solves"

    def start(self, system: System, dt: float) -> Stepper:
        """Return this integrator at work on `system`."""
        acceleration, integrate, half = system.acceleration, system.integrate, dt / 2

        def step(t: float, q: Array, v: Array) -> tuple[Array, Array, Array]:
            a = acceleration(t, q, v)
            kick = half * a
            v_half = v + kick
            q1 = integrate(q, dt * v_half)
            return q1, v_half + half * acceleration(t + dt, q1, v_half + kick), a

        return Stepper(step)
