"""Explicit methods: what a step needs is known at its start. All hold rows by accelerations.

Their equations are in the coordinates y and V of a step, and a stands for V' there (`Manifold`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.simulation.integrators.integrator import Integrator, Order, Stepper
from condyn_pin.simulation.system import System


@dataclass(frozen=True)
class ExplicitEuler(Integrator):
    """Explicit Euler, the simplest method: oscillations gain energy at any dt.

    v1 = v0 + dt a(t0, q0, v0),    q1 = integrate(q0, dt v0)

    References
    ----------
    Hairer, Lubich, Wanner. Geometric Numerical Integration. Springer, 2006. Section I.1.
    """

    title: ClassVar[str] = "explicit Euler"
    order: ClassVar[Order] = Order(1, 1, 1)
    solves_per_step: ClassVar[float] = 1
    use: ClassVar[str] = "to compare with; semi-implicit Euler costs the same and is better"

    def start(self, system: System, dt: float) -> Stepper:
        """Return this integrator at work on `system`."""
        acceleration, manifold = system.acceleration, system.manifold

        def step(t: float, q: Array, v: Array) -> tuple[Array, Array, Array]:
            a = acceleration(t, q, v)
            return *manifold.place(q, dt * v, v + dt * manifold.straight(v, a)), a

        return Stepper(step)


@dataclass(frozen=True)
class SemiImplicitEuler(Integrator):
    """Semi-implicit Euler, the step of most simulators.

    v1 = v0 + dt a(t0, q0, v0),    q1 = integrate(q0, dt v1)

    Symplectic where the forces depend on q alone and M is constant; not together with constraints
    that are held by accelerations, nor where M changes.

    Parameters
    ----------
    implicit : bool
        Whether the robot's springs and damping act with q1 and v1 (`System.implicit`), and torques
        of a function that brings its `jacobian`. By default they do, as in MuJoCo: the damping of a
        light rod needs a dt of microseconds otherwise. Where there are any, samples have
        (v1 - v0) / dt as a, and the lam that belongs to it: the mean over the step, not what
        `solve` says of its beginning.

    References
    ----------
    Hairer, Lubich, Wanner. Geometric Numerical Integration. Springer, 2006, section I.1.
    """

    title: ClassVar[str] = "semi-implicit Euler"
    order: ClassVar[Order] = Order(1, 1, 1)
    solves_per_step: ClassVar[float] = 1
    use: ClassVar[str] = "for the cheapest step, and to compare with other simulators"

    implicit: bool = True

    @property
    def uses_torque_jacobian(self) -> bool:
        """True if torques of a function act at the end of the step, given their derivatives."""
        return self.implicit

    @property
    def damps_implicitly(self) -> bool:
        """True if joint damping acts at the end of the step, and does not limit dt."""
        return self.implicit

    def start(self, system: System, dt: float) -> Stepper:
        """Return this integrator at work on `system`."""
        if self.implicit:
            system = system.implicit(dt)
        acceleration, manifold = system.acceleration, system.manifold
        h = np.array(dt)  # numpy multiplies by an array faster than by a float

        def step(t: float, q: Array, v: Array) -> tuple[Array, Array, Array]:
            a = acceleration(t, q, v)
            V1 = v + h * manifold.straight(v, a)
            return *manifold.place(q, h * V1, V1), a

        return Stepper(step, system=system)


@dataclass(frozen=True)
class StormerVerlet(Integrator):
    """Velocity Verlet, with accelerations that may depend on the velocity.

    v_h = v0 + dt/2 a(t0, q0, v0),      q1 = q0 exp(dt v_h)
    v1  = v_h + dt/2 a(t1, q1, v_h + dt/2 a(t0, q0, v0))

    Symplectic only if M is constant and forces do not depend on v, as for particles; otherwise use
    `Rattle`.

    References
    ----------
    Hairer, Lubich, Wanner. Geometric numerical integration illustrated by the Störmer-Verlet
    method. Acta Numerica 12, 2003.
    """

    title: ClassVar[str] = "Störmer-Verlet"
    order: ClassVar[Order] = Order(2, 2, 2)
    solves_per_step: ClassVar[float] = 2
    use: ClassVar[str] = "order 2 for two solves"

    def start(self, system: System, dt: float) -> Stepper:
        """Return this integrator at work on `system`."""
        acceleration, manifold, half = system.acceleration, system.manifold, dt / 2

        def step(t: float, q: Array, v: Array) -> tuple[Array, Array, Array]:
            a = acceleration(t, q, v)
            kick = half * manifold.straight(v, a)
            V_half = v + kick
            y = dt * V_half
            q1, v_end = manifold.place(q, y, V_half + kick)
            A1 = manifold.carried(y, v_end, acceleration(t + dt, q1, v_end))
            return q1, manifold.own(y, V_half + half * A1), a

        return Stepper(step)


@dataclass(frozen=True)
class Leapfrog(Integrator):
    """Leapfrog: order 2 with one solve per step, by the acceleration of the step before.

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
    solves_per_step: ClassVar[float] = 1
    use: ClassVar[str] = "order 2 for one solve a step, where neither springs nor damping are stiff"

    def start(self, system: System, dt: float) -> Stepper:
        """Return this integrator at work on `system`."""
        acceleration, manifold = system.acceleration, system.manifold
        h, half = np.array(dt), np.array(dt / 2)  # numpy multiplies by these faster than by floats
        before: Array | None = None  # V' of the step before, in the axes of its end

        def step(t: float, q: Array, v: Array) -> tuple[Array, Array, Array]:
            nonlocal before
            a = acceleration(t, q, v)
            A = manifold.straight(v, a)
            kick = half * A
            V_half = v + kick if before is None else v + (A - 0.5 * before) * h
            y = h * V_half
            before = manifold.own(y, A)
            return *manifold.place(q, y, V_half + kick), a

        return Stepper(step)


@dataclass(frozen=True)
class RungeKutta4(Integrator):
    """The classic Runge-Kutta method, in the coordinates of a step.

    x' = U,    theta' = Jr(theta)^-1 w,    U' = E (a_u + w x u),    w' = a_w

    Four stages. In these coordinates it keeps its order 4 on free-flyers and balls, where averaging
    the velocities of the stages would have order 2, and the flight of a ball has nothing to do with
    its spin.

    References
    ----------
    Munthe-Kaas. High order Runge-Kutta methods on manifolds. Applied Numerical Mathematics 29,
    1999.
    """

    title: ClassVar[str] = "Runge-Kutta 4"
    order: ClassVar[Order] = Order(4, 4, 4)
    solves_per_step: ClassVar[float] = 4
    use: ClassVar[str] = "by default: the least error for its time where motion is smooth"

    def start(self, system: System, dt: float) -> Stepper:
        """Return this integrator at work on `system`."""
        acceleration, slope, manifold = system.acceleration, system.slope, system.manifold
        later, floats, integrate = dt / 2, manifold.floats, system.integrate
        # numpy multiplies by arrays faster than by floats
        h, half, sixth, two = (np.array(x) for x in (dt, dt / 2, dt / 6, 2.0))

        def step(t: float, q: Array, v: Array) -> tuple[Array, Array, Array]:
            a = acceleration(t, q, v)
            A1 = manifold.straight(v, a) if floats else a
            r2, A2 = slope(t + later, q, half * v, v + half * A1)
            r3, A3 = slope(t + later, q, half * r2, v + half * A2)
            r4, A4 = slope(t + dt, q, h * r3, v + h * A3)
            y = sixth * (v + two * (r2 + r3) + r4)
            V = v + sixth * (A1 + two * (A2 + A3) + A4)
            q1, v1 = manifold.place(q, y, V) if floats else (integrate(q, y), V)
            return q1, v1, a

        return Stepper(step)
