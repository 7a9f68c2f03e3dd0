"""Drift schemes: what keeps the constraints closed while time goes on.

In the metric W, the smallest steps that close c and bring J v to zero are

    dq = -W^-1 J^T G^+ c,    dv = -W^-1 J^T G^+ J v,    G = J W^-1 J^T.

With W = M both are free. `pin.constraintDynamics` at (q, v) leaves behind c, J v and the Cholesky
factor of [[-mu 1, J], [J^T, M]]: what is left to do is a back substitution with two columns, a
microsecond, and the acceleration is the one that the next step begins with.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from condyn_pin._core import _pin, tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import check_count
from condyn_pin._core.arrays import Array, finite
from condyn_pin._core.linalg import factorise
from condyn_pin.constraints.drift import DRIFTS, Baumgarte, Correction, Drift
from condyn_pin.dynamics.solvers.proximal import Proximal
from condyn_pin.dynamics.workspace import Workspace
from condyn_pin.errors import InvalidArgument
from condyn_pin.model.soundness import singular_mass
from condyn_pin.simulation.system import System

__all__ = ["DRIFTS", "Baumgarte", "Correction", "Drift"]

# Share of a gap that the damping of Pinocchio's factor may leave.
_LEFT = 1e-2

# A factor is used as long as a second step has less than this share of the gap to close, and no
# joint has moved by more than this [rad, m] since: it leaves about that share of what it closes.
_ENOUGH = 0.1
_NEAR = 0.02


class Gaps(ABC):
    """The gaps of one system, and what closes them."""

    def __init__(self, system: System) -> None:
        self._system = system

    @abstractmethod
    def look(self, t: float, q: Array, v: Array) -> Array:
        """Return [c, J v] (rows, 2); overwritten by the next look."""

    @abstractmethod
    def step(self, again: bool) -> tuple[Array, Array]:
        """Return dq, dv (nv,) that close the gaps of the last look."""
        # `again` says that these are what the step before has left.

    def newton_step(self, t: float, q: Array, v: Array) -> tuple[Array, Array]:
        """Return q and v one step nearer to the constraints; what was found is taken for theirs."""
        self.look(t, q, v)
        dq, dv = self.step(again=False)
        return self._system.integrate(q, dq), v + dv


def gaps_of(system: System, metric: str) -> Gaps:
    """Gaps of a system, with the factors of its solver where these are accurate enough."""
    workspace, solver = system.workspace, system.workspace.solver
    if metric == "mass" and isinstance(solver, Proximal) and uses_the_solver(workspace, solver):
        return SolvedGaps(system, solver.weight(workspace.scene.nominal))
    return FactorisedGaps(system, metric)


def uses_the_solver(workspace: Workspace, solver: Proximal) -> bool:
    """True if the factors of a workspace's solver are accurate enough to close gaps."""
    scene = workspace.scene
    if not scene.rows or scene.nominal.rounded_file:
        return False
    nominal, mu = scene.nominal, solver.weight(scene.nominal)
    smallest = float(nominal.singular_values[nominal.rank - 1]) ** 2 if nominal.rank else 0.0
    return solver.mu is None or mu <= _LEFT * smallest


class SolvedGaps(Gaps):
    """Read from what `pin.constraintDynamics` leaves behind.

    The damping mu of the factor leaves a share mu / (sigma + mu) of each gap: a millionth, and a
    hundredth where it is the most that is taken. Where the solver needed another weight, the matrix
    is factorised again with mu. At open states it is the rows that are kept that are closed.
    """

    def __init__(self, system: System, mu: float) -> None:
        super().__init__(system)
        workspace = system.workspace
        self._workspace, self._mu = workspace, mu
        self._cholesky = _pin.constraint_cholesky(workspace.data)
        self._open_rows = workspace.bound.open_rows
        pinocchio_constraints = workspace.pinocchio_constraints.constraints
        self._m = sum(native.size for native in pinocchio_constraints)
        self._rhs = np.zeros((self._m + system.model.nv, 2), order="F")
        self._gaps, self._flat = self._rhs[: self._m], self._rhs.ravel(order="K")
        c, velocity = [], []  # views of Pinocchio's memory: they follow each solve
        for native, data in zip(pinocchio_constraints, workspace.constraint_datas, strict=True):
            gap = data.contact_placement_error.vector[: native.size]
            c.append(gap if native.anchored else np.zeros(native.size))
            velocity.append(data.contact_velocity_error.vector[: native.size])
        below = np.zeros(system.model.nv)
        self._sources = [*c, below, *velocity, below]

    def look(self, t: float, q: Array, v: Array) -> Array:
        """Return [c, J v] of Pinocchio's rows; the solver's answer is the next `acceleration`."""
        self._system.acceleration(t, q, v)
        w = self._workspace
        if w.proximal_settings.mu != self._mu:
            models, datas = w.constraint_models, w.constraint_datas
            self._cholesky.compute(w.model, w.data, models, datas, self._mu)
        np.concatenate(self._sources, out=self._flat)
        return self._gaps

    def step(self, again: bool) -> tuple[Array, Array]:
        """Return dq, dv (nv,) that close the gaps of the last look."""
        if self._open_rows and self._open_rows.is_open:
            moves = self._open_rows.closing_moves(self._gaps)
        else:
            moves = self._cholesky.solve(self._rhs)[self._m :]
        return -moves[:, 0], -moves[:, 1]

    def newton_step(self, t: float, q: Array, v: Array) -> tuple[Array, Array]:
        """Return q and v one step nearer; the acceleration of the look counts for them too."""
        self.look(t, q, v)
        dq, dv = self.step(again=False)
        q, v = self._system.integrate(q, dq), v + dv
        self._system.carry_over(q, v)
        return q, v


class FactorisedGaps(Gaps):
    """By the equations of the scene, with a factor that is kept while it serves."""

    def __init__(self, system: System, metric: str) -> None:
        super().__init__(system)
        self._metric = metric
        self._nearest: Array | None = None  # (nv, m), W^-1 J^T G^+
        self._gaps, self._size = np.zeros((system.scene.rows, 2)), 0.0
        self._q = self._made_at = np.zeros(0)

    def look(self, t: float, q: Array, v: Array) -> Array:
        """Return [c, J v] of the scene's rows."""
        self._system.at(t)
        self._gaps[:, 0], self._gaps[:, 1] = self._system.equations.gaps(q, v)
        self._q = q
        return self._gaps

    def step(self, again: bool) -> tuple[Array, Array]:
        """Return dq, dv (nv,) that close the gaps of the last look."""
        size = float(np.abs(self._gaps).max(initial=0.0))
        if self._nearest is None or (again and not size < _ENOUGH * self._size) or self._is_far():
            self._nearest, self._made_at = self._factorise(), self._q
        self._size = size
        steps = self._nearest @ self._gaps
        return -steps[:, 0], -steps[:, 1]

    def _is_far(self) -> bool:
        """True if q is too far from the configuration of the factor."""
        moved = pin.difference(self._system.model, self._made_at, self._q)
        return bool(np.abs(moved).max(initial=0.0) > _NEAR)

    def _factorise(self) -> Array:
        system = self._system
        n, m = system.model.nv, system.scene.rows
        J = system.equations.consistent_jacobian(self._q)
        W = system.mass(self._q) if self._metric == "mass" else np.eye(n)
        factors = factorise(W, J, tolerances.RANK, why=singular_mass(system.model, self._q))
        return factors.solve(np.zeros((n, m)), np.eye(m))[0]


@dataclass(frozen=True)
class NoDrift(Drift):
    """No correction: J a + gamma = 0 alone, so gaps stay open.

    For integrators that satisfy the constraints themselves. With others c grows like t^2 for high
    orders, and like t for order 1.
    """

    title: ClassVar[str] = "none"
    cost: ClassVar[str] = "nothing"
    use: ClassVar[str] = "with integrators that keep the constraints, and to see the drift"


Metric = Literal["mass", "euclidean"]
METRICS: tuple[Metric, ...] = ("mass", "euclidean")

# Newton's steps square a gap: from 1e-2 to rounding in four.
_MOST_STEPS = 8


@dataclass(frozen=True)
class Projection(Drift):
    """Newton's steps along W^-1 J^T onto the constraints.

    q <- integrate(q, -W^-1 J^T G^+ c),    v <- v - W^-1 J^T G^+ J v,    G = J W^-1 J^T

    Each move is the shortest in W that closes c to first order. From a gap g they lead to the
    closed state of least distance but for about g^2; v is at the least distance where q ends.

    Gaps are checked after every step and closed if they exceed `tolerance`. With `Proximal` in the
    metric of M the check costs next to nothing: it uses the first solve of the next step, and
    another solve is made only if something has to be closed.

    Energy is not kept: it drifts with the errors of the integrator, as it does without
    constraints. In the metric of M, the velocity part never raises the kinetic energy.

    Parameters
    ----------
    position, velocity : bool
        Which of c(q) = 0 and J v = 0 to keep. The velocity alone does most: with J v = 0 a gap
        grows by what each step leaves, not with the square of time.
    metric : {"mass", "euclidean"}
        W: the mass matrix, or the identity. The identity moves light and heavy bodies alike.
    every : int
        Steps from one look to the next.
    tolerance : float
        Violation [m, rad] and velocity [m/s, rad/s] that are left.

    Raises
    ------
    InvalidArgument
        If there is nothing to keep, the metric is unknown, `every` is not positive, or the
        tolerance is negative.

    References
    ----------
    Eich. Convergence results for a coordinate projection method applied to mechanical systems with
    algebraic constraints. SIAM Journal on Numerical Analysis 30, 1993.
    """

    title: ClassVar[str] = "projection"
    cost: ClassVar[str] = "a microsecond, and a solve where something is to close (Proximal)"
    use: ClassVar[str] = "to keep loops closed to a tolerance"
    corrects: ClassVar[bool] = True

    position: bool = True
    velocity: bool = True
    metric: Metric = "mass"
    every: int = 1
    tolerance: float = 1e-10  # [m, rad, m/s, rad/s]

    def __post_init__(self) -> None:
        check_projection(self.metric, self.every)
        if not (self.position or self.velocity):
            raise InvalidArgument("position = velocity = False: NoDrift() leaves both alone")
        if finite("tolerance", self.tolerance, ()) < 0:
            raise InvalidArgument(f"tolerance = {self.tolerance!r}: a number >= 0 is needed")

    @property
    def closes(self) -> bool:
        """True if the projection keeps c(q) = 0."""
        return self.position

    def start(self, system: System, dt: float) -> Correction:
        """Projection of the state, after every `every` steps of the integrator."""
        gaps, integrate = gaps_of(system, self.metric), system.integrate

        def correct(t: float, q: Array, v: Array) -> tuple[Array, Array]:
            gap, velocity = self._sizes(gaps, t, q, v)
            for k in range(_MOST_STEPS):
                if gap <= self.tolerance and velocity <= self.tolerance:
                    break
                dq, dv = gaps.step(k > 0)
                q1 = integrate(q, dq) if self.position else q
                v1 = v + dv if self.velocity else v
                before, (gap, velocity) = (gap, velocity), self._sizes(gaps, t, q1, v1)
                # the position first: where loops are open, rows contradict each other
                if not gap <= max(before[0], self.tolerance):
                    break
                q, v = q1, v1
                if not (_shrinks(before[0], gap) or _shrinks(before[1], velocity)):
                    break  # rounding, or out of reach
            return q, v

        return once_every(self.every, correct)

    def _sizes(self, gaps: Gaps, t: float, q: Array, v: Array) -> tuple[float, float]:
        """Return the largest violation and the largest |J v|, zero for what is not to be kept."""
        both = np.abs(gaps.look(t, q, v))
        gap = float(both[:, 0].max(initial=0.0)) if self.position else 0.0
        return gap, float(both[:, 1].max(initial=0.0)) if self.velocity else 0.0


def _shrinks(before: float, after: float) -> bool:
    return after < before / 2


def check_projection(metric: str, every: int) -> None:
    """Refuse an unknown metric, or a number of steps that is not a positive integer."""
    if metric not in METRICS:
        raise InvalidArgument(f"metric = {metric!r}: one of {', '.join(METRICS)} is needed")
    check_count("every", every)


def once_every(steps: int, correct: Correction) -> Correction:
    """Correction of the state after every `steps` steps; other states stay unchanged."""
    if steps == 1:
        return correct
    count = 0

    def correct_some(t: float, q: Array, v: Array) -> tuple[Array, Array]:
        nonlocal count
        count += 1
        return (q, v) if count % steps else correct(t, q, v)

    return correct_some


@dataclass(frozen=True)
class PostStabilization(Drift):
    """One correction of position and velocity per step, with one factorisation for both.

    q <- integrate(q, -W^-1 J^T G^+ c),    v <- v - W^-1 J^T G^+ J v,    G = J W^-1 J^T

    The remainder of one Newton step, of the order of the gap squared, is for the next step.
    The acceleration of the state before the correction is used for the state after it: they differ
    by the error of one step of the integrator. So with `Proximal` in the metric of M a step costs
    no more solves than without drift control.

    Parameters
    ----------
    metric : {"mass", "euclidean"}
        W: the mass matrix, or the identity.
    every : int
        Steps from one correction to the next.

    Raises
    ------
    InvalidArgument
        If the metric is unknown, or `every` is not positive.

    References
    ----------
    Ascher, Chin, Petzold, Reich. Stabilization of constrained mechanical systems with DAEs and
    invariant manifolds. Mechanics of Structures and Machines 23, 1995.
    """

    title: ClassVar[str] = "post-stabilization"
    cost: ClassVar[str] = "a few microseconds (Proximal)"
    use: ClassVar[str] = "by default: the cheapest that keeps both levels"
    corrects: ClassVar[bool] = True

    metric: Metric = "mass"
    every: int = 1

    def __post_init__(self) -> None:
        check_projection(self.metric, self.every)

    def start(self, system: System, dt: float) -> Correction:
        """Correction by one Newton step, after every `every` steps of the integrator."""
        return once_every(self.every, gaps_of(system, self.metric).newton_step)
