"""The stability limit of Baumgarte's method: gains that are too large for a step.

With a_ref a gap obeys c'' + 2 alpha c' + beta^2 c = 0. An integrator makes of that a linear map of
(c, c') in each step, and a gap shrinks only while the eigenvalues of this map are inside the unit
circle. For alpha = beta that is

    explicit Euler        alpha dt < 2
    semi-implicit Euler   alpha dt < 2 sqrt(2) - 2 = 0.828
    Runge-Kutta 4         alpha dt < 2.785

and for any other integrator and gains the map is measured, by letting it step. At the limit itself
no gap shrinks, so that gains have to be below it by more than rounding.

References
----------
Ascher, Chin, Petzold, Reich. Stabilization of constrained mechanical systems with DAEs and
invariant manifolds. Mechanics of Structures and Machines 23, 1995.
"""

from __future__ import annotations

from collections.abc import Callable
from math import inf
from typing import Any, cast

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.baumgarte import Baumgarte
from condyn_pin.errors import InvalidArgument, StepFailed
from condyn_pin.simulation.integrators.base import Integrator
from condyn_pin.simulation.manifold import Manifold
from condyn_pin.simulation.system import Step, System

# A gap that grows by less a step is one that does not move: alpha = 0 or beta = 0.
_GROWS = 1e-9

# How far a step has to be below the limit, as a share of it: dt is a quotient, and gains are typed.
_MARGIN = 1e-6

# Steps that a map of two states is told from, and the share of |A|^2 up to which a second step is
# that of an integrator that remembers nothing.
_STEPS = 4
_SAME = 1e-10


def _slider() -> Any:
    """Return the model of one slider."""
    model = pin.Model()
    model.addJoint(0, pin.JointModelPX(), pin.SE3.Identity(), "gap")
    return model


class _Gap:
    """What an integrator sees of one gap: q = c, v = c', the step being the unit of time.

    It is a system without springs, damping, torques or curved coordinates.
    """

    manifold = Manifold(_slider())

    def __init__(self, drift: Baumgarte, dt: float) -> None:
        self._Kp, self._Kd = drift.Kp * dt * dt, drift.Kd * dt

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        """Return c''."""
        return -self._Kd * v - self._Kp * q

    def integrate(self, q: Array, dq: Array) -> Array:
        """Return q moved by dq."""
        return q + dq

    def slope(self, t: float, q0: Array, y: Array, V: Array) -> tuple[Array, Array]:
        """Return y' and V'."""
        return V, self.acceleration(t, q0 + y, V)

    def implicit(self, dt: float) -> _Gap:
        """Return the same."""
        return self

    def iterated(self, dt: float, last: Callable[[], Array]) -> _Gap:
        """Return the same."""
        return self

    def retried(self, step: Step) -> Step:
        """Return the same."""
        return step

    def difference_if_stiff(self, t: float, q: Array, v: Array) -> None:
        """Do nothing."""

    def size(self, q: Array) -> float:
        """Return how large its numbers are."""
        return 1.0


def growth(integrator: Integrator, drift: Baumgarte, dt: float) -> float:
    """Return the factor by which a gap grows in a step: the spectral radius of its map.

    One step is linear in (c, c') at its start, and where the integrator remembers its last step, in
    those of the last two.
    """
    gap = cast("System", _Gap(drift, dt))
    try:
        with np.errstate(all="ignore"):  # what overflows has grown
            A = _map(integrator, gap)
    except StepFailed:  # an iteration that does not converge, here or in a run
        return inf
    return float(np.abs(np.linalg.eigvals(A)).max()) if np.isfinite(A).all() else inf


def _map(integrator: Integrator, gap: System) -> Array:
    """Return the map of one state to the next (2, 2), or of two states to the next two (4, 4)."""
    runs = _runs(integrator, gap, 2)
    A = runs[:, 1].T
    remembers = np.abs(runs[:, 2] - runs[:, 1] @ A.T).max() > _SAME * np.abs(A).max() ** 2
    if remembers and np.isfinite(runs := _runs(integrator, gap, _STEPS)).all():
        return _map_of_two(runs)
    return np.asarray(A)


def _map_of_two(runs: Array) -> Array:
    """Return the map (4, 4) of the states before and after a step to those of the next."""
    pairs = np.concatenate([runs[:, :-1], runs[:, 1:]], axis=2)
    before, after = (pairs[:, part].reshape(-1, 4) for part in (np.s_[:-1], np.s_[1:]))
    scale = np.abs(before).max(axis=1, keepdims=True)
    used = scale[:, 0] > 0
    return np.asarray(np.linalg.lstsq((before / scale)[used], (after / scale)[used], _SAME)[0])


def _runs(integrator: Integrator, gap: System, steps: int) -> Array:
    """Return (c, c') at the start and after each of some steps, from (1, 0) and from (0, 1)."""
    runs = []
    for start in np.eye(2):
        step, states = integrator.start(gap, 1.0).step, [start]
        for k in range(steps):
            q, v, _ = step(float(k), states[-1][:1], states[-1][1:])
            states.append(np.concatenate([q, v]))
        runs.append(states)
    return np.array(runs)


def stability_limit(integrator: Integrator, *, beta_per_alpha: float = 1.0) -> float:
    """Return the product alpha dt below which gaps shrink, to 1e-4; infinity if there is no end.

    The integrator holds constraints by accelerations; `beta_per_alpha` is 1 for critical damping.
    """
    if integrator.is_adaptive:
        return inf
    stable = 0.0
    for alpha in np.arange(1, 400) * 0.05:
        if is_beyond(integrator, Baumgarte(alpha, beta_per_alpha * alpha), 1.0):
            break
        stable = float(alpha)
    else:
        return inf
    unstable = stable + 0.05
    while unstable - stable > 1e-4:
        middle = (stable + unstable) / 2
        beyond = is_beyond(integrator, Baumgarte(middle, beta_per_alpha * middle), 1.0)
        stable, unstable = (stable, middle) if beyond else (middle, unstable)
    return stable


def is_beyond(integrator: Integrator, drift: Baumgarte, dt: float) -> bool:
    """Whether gains are at the stability limit of an integrator or beyond it."""
    return growth(integrator, drift, dt * (1 + _MARGIN)) > 1 + _GROWS


def check_stability_limit(integrator: Integrator, drift: Baumgarte, dt: float) -> None:
    """Refuse gains that are not below the stability limit of an integrator at dt."""
    if integrator.is_adaptive or not is_beyond(integrator, drift, dt):
        return
    grows, limit = growth(integrator, drift, dt), stability_limit(integrator, beta_per_alpha=1.0)
    what = f"every gap grows {grows:.3g} times a step" if grows > 1.001 else "no gap shrinks"
    raise InvalidArgument(
        f"drift = {drift!r}: with {integrator.title} and dt = {dt:g} s {what}; "
        f"alpha = beta is stable below {limit / dt:.4g} / s "
        f"(alpha dt < {limit:.4g}), and good at a tenth of that"
    )
