"""The wall of Baumgarte's method: gains with which an integrator makes a gap grow.

In continuous time every c'' + 2 alpha c' + beta^2 c = 0 decays. A step of an integrator maps
(c, c') by a matrix that depends on alpha dt and beta dt, and the gap grows once an eigenvalue of it
leaves the unit circle: for alpha = beta at alpha dt = 2 (explicit Euler), 2 sqrt(2) - 2 = 0.828
(semi-implicit Euler), 2.785 (Runge-Kutta 4). The integrator itself is asked for the matrix.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from condyn_pin.arrays import Array
from condyn_pin.drift import Baumgarte
from condyn_pin.errors import InvalidArgument
from condyn_pin.simulation.integrators.base import Integrator

# Critical gains are searched up to here [1]; no explicit method of few stages comes that far.
_FARTHEST = 100.0

# An eigenvalue on the circle is there up to rounding: gains of zero are no fault.
_ON_THE_CIRCLE = 1e-9


class _Gap:
    """c'' = -2 alpha c' - beta^2 c, as an integrator sees a system."""

    def __init__(self, alpha: float, beta: float) -> None:
        self._Kd, self._Kp = 2 * alpha, beta**2

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        return -self._Kd * v - self._Kp * q

    def integrate(self, q: Array, dv: Array) -> Array:
        return q + dv

    def rate(self, theta: Array, v: Array) -> Array:
        return v

    def lam(self) -> Array:
        return np.zeros(0)


def growth(integrator: Integrator, alpha_dt: float, beta_dt: float) -> float:
    """Return the factor by which one step makes a gap grow in the long run: the spectral radius.

    Parameters
    ----------
    integrator : Integrator
        One that asks for accelerations only.
    alpha_dt, beta_dt : float
        Gains times dt [1].
    """
    gap: Any = _Gap(alpha_dt, beta_dt)
    columns = []
    for c, slip in ((1.0, 0.0), (0.0, 1.0)):
        q, v, _ = integrator.start(gap, 1.0).step(0.0, np.array([c]), np.array([slip]))
        columns.append([q[0], v[0]])
    return float(np.abs(np.linalg.eigvals(np.transpose(columns))).max())


@cache
def wall(integrator: Integrator) -> float:
    """Return the largest alpha dt of critical damping, alpha = beta, that is stable [1]."""
    low, high = 0.0, _FARTHEST
    while high - low > 1e-9:
        middle = (low + high) / 2
        if growth(integrator, middle, middle) > 1.0:
            high = middle
        else:
            low = middle
    return low


def check_wall(integrator: Integrator, drift: Baumgarte, dt: float) -> None:
    """Refuse gains beyond the wall of an integrator."""
    by = growth(integrator, drift.alpha * dt, drift.beta * dt)
    if by > 1.0 + _ON_THE_CIRCLE:
        limit = wall(integrator) / dt
        raise InvalidArgument(
            f"drift = {drift!r}: with {integrator.title} and dt = {dt:g} s a gap grows by "
            f"{by:.3g} a step; alpha = beta = {limit:.4g} 1/s is the wall, and a third of it "
            f"leaves room: Baumgarte.critical({limit / 3:.3g})"
        )
