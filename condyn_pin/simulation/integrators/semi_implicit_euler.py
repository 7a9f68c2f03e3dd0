"""SemiImplicitEuler: the velocity first, the configuration with the new velocity."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.simulation.integrators.base import Integrator, Order, Stepper

if TYPE_CHECKING:
    from condyn_pin.simulation.system import System


@dataclass(frozen=True)
class SemiImplicitEuler(Integrator):
    """The step of most simulators.

    v1 = v0 + dt a(t0, q0, v0),    q1 = integrate(q0, dt v1)

    Symplectic where the forces depend on q alone and M is constant; not together with constraints
    that are held by accelerations, nor where M changes.

    Parameters
    ----------
    implicit : bool
        Whether the robot's springs and damping act with q1 and v1 (`System.implicit`), and torques
        of a function that brings its `jacobian`. By default they do, as in MuJoCo: the damping of a
        light rod asks for a dt of microseconds otherwise. Where there are any, samples have
        (v1 - v0) / dt as a, and the lam that belongs to it: the mean over the step, not what
        `solve` says of its beginning.

    References
    ----------
    Hairer, Lubich, Wanner. Geometric Numerical Integration. Springer, 2006, section I.1.
    """

    title: ClassVar[str] = "semi-implicit Euler"
    order: ClassVar[Order] = Order(1, 1, 1)
    symplectic: ClassVar[bool] = False
    solves_per_step: ClassVar[float] = 1
    use: ClassVar[str] = "for the cheapest step, and to compare with other simulators"

    implicit: bool = True

    @property
    def takes_jacobian(self) -> bool:
        """Whether torques of a function act at the end of the step, if their slopes are known."""
        return self.implicit

    @property
    def takes_stiff_damping(self) -> bool:
        """Whether it acts at the end of the step."""
        return self.implicit

    def start(self, system: System, dt: float) -> Stepper:
        """Return this integrator at work on `system`."""
        if self.implicit:
            system = system.implicit(dt)
        acceleration, integrate = system.acceleration, system.integrate
        h = np.array(dt)  # numpy multiplies by an array faster than by a float

        def step(t: float, q: Array, v: Array) -> tuple[Array, Array, Array]:
            a = acceleration(t, q, v)
            v1 = v + h * a
            return integrate(q, h * v1), v1, a

        return Stepper(step, system=system)
