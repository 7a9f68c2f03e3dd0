"""System: what an integrator sees of a scene, and one step of it.

    q' = v,    M(q) v' + h(q, v) = tau(t, q, v) + J(q)^T lam,    J v' + gamma = a_ref

on the manifold of configurations. All that a stage of a step calls is in this file, but the solver.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import cached_property, partial
from math import isclose
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.trees import algorithms
from condyn_pin.constraints.contacts.candidates import Candidates
from condyn_pin.constraints.contacts.touches import BoundContact
from condyn_pin.constraints.drift import Drift
from condyn_pin.constraints.rows.equations import Equations
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.solvers.base import Singular
from condyn_pin.dynamics.workspace import LARGEST, SMALLEST, Workspace
from condyn_pin.errors import NotAssembled, StepFailed
from condyn_pin.simulation.contact_work import NO_WORK
from condyn_pin.simulation.manifold import Manifold
from condyn_pin.simulation.passive import Passive
from condyn_pin.simulation.recorder import Row
from condyn_pin.simulation.remarks import Remarks
from condyn_pin.simulation.torques import Applied, Torque

if TYPE_CHECKING:
    from condyn_pin.simulation.contact_event import ContactEvent
    from condyn_pin.simulation.integrators.base import Integrator

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

    Attributes
    ----------
    applied, torque : callable
        (t, q, v) -> (nv,) [N, N m]: what is applied, and that with springs and damping. Not to be
        written to.
    passive : Passive
        Springs and damping, those that are on.
    manifold : Manifold
        The coordinates of a step.
    integrate : callable
        (q, dq) -> q moved along dq, on a screw: for moves that are small, as corrections are.
    contacts : Candidates
        What may touch; the workspace and its scene know nothing of them.
    contact_work : ContactWork
        Since the start of the run.
    located : tuple of ContactEvent
        Events of contacts in the last step, of an integrator that finds them.
    remarks : Remarks
        What the steps of the run have to say.
    look : callable
        (t, q, v) -> a sample of the state, by a step where contacts open and slide.
    """

    def __init__(
        self,
        workspace: Workspace,
        tau: float | ArrayLike | Torque | Applied = 0.0,
        *,
        springs: bool = True,
        damping: bool = True,
        contacts: Sequence[BoundContact] = (),
    ) -> None:
        robot = workspace.scene.robot
        self.workspace, self.model = workspace, workspace.model
        self.manifold = Manifold(self.model)
        self.applied = tau if isinstance(tau, Applied) else Applied(robot, tau)
        self.passive = Passive.of(robot, springs=springs, damping=damping)
        self.torque = total_torque(self.applied, self.passive)
        self.integrate: Callable[[Array, Array], Array] = partial(pin.integrate, self.model)
        self.contacts, self.contact_work = Candidates(self.model, contacts), NO_WORK
        self._bounds = contacts
        self.located: tuple[ContactEvent, ...] = ()
        self.remarks = Remarks()
        self.look: Callable[[float, Array, Array], Row] = self.sample
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
        """Return a (nv,) by the solver; `lam()` then returns its constraint forces (m,).

        The last answer is kept: asked again at the same time for the very same arrays, it is
        returned. A correction at the end of a step and the next step share one solve.
        """
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
        """Return which body turns too far in a step of dt; nothing if none does."""
        return self.manifold.turn_fault(v, dt, self._balls)

    @property
    def _balls(self) -> frozenset[str]:
        """The joints whose bodies move the same however they are turned."""
        if self.scene.rows or self.passive.between is not None:
            return frozenset()
        felt = (joint for bound in self._bounds for joint in _felt(bound))
        return self.manifold.balls - {self.model.names[joint] for joint in felt}

    def implicit(self, dt: float) -> System:
        """Return the system whose springs and damping act at the end of a step of size dt."""
        from condyn_pin.simulation.implicit import implicit_system  # it is made of systems

        if self._implicit[1] != dt:
            self._implicit = implicit_system(self, dt), dt
        return self._implicit[0]

    def iterated(self, dt: float, last: Callable[[], Array]) -> System:
        """Return the system of an iteration on a, where v changes with dt a and q with dt^2 a."""
        from condyn_pin.simulation.implicit import iterated_system  # it is made of systems

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
        """Begin to difference the torques of a function, if that is what this system is for."""

    def kept_rows(self, q: Array) -> Callable[[Array], Array]:
        """Return x -> rows x (m,) or (m, k) without what only the digits of the file make up at q.

        Loops of such a file cannot close along those rows.
        """
        equations = self.equations
        left = equations.left_out_by_digits(equations.jacobian(q)) if equations.digits else None
        return left.kept if left else _as_they_are

    def size(self, q: Array) -> float:
        """Return how large the numbers are that c(q) is a difference of [m, rad], at least 1."""
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


def total_torque(applied: Applied, passive: Passive, dt: float = 0.0) -> Torque:
    """Return the torques applied with those of springs and damping.

    With dt, springs act as they do at the end of a step, were it not for a: dt K v more.
    """
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


def _as_they_are(x: Array) -> Array:
    return x


def _felt(bound: BoundContact) -> Iterator[int]:
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
        self.sample = bare.sample or system.sample
        # what a step begins with may be another system's solve
        self._first = bare.sample or (bare.system or system).sample
        self._samples_start = integrator.a_at == "start"
        # a correction reads what the solve of the next step leaves behind
        self._system = bare.system or system
        self._correct = drift.start(self._system, dt)
        self._is_driven = system.scene.is_driven
        # substeps may lead far: their rows are their own
        self._open_rows = None
        if not integrator.is_adaptive:
            self._open_rows = self._system.workspace.bound.open_rows
        self._slow = None if integrator.between_events.is_adaptive else system.manifold.slow(dt)

    def take(
        self, t: float, q: Array, v: Array, t1: float, keep: Callable[[Row], None] | None = None
    ) -> tuple[Array, Array]:
        """Return q and v after a step to t1; `keep` is handed the sample that belongs to it."""
        slow, lam = self._slow, None
        if self._open_rows:
            self._open_rows.held = []
        if keep and self._samples_start:
            keep(self._first(t, q, v))
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
            touch = self._touch() if self._touch else NO_TOUCH
            keep((t1, q, v, a, lam, self._system.applied.at_sample(t1, q, v), touch))
        return q, v

    def _check_turn(self, v: Array) -> None:
        fault = self._turn_fault(v, self._dt)
        if fault:
            raise StepFailed(fault)
