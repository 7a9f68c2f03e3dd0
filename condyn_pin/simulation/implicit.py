"""Torques at the end of a step: springs, damping and the slopes of functions join the inertia.

    (M + X) a + h = tau + tau_ahead + J^T lam,    J a + gamma = a_ref,    X = -dt tau_v - dt^2 tau_q

A solver knows M, not X. With P the inverse inertia that the constraints leave, and a_free its
answer without X,

    (1 + P X) a = a_free,

and what it answers to the torques less X a has the same a, and the lam that belongs to it.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Final

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array
from condyn_pin._core.linalg.inverse import inverse
from condyn_pin._core.linalg.minimum_norm import factorise
from condyn_pin.errors import StepFailed
from condyn_pin.simulation.system import System, total_torque
from condyn_pin.simulation.torques import Torque

if TYPE_CHECKING:
    from condyn_pin.simulation.slopes import Slopes

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
    applied, passive, slopes = system.applied, system.passive, system.slopes
    if not passive.is_nothing:
        system = _Heavier(system, dt, total_torque(applied, passive, dt))
    return system if applied.jacobian is None else AtTheEnd(system, slopes, dt)


def iterated_system(system: System, dt: float, last: Callable[[], Array]) -> System:
    """Return the system of an iteration on a, where v changes with dt a and q with dt^2 a.

    Its solution is that of the system where a is the `last` one,

        (M + dt D + dt^2 K) a + h = tau - D v - K (q - q0) + (dt D + dt^2 K) last + J^T lam,

    and however large D and K are, they do not keep the iteration from it; nor do those of the
    torques of a function, once their slopes are known.
    """
    slopes, passive = system.slopes, system.passive
    if not passive.is_nothing:
        system = _Heavier(system, dt, _torque_of_last(system, dt, last))
    if system.applied.constant is not None:
        return system
    return Iterated(system, slopes, dt, last)


def _torque_of_last(system: System, dt: float, last: Callable[[], Array]) -> Torque:
    """Return the torques with what the added inertia takes of the last a."""
    inertia, between = system.passive.inertia(dt), system.passive.between

    def torque(t: float, q: Array, v: Array) -> Array:
        tau = system.torque(t, q, v) + inertia * last()
        if between:
            rows, weights = between.inertia_rows(q, dt)
            tau += rows.T @ (weights * (rows @ last()))
        return tau

    return torque


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

    What the rows U (r, nv) take is U^T f with f = w U a, and a falls with f as the solves say:

        U a = U a0 - G f,    G = U P U^T,    (1 / w + G) f = U a0,

    with a0 that of f = 0, and P the inverse inertia that the constraints leave. A solve a row finds
    G; the last one is that of the answer, and leaves its lam behind.

    Parameters
    ----------
    solve : callable
        Returns a (nv,) of tau (nv,).
    tau : (nv,) array
    rows : (r, nv) array
        U.
    weights : (r,) array
        w, positive [kg, kg m^2].
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
    """A system with the slopes of its torques, as another one takes its steps."""

    def __init__(self, system: System, slopes: Slopes, dt: float) -> None:
        super().__init__(system.workspace, system.applied)
        self._system, self.slopes, self._dt = system, slopes, dt
        self.torque = system.torque

    @abstractmethod
    def _ahead(self, by_q: Array, v: Array, X: Array) -> Array:
        """Return tau_ahead (nv,)."""

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        """Return a (nv,), as `System.acceleration` does."""
        if not self.slopes.are_known:
            return self._system.acceleration(t, q, v)
        by_q, by_v = self._slopes_at(t, q, v)
        X = -self._dt * by_v - self._dt**2 * by_q
        return self._answer(q, v, self.torque(t, q, v) + self._ahead(by_q, v, X), X)

    def _slopes_at(self, t: float, q: Array, v: Array) -> tuple[Array, Array]:
        return self.slopes.at(t, q, v)

    def _answer(self, q: Array, v: Array, tau: Array, X: Array) -> Array:
        """Return a of (M + X) a + h = tau + J^T lam, after a solve that leaves its lam."""
        solve = self._system.solve
        free = solve(q, v, tau)
        factors = factorise(
            self._system.mass(q), self._system.equations.jacobian(q), tolerances.RANK
        )
        PX, _ = factors.solve(X, np.zeros((self.scene.rows, len(v))))
        correct = inverse(np.eye(len(v)) + PX)
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
            f"solver = {self.workspace.solver!r}: what it lets give way is too soft for the "
            "derivatives of tau; use a solver of hard constraints, or no jacobian"
        )


class AtTheEnd(_WithSlopes):
    """The system whose torques act at the end of a step, q1 = q + dt v1, v1 = v + dt a."""

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        """Return a (nv,); asked again for the same arrays, the last one."""
        last = self._last
        if not (t == last[0] and q is last[1] and v is last[2]):
            self._last = last = t, q, v, super().acceleration(t, q, v)
        return last[3]

    def _ahead(self, by_q: Array, v: Array, X: Array) -> Array:
        return self._dt * by_q @ v


class Iterated(_WithSlopes):
    """The system of an iteration on a, whose solution is that without slopes."""

    def __init__(
        self, system: System, slopes: Slopes, dt: float, last: Callable[[], Array]
    ) -> None:
        super().__init__(system, slopes, dt)
        self._its_last, self._known = last, (float("nan"), np.zeros(0), np.zeros(0))

    def _ahead(self, by_q: Array, v: Array, X: Array) -> Array:
        return np.asarray(X @ self._its_last())

    def _slopes_at(self, t: float, q: Array, v: Array) -> tuple[Array, Array]:
        """Return those of the first iteration of a step: near enough for all of them."""
        if self._known[0] != t:
            self._known = t, *self.slopes.at(t, q, v)
        return self._known[1:]

    def difference_if_stiff(self, t: float, q: Array, v: Array) -> None:
        """Begin to difference the torques of a function if a step cannot follow them without."""
        if not self.slopes.could_be_differenced:
            return
        by_q, by_v = self.slopes.at(t, q, v)
        factors = factorise(self.mass(q), self.equations.jacobian(q), tolerances.RANK)
        P_q, _ = factors.solve(by_q, np.zeros_like(self.equations.jacobian(q)))
        P_v, _ = factors.solve(by_v, np.zeros_like(self.equations.jacobian(q)))
        rates = [np.abs(np.linalg.eigvals(each)).max(initial=0.0) for each in (P_q, P_v)]
        h = 2 * self._dt  # it is half a step
        self.slopes.differencing = bool(max(h**2 * rates[0], h * rates[1]) > _STIFF)
        if not self.slopes.differencing:
            self.applied.differenced = 0  # a look at what is not stiff is no cost of steps
