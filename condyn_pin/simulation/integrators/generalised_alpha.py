"""GeneralisedAlpha: the method of structural dynamics, on Lie groups and with constraints."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from condyn_pin._core.arrays import Array, finite
from condyn_pin._core.linalg import inverse as inverse_of
from condyn_pin.errors import InvalidArgument
from condyn_pin.simulation.integrators.integrator import (
    Integrator,
    Order,
    Residuals,
    Stepper,
    fixed_point_iteration,
)
from condyn_pin.simulation.integrators.radau import RadauIIA
from condyn_pin.simulation.system import System

# Where the derivative of a is taken at the start, as a share of dt.
_NEAR = 1e-2

# After so many steps of Radau's method what is fast has died out, or is rounding.
_LONGEST = 5

# Accelerations below this share of the largest one do not say how fast accelerations change.
_SMALL = 1e-2


@dataclass(frozen=True)
class GeneralisedAlpha(Integrator):
    """Newmark's formulas with a lagging acceleration A, at the position level (index 3).

    q1 = q0 exp(dt v0 + dt^2 ((1/2 - beta) A0 + beta A1)),    c(q1) = 0
    v1 = v0 + dt ((1 - gamma) A0 + gamma A1)
    (1 - alpha_m) A1 + alpha_m A0 = (1 - alpha_f) a1 + alpha_f a0
    M(q1) a1 + h(q1, v1) = tau + J(q1)^T lam

    Newton's iteration with the derivatives of Newton-Euler's equations and of the robot's springs
    and damping, and with those of torques of a function: stiff ones need no small dt.
    Where a changes by more than itself within dt, as at a start that stiff damping is about to
    stop, Newmark's formulas would throw the machine by dt^2 a: such steps are those of `RadauIIA`,
    five at most.

    Parameters
    ----------
    rho : float
        What is left of the fastest oscillations after each step, from 0 to below 1. 0.8 damps what
        dt does not resolve, and little else. The error with which lam begins, of order 1, swings
        and dies out at this rate; at 1 it would grow with the number of steps, at any dt.

    Raises
    ------
    InvalidArgument
        If `rho` is not from 0 to below 1.

    References
    ----------
    Chung, Hulbert. A time integration algorithm for structural dynamics with improved numerical
    dissipation. Journal of Applied Mechanics 60, 1993.
    Arnold, Brüls, Cardona. Error analysis of generalized-alpha Lie group time integration methods
    for constrained mechanical systems. Numerische Mathematik 129, 2015.
    """

    title: ClassVar[str] = "generalised-alpha"
    order: ClassVar[Order] = Order(2, 2, 2)
    solves_per_step: ClassVar[float] = 5
    use: ClassVar[str] = "for stiff springs with closed loops"
    a_at = "end"
    keeps_constraints: ClassVar[bool] = True
    uses_torque_jacobian: ClassVar[bool] = True
    needs_positions: ClassVar[bool] = True

    rho: float = 0.8  # [1]

    def __post_init__(self) -> None:
        if not 0 <= finite("rho", self.rho, ()) < 1:
            raise InvalidArgument(f"rho = {self.rho!r}: from 0 to below 1")

    def start(self, system: System, dt: float) -> Stepper:
        """Return this integrator at work on `system`."""
        residuals = Residuals(system)
        alpha_m, alpha_f = (2 * self.rho - 1) / (self.rho + 1), self.rho / (self.rho + 1)
        gamma = 0.5 + alpha_f - alpha_m
        beta = 0.25 * (gamma + 0.5) ** 2
        share = (1 - alpha_f) / (1 - alpha_m)
        by_v, by_q = dt * gamma * share, dt**2 * beta * share
        manifold, n = system.manifold, system.model.nv
        known: list[tuple[Array, Array, Array]] = []  # q, a and A at the end of the last step
        forces = [np.zeros(0)]
        lag, passage = alpha_m - alpha_f, _Passage(system, dt)

        def step(t: float, q: Array, v: Array) -> tuple[Array, Array, Array]:
            residuals.begin(q)
            if known and known[0][0] is q:
                _, a0, A0 = known[0]
                lam = forces[0]
            else:
                a0, change, lam = _begin(system, t, q, v, dt)
                is_fast = _is_fast(a0, change)
                if is_fast and passage.is_open(q):
                    forces[0], found = passage.step(t, q, v)
                    return found
                A0 = manifold.straight(v, a0)
                if not is_fast:
                    A0 = A0 + lag * change
            start = end = manifold.straight(v, a0)
            q1, v1, a1, A1, y, inverse = q, v, a0, A0, np.zeros(n), np.zeros((0, 0))

            def iteration() -> float:
                nonlocal end, lam, q1, v1, a1, A1, y, inverse
                A1 = (share * end) + (alpha_f * start - alpha_m * A0) / (1 - alpha_m)
                y = dt * v + dt**2 * ((0.5 - beta) * A0 + beta * A1)
                q1, v1 = manifold.place(q, y, v + dt * ((1 - gamma) * A0 + gamma * A1))
                a1 = manifold.of_own(y, v1, end)
                if not len(inverse):
                    of = residuals.partials(t + dt, q1, v1, a1, lam)
                    top = of.M + by_v * of.r_v + by_q * of.r_q
                    bottom = [of.J, residuals.damping * np.eye(len(of.J))]
                    inverse = inverse_of(np.block([[top, -of.J.T], bottom]))
                left = residuals.at(t + dt, q1, v1, a1, lam)
                change = inverse.dot(np.concatenate([left.r, left.c / by_q]))
                end, lam = end - manifold.of_start(y, change[:n]), lam - change[n:]
                return max(by_q * float(np.abs(change[:n]).max()), _largest(left.c))

            fixed_point_iteration(iteration, self.title, t, dt, system.size(q))
            forces[0], known[:] = lam, [(q1, a1, manifold.own(y, A1))]
            return q1, v1, a1

        return Stepper(system.retried(step), lambda: forces[0])


class _Passage:
    """Steps of Radau's method through what is fast at a start, so many in a row at most."""

    def __init__(self, system: System, dt: float) -> None:
        self._stepper = RadauIIA().start(system, dt)
        self._end, self._count = np.zeros(0), 0  # where the last one ended, and which it was

    def is_open(self, q: Array) -> bool:
        """True if another step of Radau's method may begin at q."""
        if self._end is not q:
            self._count = 0
        return self._count < _LONGEST

    def step(self, t: float, q: Array, v: Array) -> tuple[Array, tuple[Array, Array, Array]]:
        """Return lam, and q, v and a, at the end of a step."""
        assert self._stepper.lam is not None
        found = self._stepper.step(t, q, v)
        self._end, self._count = found[0], self._count + 1
        return self._stepper.lam(), found


def _begin(system: System, t: float, q: Array, v: Array, dt: float) -> tuple[Array, Array, Array]:
    """Return a, dt a' and lam at a start: A is the acceleration at t + lag dt, up to dt^2."""
    a = system.acceleration(t, q, v)
    lam, near = system.lam(), _NEAR * dt
    manifold = system.manifold
    A = manifold.straight(v, a)
    y = near * v + near**2 / 2 * A
    moved, v_near = manifold.place(q, y, v + near * A)
    later = manifold.carried(y, v_near, system.acceleration(t + near, moved, v_near))
    return a, (later - A) / _NEAR, lam


def _is_fast(a: Array, change: Array) -> bool:
    """True if an acceleration changes by more than its own size within a step."""
    size = np.abs(a)
    return bool((np.abs(change) > size + _SMALL * size.max(initial=0.0)).any())


def _largest(x: Array) -> float:
    return float(np.abs(x).max(initial=0.0))
