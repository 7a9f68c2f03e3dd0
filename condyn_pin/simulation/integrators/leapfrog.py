"""Leapfrog: the configuration with the velocity in the middle of the step."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.simulation.integrators.base import Integrator, Order, Stepper

if TYPE_CHECKING:
    from condyn_pin.simulation.system import System


@dataclass(frozen=True)
class Leapfrog(Integrator):
    """Order 2 for one solve a step, with the acceleration at the start of the step before.

    a0 = a(t0, q0, v0),    v_h = v0 + dt (a0 - a_before / 2),    q1 = integrate(q0, dt v_h)
    v1 = v0 + dt (3 a0 - a_before) / 2 = v_h + dt a0 / 2

    Where accelerations depend on q alone, v_h is the last v_h + dt a0: the configurations are those
    of Störmer's method, and an oscillation neither gains nor loses energy up to omega dt = 2. The
    velocities, which a depends on in a machine, are those of Adams and Bashforth. The first step
    takes a0 for a_before.

    References
    ----------
    Hairer, Lubich, Wanner. Geometric numerical integration illustrated by the Störmer-Verlet
    method. Acta Numerica 12, 2003.
    """

    title: ClassVar[str] = "leapfrog"
    order: ClassVar[Order] = Order(2, 2, 2)
    symplectic: ClassVar[bool] = False
    solves_per_step: ClassVar[float] = 1
    use: ClassVar[str] = "order 2 for one solve a step, where neither springs nor damping are stiff"

    def start(self, system: System, dt: float) -> Stepper:
        """Return this integrator at work on `system`."""
        acceleration, integrate = system.acceleration, system.integrate
        h, half = np.array(dt), np.array(dt / 2)  # numpy multiplies by these faster than by floats
        before: Array | None = None

        def step(t: float, q: Array, v: Array) -> tuple[Array, Array, Array]:
            nonlocal before
            a = acceleration(t, q, v)
            kick = half * a
            v_half = v + kick if before is None else v + (a - 0.5 * before) * h
            before = a
            return integrate(q, h * v_half), v_half + kick, a

        return Stepper(step)
