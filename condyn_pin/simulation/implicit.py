"""Torques at the end of a step: springs, damping and the slopes of functions join the inertia.

    (M + X) a + h = tau + tau_ahead + J^T lam,    J a + gamma = a_ref,    X = -dt tau_v - dt^2 tau_q

A solver knows M, not X. With P the inverse inertia that the constraints leave, and a_free its
answer without X,

    (1 + P X) a = a_free,

and what it answers to the torques less X a has the same a, and the lam that belongs to it.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Final

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array
from condyn_pin._core.linalg import factorise, inverse
from condyn_pin.errors import StepFailed
from condyn_pin.simulation.passive import Passive
from condyn_pin.simulation.system import System, total_torque
from condyn_pin.simulation.torques import Torque

# Rates of torques, times dt, beyond which a step that takes them as they are is near its stability
# limit: 1 for damping and 2 for the square of a frequency in `LinearlyImplicitMidpoint`.
_STIFF: Final = 0.5

# Corrections of a where a solver gives way, and P is not its own: each leaves a share of the last.
_CORRECTIONS: Final = 20
_LEFT: Final = 1e-6


def implicit_system(system: System, dt: float) -> System:
    """Return the system whose springs and damping act at the end of a step of size dt.

    With v1 = v + dt a and q1 = q + dt v1 in the torques -D v1 - K (q1 - q0),

        (M + dt D + dt^2 K) a + h = tau - (D + dt K) v - K (q - q0) + J^T lam,

    which is stable however large D and K are. All of them share the memory of `System.spare`.
    Torques of a function that comes with its derivatives act there too.
    """
    applied, passive = system.applied, system.passive
    if not passive.is_nothing:
        system = _Heavier(system, dt, _torque_at_end(system, dt))
    return system if applied.jacobian is None else _WithSlopes(system, dt)


def iterated_system(system: System, dt: float, last: Callable[[], Array]) -> System:
    """Return the system of an iteration on a, where v changes with dt a and q with dt^2 a.

    Its solution is that of the system where a is the `last` one,

        (M + dt D + dt^2 K) a + h = tau - D v - K (q - q0) + (dt D + dt^2 K) last + J^T lam,

    and however large D and K are, they do not keep the iteration from it; nor do those of the
    torques of a function, once their slopes are known.
    """
    if not system.passive.is_nothing:
        system = _Heavier(system, dt, _torque_of_last(system, dt, last))
    return system if system.applied.constant is not None else _WithSlopes(system, dt, last)


def _torque_of_last(system: System, dt: float, last: Callable[[], Array]) -> Torque:
    """Return the torques with what the added inertia takes of the last a."""
    added = _added(system.passive, dt)

    def torque(t: float, q: Array, v: Array) -> Array:
        return system.torque(t, q, v) + added(q, last())

    return torque


def _torque_at_end(system: System, dt: float) -> Torque:
    """Return the torques at the end of a step, less those of the added inertia that a has too much.

    v1 = v + dt (a + w x u) in the axes that floating bodies have where the step begins.
    """
    torque, added = total_torque(system.applied, system.passive, dt), _added(system.passive, dt)
    if not system.manifold.floats:
        return torque

    def straight(t: float, q: Array, v: Array) -> Array:
        return torque(t, q, v) - added(q, system.manifold.turning(v))

    return straight


def _added(passive: Passive, dt: float) -> Callable[[Array, Array], Array]:
    """Return (q, a) -> what dt D + dt^2 K takes of an acceleration (nv,) [N, N m]."""
    inertia, between = passive.inertia(dt), passive.between

    def added(q: Array, a: Array) -> Array:
        taken = inertia * a
        if between:
            rows, weights = between.inertia_rows(q, dt)
            taken += rows.T @ (weights * (rows @ a))
        return taken

    return added


class _Heavier(System):
    """A system with more inertia, dt D + dt^2 K, and another torque."""

    def __init__(self, system: System, dt: float, torque: Torque) -> None:
        super().__init__(system.spare, system.applied)
        self.torque = torque
        self._armature = self.model.armature  # a view: Pinocchio reads it in every call
        self._heavier = np.array(system.model.armature) + system.passive.inertia(dt)
        between = system.passive.between
        self._rows = between and partial(between.inertia_rows, dt=dt)

    def solve(self, q: Array, v: Array, tau: Array) -> Array:
        """Return a (nv,) for these torques."""
        self._armature[:] = self._heavier  # the workspace is that of others, too
        if not self._rows:
            return super().solve(q, v, tau)
        return with_rows(partial(super().solve, q, v), tau, *self._rows(q))

    def mass(self, q: Array) -> Array:
        """Return M (nv, nv) with all that is added to it."""
        M = super().mass(q)
        if self._rows:
            rows, weights = self._rows(q)
            M += rows.T @ (weights[:, None] * rows)
        return M


def with_rows(solve: Callable[[Array], Array], tau: Array, rows: Array, weights: Array) -> Array:
    """Return the a of (M + U^T w U) a + h = tau + J^T lam, by solves of M a + h = tau + J^T lam.

    What the rows U (r, nv) with weights w (r,) > 0 [kg, kg m^2] take is U^T f with f = w U a, and
    a falls with f as the solves say:

        U a = U a0 - G f,    G = U P U^T,    (1 / w + G) f = U a0,

    with a0 that of f = 0, and P the inverse inertia that the constraints leave. A solve a row finds
    G; the last one is that of the answer, and leaves its lam behind.
    """
    a0 = solve(tau)
    free = rows @ a0
    scale = weights * np.abs(free).max(initial=0.0)  # forces as they come: G is known as well as a0
    pushed = [(solve(tau + f * row) - a0) / f for f, row in zip(scale, rows, strict=True) if f]
    if not pushed:
        return a0
    G = rows @ np.array(pushed).T
    force = np.linalg.solve(np.diag(1 / weights) + G, free)
    return solve(tau - rows.T @ force)


class _WithSlopes(System):
    """A system with the slopes of its torques, as another one takes its steps.

    They act at the end of a step, q1 = q + dt v1 and v1 = v + dt a; in an iteration, which hands in
    its `last` a, they only lead faster to the solution without.
    """

    def __init__(self, system: System, dt: float, last: Callable[[], Array] | None = None) -> None:
        super().__init__(system.workspace, system.applied)
        self._system, self._dt, self._its_last = system, dt, last
        self._known = float("nan"), (np.zeros(0), np.zeros(0))
        self.torque = system.torque

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        """Return a (nv,), as `System.acceleration` does."""
        last = self._last
        if self._its_last is None and t == last[0] and q is last[1] and v is last[2]:
            return last[3]
        if not self.applied.slopes_are_known:
            return self._system.acceleration(t, q, v)
        self._system.at(t)
        by_q, by_v = self._slopes(t, q, v)
        X = -self._dt * by_v - self._dt**2 * by_q
        if self._its_last is not None:
            ahead = X @ self._its_last()
        else:
            ahead = self._dt * by_q @ v
            if self.manifold.floats:  # v1 = v + dt (a + w x u)
                ahead -= X @ self.manifold.turning(v)
        a = self._answer(q, v, self.torque(t, q, v) + ahead, X)
        self._last = t, q, v, a
        return a

    def _slopes(self, t: float, q: Array, v: Array) -> tuple[Array, Array]:
        """Return the slopes; in an iteration those of the first of a step, near enough for all."""
        if self._its_last is None:
            return self.applied.slopes(t, q, v)
        if self._known[0] != t:
            self._known = t, self.applied.slopes(t, q, v)
        return self._known[1]

    def _answer(self, q: Array, v: Array, tau: Array, X: Array) -> Array:
        """Return a of (M + X) a + h = tau + J^T lam, after a solve that leaves its lam."""
        solve = self._system.solve
        free = solve(q, v, tau)
        correct = inverse(np.eye(len(v)) + self._moved_by(X, self._system.mass(q), q))
        a = correct @ free
        if not np.isfinite(a).all():
            raise StepFailed(
                f"dt = {self._dt:g} s: M - dt dtau/dv - dt^2 dtau/dq is singular; take a smaller dt"
            )
        for _ in range(_CORRECTIONS):
            gap = solve(q, v, tau - X @ a) - a
            if self.workspace.solver.exact or not np.abs(gap).max() > _LEFT * np.abs(a).max():
                return np.asarray(a)
            a = a + correct @ gap
        raise StepFailed(
            f"solver = {self.workspace.solver!r}: its constraints are too soft for the "
            "derivatives of tau; use a solver of hard constraints, or no jacobian"
        )

    def _moved_by(self, X: Array, M: Array, q: Array) -> Array:
        """Return P X (nv, nv)."""
        J = self.equations.consistent_jacobian(q)
        return factorise(M, J, tolerances.RANK).solve(X, np.zeros_like(J))[0]

    def difference_if_stiff(self, t: float, q: Array, v: Array) -> None:
        """Begin to difference the torques of a function if a step cannot follow them without."""
        if not self.applied.could_be_differenced:
            return
        M, slopes = self.mass(q), self.applied.slopes(t, q, v)
        moved = [self._moved_by(each, M, q) for each in slopes]
        rates = [np.abs(np.linalg.eigvals(each)).max(initial=0.0) for each in moved]
        h = 2 * self._dt  # it is half a step
        self.applied.differencing = bool(max(h**2 * rates[0], h * rates[1]) > _STIFF)
        if not self.applied.differencing:
            self.applied.differenced = 0  # a look at what is not stiff is no cost of steps
