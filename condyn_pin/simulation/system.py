"""System: what an integrator sees of a scene, and one step of it.

    q' = v,    M(q) v' + h(q, v) = tau(t, q, v) + J(q)^T lam,    J v' + gamma = a_ref

on the manifold of configurations. All that a stage of a step calls is in this file, but the solver.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from copy import copy
from functools import cached_property, partial
from math import isclose
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.linalg import factorise, inverse
from condyn_pin._core.models import algorithms
from condyn_pin.constraints.contacts.candidates import Candidates
from condyn_pin.constraints.contacts.touches import BoundContact
from condyn_pin.constraints.drift import Drift
from condyn_pin.constraints.rows.equations import Equations
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.solvers.solver import Singular
from condyn_pin.dynamics.workspace import LARGEST, SMALLEST, Workspace
from condyn_pin.errors import NotAssembled, StepFailed
from condyn_pin.simulation.manifold import Manifold
from condyn_pin.simulation.records import NO_WORK, ContactWork, Row
from condyn_pin.simulation.torques import AppliedTorques, PassiveForces, Torque

if TYPE_CHECKING:
    from condyn_pin.simulation.integrators.integrator import Integrator

# A step of an integrator: (t, q, v) -> (q, v, a)
Step = Callable[[float, Array, Array], tuple[Array, Array, Array]]

# What there is to keep of contacts where none may open.
NO_TOUCH: Final = np.zeros(0)

# No last answer: t, q, v and a.
_NOTHING: Final[tuple[float, Array | None, Array | None, Array]] = (0.0, None, None, np.zeros(0))


class System:
    """A scene with the torques that act on it, in the memory of a workspace.

    Arguments are not checked, and arrays that are returned are owned by the caller, unless it says
    otherwise.

    applied, torque: (t, q, v) -> (nv,) [N, N m]: what is applied, and that with springs and
        damping. Not to be written to.
    passive: springs and damping, those that are on
    manifold: the coordinates of a step
    integrate: (q, dq) -> q moved along dq, on a screw: for moves that are small, as corrections are
    contacts: what may touch; the workspace and its scene know nothing of them
    """

    def __init__(
        self,
        workspace: Workspace,
        tau: float | ArrayLike | Torque | AppliedTorques = 0.0,
        *,
        springs: bool = True,
        damping: bool = True,
        passive: PassiveForces | None = None,
        contacts: Sequence[BoundContact] = (),
    ) -> None:
        robot = workspace.scene.robot
        self.workspace, self.model = workspace, workspace.model
        self.manifold = Manifold(self.model)
        self.applied = tau if isinstance(tau, AppliedTorques) else AppliedTorques(robot, tau)
        self.passive = passive or PassiveForces.of(robot, springs=springs, damping=damping)
        self.torque = total_torque(self.applied, self.passive)
        self.integrate: Callable[[Array, Array], Array] = partial(pin.integrate, self.model)
        self.contacts, self._bounds = Candidates(self.model, contacts), contacts
        self._is_driven = workspace.scene.is_driven
        self._last = _NOTHING
        self._implicit: tuple[System, float] = (self, 0.0)  # the last one, and its dt

    def use(self, scene: Scene) -> None:
        """Switch to another scene of the same robot; steppers have to be started again."""
        self.workspace.use(scene.bilateral.at(0.0))
        self.contacts = Candidates(self.model, scene.contact_bounds)
        self._bounds = scene.contact_bounds
        self._is_driven = scene.is_driven
        self._last = _NOTHING
        if "spare" in vars(self):
            self.spare.model.armature[:] = self.model.armature  # another model would be refused
            self.spare.use(scene.bilateral.at(0.0))
            self._implicit[0]._last = _NOTHING

    def with_contacts(self, contacts: Candidates) -> System:
        """System in the same memory, with other coefficients of its contacts."""
        varied = copy(self)
        varied.contacts = contacts
        return varied

    @property
    def scene(self) -> Scene:
        """The scene of the workspace."""
        return self.workspace.scene

    @property
    def equations(self) -> Equations:
        """The equations of the scene, with memory of their own."""
        return self.workspace.equations

    def at(self, t: float) -> None:
        """Take driven rows where their paths are at t [s]."""
        self.equations.at(t)

    def check_reach(self, t: float, q: Array, v: Array) -> None:
        """Refuse a path that the loops cannot follow."""
        self.at(t)
        gap, _ = self.equations.open_by(q, v)
        if gap > tolerances.OUT_OF_REACH:
            names = ", ".join(c.name for c in self.scene.constraints if c.is_rheonomic)
            raise NotAssembled(
                f"{names}: at t = {t:g} s the path leads to where the loops cannot follow, or "
                f"jumps: they are open by {gap:.2g} m or rad"
            )

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        """Return a (nv,) by the solver; `lam()` then returns its constraint forces (m,)."""
        # The last answer is kept: asked again at the same time for the very same arrays, it is
        # returned. A correction at the end of a step and the next step share one solve.
        last = self._last
        # k dt and (k - 1) dt + dt are one time
        if q is last[1] and v is last[2] and isclose(t, last[0], rel_tol=1e-14):
            return last[3]
        self._last = _NOTHING  # a solve that fails leaves no answer behind, nor lam of the last one
        if self._is_driven:
            self.at(t)
        a = self.solve(q, v, self.torque(t, q, v))
        self._last = t, q, v, a
        return a

    def solve(self, q: Array, v: Array, tau: Array) -> Array:
        """Return a (nv,) for these torques at a state that steps have made of a checked one."""
        workspace = self.workspace
        try:
            a = workspace.bound.acceleration(q, v, tau)
            for i in workspace.roots:  # what is not finite anywhere is not finite there
                if not SMALLEST < a.item(i) < LARGEST:
                    raise ValueError
            return a
        except (ValueError, TypeError, Singular):
            return workspace.careful_acceleration(q, v, tau)

    def lam(self) -> Array:
        """Return the constraint forces (m,) of the last answer."""
        return self.workspace.bound.lam()

    def carry_over(self, q: Array, v: Array) -> None:
        """Take the last answer as that of (q, v), a state so near that nothing would change."""
        t, _, _, a = self._last
        self._last = t, q, v, a

    def sample(self, t: float, q: Array, v: Array) -> Row:
        """Return t, q, v, a, lam and the torques applied; a step from there finds a solved."""
        applied = self.applied
        if applied.constant is not None:
            return t, q, v, self.acceleration(t, q, v), self.lam(), applied.constant, NO_TOUCH
        applied.forget()
        a = self.acceleration(t, q, v)
        return t, q, v, a, self.lam(), applied.first(t, q, v), NO_TOUCH

    @property
    def slope(self) -> Callable[[float, Array, Array, Array], tuple[Array, Array]]:
        """(t, q0, y, V) -> y' and V' (nv,) at coordinates of a step from q0 (`Manifold`)."""
        if self.manifold.is_flat:
            return self._flat_slope
        return partial(self.manifold.slope, self.acceleration)

    def _flat_slope(self, t: float, q0: Array, y: Array, V: Array) -> tuple[Array, Array]:
        return V, self.acceleration(t, self.integrate(q0, y), V)

    def turn_fault(self, v: Array, dt: float) -> str:
        """Message on a joint that turns too far in a step of dt; empty if none does."""
        return self.manifold.turn_fault(v, dt, self._balls)

    @property
    def _balls(self) -> frozenset[str]:
        """The joints whose bodies move the same however they are turned."""
        if self.scene.rows or self.passive.between is not None:
            return frozenset()
        felt = (joint for bound in self._bounds for joint in _joints_that_turn_contacts(bound))
        return self.manifold.balls - {self.model.names[joint] for joint in felt}

    def implicit(self, dt: float) -> System:
        """Return the system whose springs and damping act at the end of a step of size dt."""
        if self._implicit[1] != dt:
            self._implicit = implicit_system(self, dt), dt
        return self._implicit[0]

    def iterated(self, dt: float, last: Callable[[], Array]) -> System:
        """Return the system of an iteration on a, where v changes with dt a and q with dt^2 a."""
        return iterated_system(self, dt, last)

    def retried(self, step: Step) -> Step:
        """Return a step that, where its iteration fails, tries again with slopes of the torques."""
        applied = self.applied
        if applied.constant is not None or applied.jacobian is not None:
            return step

        def again(t: float, q: Array, v: Array) -> tuple[Array, Array, Array]:
            try:
                return step(t, q, v)
            except StepFailed:
                if applied.differencing:
                    raise
            applied.differencing = True
            return step(t, q, v)

        return again

    def difference_if_stiff(self, t: float, q: Array, v: Array) -> None:
        """Begin to difference the torques of a function, in a system made for that."""

    def kept_rows(self, q: Array) -> Callable[[Array], Array]:
        """Return x -> rows x (m,) or (m, k) without what only the digits of the file make up at q.

        Loops of such a file cannot close along those rows.
        """
        equations = self.equations
        left = equations.left_out_by_digits(equations.jacobian(q)) if equations.digits else None
        return left.kept if left else lambda x: x

    def size(self, q: Array) -> float:
        """Scale of the positions whose difference is c(q) [m, rad], at least 1."""
        return max(1.0, self.manifold.reach, float(np.abs(q).max(initial=0.0)))

    @cached_property
    def spare(self) -> Workspace:
        """Another workspace of the same scene, whose model may be changed."""
        workspace = self.workspace
        return Workspace(self.scene, workspace.solver, drift=workspace.drift)

    def mass(self, q: Array) -> Array:
        """Return M (nv, nv), both triangles, armature included."""
        data = self.equations.data
        return np.array(algorithms(data).crba(self.model, data, q))


def total_torque(applied: AppliedTorques, passive: PassiveForces, dt: float = 0.0) -> Torque:
    """Return the torques applied with those of springs and damping."""
    # With dt, springs act as they do at the end of a step, were it not for a: dt K v more.
    between, sprung = passive.between, len(passive.k) > 0
    d = passive.d + dt * passive.stiffness if dt else passive.d
    K, at_q, rest, pulled = passive.K, passive.at_q, passive.rest, bool(d.any() or sprung)

    def torque(t: float, q: Array, v: Array) -> Array:
        tau = applied.constant
        if tau is None:
            tau = applied(t, q, v)
        if pulled:
            pull = d * v
            if sprung:
                pull += K.dot(q[at_q] - rest)
            tau = tau - pull
        return tau if between is None else tau + between.torque(q, v, dt)

    return torque


def _joints_that_turn_contacts(bound: BoundContact) -> Iterator[int]:
    """Yield the joints whose turning a contact feels: all but those of balls about their centre."""
    for touch in bound.touches:
        yield touch.ground
        if np.abs(touch.centre).max() > tolerances.MOMENT * touch.radius:
            yield touch.joint
    for pair in bound.pairs:
        yield from (pair.joint, pair.ground)


class CorrectedStepper:
    """An integrator's steps of one size, the correction of a drift scheme behind each."""

    def __init__(self, system: System, integrator: Integrator, drift: Drift, dt: float) -> None:
        self._dt, self._turn_fault = dt, system.turn_fault
        bare = integrator.start(system, dt)
        self._step, self._lam, self._touch = bare.step, bare.lam, bare.touch
        # (work before the step) -> effects of the last step, where contacts open and slide
        self.effects, self._sample, self._given = bare.effects, bare.sample, system
        self._samples_start = integrator.a_at == "start"
        # a correction reads what the solve of the next step leaves behind, and a step may begin
        # with another system's solve
        self._system = bare.system or system
        self._correct = drift.start(self._system, dt)
        self._is_driven = system.scene.is_driven
        # substeps may lead far: their rows are their own
        self._open_rows = None
        if not integrator.is_adaptive:
            self._open_rows = self._system.workspace.bound.open_rows
        self._slow = None if integrator.between_events.is_adaptive else system.manifold.slow(dt)

    def take(
        self, t: float, q: Array, v: Array, t1: float, keep: Callable[[Row], None] | None = None,
        work: ContactWork = NO_WORK,
    ) -> tuple[Array, Array]:  # fmt: skip
        """Return q and v after a step to t1; `keep` is handed the sample that belongs to it."""
        slow, lam = self._slow, None
        if self._open_rows:
            self._open_rows.held = []
        if keep and self._samples_start:
            keep(self._sample(t, q, v, work) if self._sample else self._system.sample(t, q, v))
        if slow and v.dot(v) > slow:  # all velocities together: most often that is enough
            self._check_turn(v)
        q, v, a = self._step(t, q, v)
        if slow and v.dot(v) > slow:
            self._check_turn(v)
        if self._is_driven:
            self._system.check_reach(t1, q, v)
        if keep and self._lam:
            lam = self._lam()  # before the correction solves again
        if self._correct:
            q, v = self._correct(t + self._dt, q, v)
        if self._open_rows:
            self._open_rows.held = None
        if keep and lam is not None:
            touch = NO_TOUCH
            if self._touch and self.effects:
                touch = self._touch(self.effects(work).work)
            keep((t1, q, v, a, lam, self._system.applied.at_sample(t1, q, v), touch))
        return q, v

    def sample(self, t: float, q: Array, v: Array, work: ContactWork = NO_WORK) -> Row:
        """Sample of a state; `work` is that of contacts since the start of the run."""
        return self._sample(t, q, v, work) if self._sample else self._given.sample(t, q, v)

    def _check_turn(self, v: Array) -> None:
        fault = self._turn_fault(v, self._dt)
        if fault:
            raise StepFailed(fault)


# Torques at the end of a step: springs, damping and the slopes of functions join the inertia.
#
#     (M + X) a + h = tau + tau_ahead + J^T lam,    J a + gamma = a_ref,    X = -dt tau_v - dt^2
#     tau_q
#
# A solver knows M, not X. With P the inverse inertia that the constraints leave, and a_free its
# answer without X,
#
#     (1 + P X) a = a_free,
#
# and what it answers to the torques less X a has the same a, and the lam that belongs to it.


# Rates of torques, times dt, beyond which a step that takes them as they are is near its stability
# limit: 1 for damping and 2 for the square of a frequency in `LinearlyImplicitMidpoint`.
_STIFF: Final = 0.5

# Corrections of a where a solver is compliant, and P is not its own: each leaves a share of the
# last.
_CORRECTIONS: Final = 20
_LEFT: Final = 1e-6


def implicit_system(system: System, dt: float) -> System:
    """Return the system whose springs and damping act at the end of a step of size dt."""
    # With v1 = v + dt a and q1 = q + dt v1 in the torques -D v1 - K (q1 - q0),
    #     (M + dt D + dt^2 K) a + h = tau - (D + dt K) v - K (q - q0) + J^T lam,
    # which is stable however large D and K are. All of them share the memory of `System.spare`.
    # Torques of a function that comes with its derivatives act there too.
    applied, passive = system.applied, system.passive
    if not passive.is_nothing:
        system = _ImplicitSystem(system, dt, _torque_at_end(system, dt))
    return system if applied.jacobian is None else _WithSlopes(system, dt)


def iterated_system(system: System, dt: float, last: Callable[[], Array]) -> System:
    """Return the system of an iteration on a, where v changes with dt a and q with dt^2 a."""
    # Its solution is that of the system where a is the `last` one,
    #     (M + dt D + dt^2 K) a + h = tau - D v - K (q - q0) + (dt D + dt^2 K) last + J^T lam,
    # and however large D and K are, they do not keep the iteration from it; nor do those of the
    # torques of a function, once their slopes are known.
    if not system.passive.is_nothing:
        system = _ImplicitSystem(system, dt, _torque_of_last(system, dt, last))
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


def _added(passive: PassiveForces, dt: float) -> Callable[[Array, Array], Array]:
    """Return (q, a) -> what dt D + dt^2 K takes of an acceleration (nv,) [N, N m]."""
    inertia, between = passive.inertia(dt), passive.between

    def added(q: Array, a: Array) -> Array:
        taken = inertia * a
        if between:
            rows, weights = between.inertia_rows(q, dt)
            taken += rows.T @ (weights * (rows @ a))
        return taken

    return added


class _ImplicitSystem(System):
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
    """Return the a of (M + U^T w U) a + h = tau + J^T lam, by solves of M a + h = tau + J^T lam."""
    # What the rows U (r, nv) with weights w (r,) > 0 [kg, kg m^2] take is U^T f with f = w U a, and
    # a falls with f as the solves say:
    #     U a = U a0 - G f,    G = U P U^T,    (1 / w + G) f = U a0,
    # with a0 that of f = 0, and P the inverse inertia that the constraints leave. A solve a row
    # finds G; the last one is that of the answer, and leaves its lam behind.
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


# Dead ends: paths of driven rows that lead into what nothing moves.


def blocked_path_error(contacts: str, t: float, depth: float = 0.0) -> StepFailed:
    """Return the error of contacts that driven rows press into each other at t, a `depth` [m]."""
    by = f"{depth:.2g} m or rad " if depth else ""
    return StepFailed(
        f"{contacts} at t = {t:g} s: driven rows move it {by}into what it touches, and neither "
        "can move away; end the path before"
    )
