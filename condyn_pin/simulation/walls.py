"""The wall of Baumgarte's method: gains that are too large for a step.

With a_ref a gap obeys c'' + 2 alpha c' + beta^2 c = 0. An integrator makes of that a linear map of
(c, c') in each step, and a gap shrinks only while the eigenvalues of this map are inside the unit
circle. For alpha = beta that is

    explicit Euler        alpha dt < 2
    semi-implicit Euler   alpha dt < 2 sqrt(2) - 2 = 0.828
    Runge-Kutta 4         alpha dt < 2.785

and for any other integrator and gains the map is measured, by letting it step.

References
----------
Ascher, Chin, Petzold, Reich. Stabilization of constrained mechanical systems with DAEs and
invariant manifolds. Mechanics of Structures and Machines 23, 1995.
"""

from __future__ import annotations

from collections.abc import Callable
from math import inf
from typing import TYPE_CHECKING, cast

import numpy as np

from condyn_pin.arrays import Array
from condyn_pin.drift.baumgarte import Baumgarte
from condyn_pin.errors import InvalidArgument

if TYPE_CHECKING:
    from condyn_pin.simulation.integrators.base import Integrator
    from condyn_pin.simulation.system import System

# A gap that grows by less a step is one that does not move: alpha = 0 or beta = 0.
_GROWS = 1e-9


class _Gap:
    """What an integrator sees of one gap: q = c, v = c', the step being the unit of time."""

    def __init__(self, drift: Baumgarte, dt: float) -> None:
        self._Kp, self._Kd = drift.Kp * dt * dt, drift.Kd * dt

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        """Return c''."""
        return -self._Kd * v - self._Kp * q

    def integrate(self, q: Array, dv: Array) -> Array:
        """Return q moved along dv."""
        return q + dv

    def implicit(self, dt: float) -> _Gap:
        """Return the same: a gap has no springs and no damping of its own."""
        return self

    def iterated(self, dt: float, last: Callable[[], Array]) -> _Gap:
        """Return the same."""
        return self

    def size(self, q: Array) -> float:
        """Return how large its numbers are."""
        return 1.0

    def rate(self, theta: Array, v: Array) -> Array:
        """Return theta'."""
        return v


def growth(integrator: Integrator, drift: Baumgarte, dt: float) -> float:
    """Return the factor by which a gap grows in a step: the spectral radius of its map."""
    step = integrator.start(cast("System", _Gap(drift, dt)), 1.0).step
    with np.errstate(all="ignore"):  # what overflows has grown
        ends = [step(0.0, np.array([c]), np.array([u])) for c, u in ((1.0, 0.0), (0.0, 1.0))]
    columns = np.array([[q[0], v[0]] for q, v, _ in ends])
    if not np.isfinite(columns).all():
        return inf
    return float(np.abs(np.linalg.eigvals(columns.T)).max())


def wall(integrator: Integrator, *, beta_per_alpha: float = 1.0) -> float:
    """Return the product alpha dt below which gaps shrink, to 1e-4; infinity if there is no end.

    Parameters
    ----------
    integrator : Integrator
        One whose constraints are held by accelerations.
    beta_per_alpha : float
        1 for critical damping.
    """
    if integrator.is_adaptive:
        return inf
    stable = 0.0
    for alpha in np.arange(1, 400) * 0.05:
        if growth(integrator, Baumgarte(alpha, beta_per_alpha * alpha), 1.0) > 1 + _GROWS:
            break
        stable = float(alpha)
    else:
        return inf
    unstable = stable + 0.05
    while unstable - stable > 1e-4:
        middle = (stable + unstable) / 2
        grows = growth(integrator, Baumgarte(middle, beta_per_alpha * middle), 1.0) > 1 + _GROWS
        stable, unstable = (stable, middle) if grows else (middle, unstable)
    return stable


def check_wall(integrator: Integrator, drift: Baumgarte, dt: float) -> None:
    """Refuse gains that are beyond the wall of an integrator at dt."""
    if integrator.is_adaptive or not (grows := growth(integrator, drift, dt)) > 1 + _GROWS:
        return
    limit = wall(integrator, beta_per_alpha=1.0)
    raise InvalidArgument(
        f"drift = {drift!r}: with {integrator.title} and dt = {dt:g} s every gap grows {grows:.3g} "
        f"times a step; alpha = beta is stable below {limit / dt:.4g} / s "
        f"(alpha dt < {limit:.4g}), and good at a tenth of that"
    )
