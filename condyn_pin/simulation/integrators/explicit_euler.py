"""ExplicitEuler: everything from the start of the step."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from condyn_pin._core.arrays import Array
from condyn_pin.simulation.integrators.base import Integrator, Order, Stepper

if TYPE_CHECKING:
    from condyn_pin.simulation.system import System


@dataclass(frozen=True)
class ExplicitEuler(Integrator):
    """The simplest step: an oscillation gains energy at any dt.

    v1 = v0 + dt a(t0, q0, v0),    q1 = integrate(q0, dt v0)

    References
    ----------
    Hairer, Lubich, Wanner. Geometric Numerical Integration. Springer, 2006. Section I.1.
    """

    title: ClassVar[str] = "explicit Euler"
    order: ClassVar[Order] = Order(1, 1, 1)
    symplectic: ClassVar[bool] = False
    solves_per_step: ClassVar[float] = 1
    use: ClassVar[str] = "to compare with; semi-implicit Euler costs the same and is better"

    def start(self, system: System, dt: float) -> Stepper:
        """Return this integrator at work on `system`."""
        acceleration, integrate = system.acceleration, system.integrate

        def step(t: float, q: Array, v: Array) -> tuple[Array, Array, Array]:
            a = acceleration(t, q, v)
            return integrate(q, dt * v), v + dt * a, a

        return Stepper(step)
