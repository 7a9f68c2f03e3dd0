"""Rattle and Shake: the constraints hold at the end of each step, and energy does not drift."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.simulation.integrators.base import Integrator, Order, Stepper
from condyn_pin.simulation.iteration import fixed_point_iteration
from condyn_pin.simulation.momentum import Momentum, Place, between

if TYPE_CHECKING:
    from condyn_pin.simulation.system import System


# The iteration that knows J at the end of the step.
_SECOND = 2


@dataclass(frozen=True)
class Rattle(Integrator):
    """Störmer-Verlet's method with a multiplier for c(q1) = 0 and one for J v1 = 0.

    With f = C^T v - g + tau (`condyn_pin.simulation.momentum`),

        p_h = p0 + dt/2 (f(q0, M0^-1 p_h) + J0^T lam)
        q1  = q0 exp(dt/2 (M0^-1 p_h + M1^-1 p_h)),    c(q1) = 0
        p1  = p_h + dt/2 (f(q1, M1^-1 p_h) + J1^T mu), J1 M1^-1 p1 = 0

    Symplectic for coordinates that add up, and symmetric also on free-flyers and balls: the energy
    of a conservative system swings about a constant for as long as one looks. Implicit where M
    depends on q: an iteration, which asks that dt |v| is small. Damping of joints may be stiff, for
    half of it stands on the left; springs ask for dt sqrt(k / I) < 2, as in Verlet's method.

    References
    ----------
    Andersen. RATTLE: a "velocity" version of the SHAKE algorithm. Journal of Computational Physics
    52, 1983.
    Jay. Symplectic partitioned Runge-Kutta methods for constrained Hamiltonian systems. SIAM
    Journal on Numerical Analysis 33, 1996.
    """

    title: ClassVar[str] = "RATTLE"
    order: ClassVar[Order] = Order(2, 2, 2)
    symplectic: ClassVar[bool] = True
    solves_per_step: ClassVar[float] = 8
    use: ClassVar[str] = "over very long times, where energy may not drift"
    keeps_constraints: ClassVar[bool] = True
    needs_positions: ClassVar[bool] = True

    def start(self, system: System, dt: float) -> Stepper:
        """Return this integrator at work on `system`."""
        return _stepper(system, dt, self.title, hidden=True)


@dataclass(frozen=True)
class Shake(Integrator):
    """RATTLE's configurations with velocities that are not projected: J v1 is left as it is.

    References
    ----------
    Ryckaert, Ciccotti, Berendsen. Numerical integration of the Cartesian equations of motion of a
    system with constraints. Journal of Computational Physics 23, 1977.
    """

    title: ClassVar[str] = "SHAKE"
    order: ClassVar[Order] = Order(2, 2, 2)
    symplectic: ClassVar[bool] = True
    solves_per_step: ClassVar[float] = 8
    use: ClassVar[str] = "to compare: RATTLE costs no more"
    keeps_constraints: ClassVar[bool] = True
    needs_positions: ClassVar[bool] = True

    def start(self, system: System, dt: float) -> Stepper:
        """Return this integrator at work on `system`."""
        return _stepper(system, dt, self.title, hidden=False)


def _stepper(system: System, dt: float, title: str, *, hidden: bool) -> Stepper:
    momentum, half = Momentum(system, dt), dt / 2
    known: dict[int, tuple[Array, Place]] = {}  # what the last step found at its end

    def step(t: float, q: Array, v: Array) -> tuple[Array, Array, Array]:
        a = system.acceleration(t, q, v)
        lam = system.lam()
        found = known.get(id(q))
        place = found[1] if found else momentum.place(q)
        q1, p, v_end, lam = _first_half(system, momentum, dt, t, q, v, a, lam, place, title)
        end = momentum.place(q1)
        p = p + half * momentum.force(t + dt, q1, v_end)
        v1 = end.M_inv.dot(p)
        if hidden:
            v1 -= end.M_inv.dot(end.J.T.dot(end.G_inv.dot(end.J.dot(v1))))
            v1 -= end.M_inv.dot(end.J.T.dot(end.G_inv.dot(end.J.dot(v1))))
        else:  # the multiplier of the next step takes the place of this one's
            v1 += half * end.M_inv.dot(end.J.T.dot(lam))
        known.clear()
        known[id(q1)] = q1, end
        return q1, v1, a

    return Stepper(step)


def _first_half(
    system: System,
    momentum: Momentum,
    dt: float,
    t: float,
    q: Array,
    v: Array,
    a: Array,
    lam: Array,
    place: Place,
    title: str,
) -> tuple[Array, Array, Array, Array]:
    """Return q1, p_h, M1^-1 p_h and lam with c(q1) = 0."""
    half, D, p0 = dt / 2, place.D, place.M.dot(v)
    towards = place.Gd_inv / (half * dt)  # from a gap to lam
    left_to_do = iter(range(_SECOND, -1, -1))
    v_start = v_end = v + half * a
    p, q1 = p0, q

    def iteration() -> float:
        nonlocal p, v_start, v_end, q1, lam, towards
        if next(left_to_do, None) == 0:  # q1 is nearly known, and with it how lam moves it
            towards = between(system.equations.jacobian(q1), place.Md_inv, place.J) / (half * dt)
        p = p0 + half * (momentum.force(t, q, v_start) + D.dot(v_start) + place.J.T.dot(lam))
        v_start = place.Md_inv.dot(p)
        p = p - half * D.dot(v_start)
        v_end = momentum.velocity(system.integrate(q, half * (v_start + v_end)), p)
        before, q1 = q1, system.integrate(q, half * (v_start + v_end))
        c = system.equations.violation(q1)
        lam = lam - towards.dot(c)
        return max(float(np.abs(c).max(initial=0.0)), float(np.abs(q1 - before).max(initial=0.0)))

    fixed_point_iteration(iteration, title, t, dt, system.size(q))
    return q1, p, v_end, lam
