"""Iterations of implicit steps: to the last digit, or an error that says what would do.

    r = M a + h - tau - J^T lam,    c(q)

are what Newton's method takes to zero.

References
----------
Hairer, Wanner. Solving Ordinary Differential Equations II. Springer, 1996, chapter VII.
"""

from __future__ import annotations

from collections.abc import Callable
from math import isfinite
from typing import NamedTuple

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.trees import whole_data
from condyn_pin.errors import InvalidArgument, SolveFailed, StepFailed
from condyn_pin.simulation.system import System

# What is left with which an iteration may end once it stops to shrink, and below which nothing can
# be told from rounding: as shares of the numbers that a configuration is made of.
_SMALL = 1e-11
_ROUNDING = 1e-15

_MOST = 60

# What is added to the zero block, relative to the largest eigenvalue of J M^-1 J^T: redundant rows
# make the matrix singular without, and the iteration makes up for it.
_DAMPING = 1e-9


def fixed_point_iteration(
    iteration: Callable[[], float], title: str, t: float, dt: float, size: float
) -> None:
    """Iterate until what is left no longer halves in two iterations: some take turns.

    `iteration` improves on what it has, and returns what was left before [m, rad]; `size` is that
    of the numbers that are iterated on (`System.size`). StepFailed if it stops to converge too
    early.
    """
    small, rounding = _SMALL * size, _ROUNDING * size
    two_before = before = float("inf")
    count, why = 0, ""
    while count < _MOST:
        count += 1
        try:
            left = iteration()
        except SolveFailed:  # it has led to a state that no machine can have
            left = float("nan")
        except InvalidArgument as error:  # such as one that is not finite
            left, why = float("nan"), f" ({error})"
        if left <= rounding or (before < small and not left < two_before / 2):
            return
        two_before, before = before, left
        if not isfinite(left):
            break
    else:
        if before < small:
            return
    left_over = (
        f"{before:.1e} are left (m, rad)" if isfinite(before) else f"its numbers are lost{why}"
    )
    raise StepFailed(
        f"{title} at t = {t:g} s: after {count} iterations {left_over}; take a smaller dt than "
        f"{dt:g} s"
    )


class Residual(NamedTuple):
    """The residuals at one state, of which `velocity` says how fast c changes."""

    r: Array  # (nv,) [N, N m]
    c: Array  # (m,) [m, rad]
    J: Array  # (m, nv)
    velocity: Array  # (m,), J v - s' [m/s, rad/s]


class Partials(NamedTuple):
    """Their partial derivatives."""

    M: Array  # (nv, nv)
    J: Array  # (m, nv)
    r_q: Array  # (nv, nv)
    r_v: Array  # (nv, nv)


class Residuals:
    """The residuals of one system; `damping` belongs into the zero block of [[M, -J^T], [J, 0]]."""

    def __init__(self, system: System) -> None:
        self._system, self._model = system, system.model
        self._data = whole_data(system.model)
        self._kept: Callable[[Array], Array]
        self.damping = _DAMPING * system.scene.nominal.delassus_norm

    def begin(self, q: Array) -> None:
        """Begin a step at q: which rows it keeps (`System.kept_rows`)."""
        self._kept = self._system.kept_rows(q)

    def at(self, t: float, q: Array, v: Array, a: Array, lam: Array) -> Residual:
        """Return the residuals."""
        system, kept = self._system, self._kept
        system.at(t)
        c, J = map(kept, system.equations.position_level(q))
        bodies = pin.rnea(self._model, self._data, q, v, a)
        r = bodies - system.torque(t, q, v) - J.T.dot(lam)
        return Residual(r, c, J, J.dot(v) - kept(system.equations.wanted[1]))

    def partials(self, t: float, q: Array, v: Array, a: Array, lam: Array) -> Partials:
        """Return the partial derivatives, V' being constant where a = V' - w x u (`Manifold`).

        Torques applied count as constant without slopes.
        """
        system, n = self._system, len(v)
        of = system.workspace.linearisation.at(q, v, a, lam)
        r_q = of.r_q + system.passive.stiffness_matrix(q)
        r_v = system.passive.damping_matrix(q) - of.rhs[:n, n:]
        if system.applied.slopes_are_known:
            by_q, by_v = system.applied.slopes(t, q, v)
            r_q, r_v = r_q - by_q, r_v - by_v
        M = system.mass(q)
        if system.manifold.floats:
            r_v = r_v - M @ system.manifold.turning_by(v)
        return Partials(M, self._kept(of.J), r_q, r_v)
