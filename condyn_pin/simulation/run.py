"""The verb simulate: a scene in motion."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from math import inf, isfinite
from time import perf_counter
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core.arguments import check_called, check_type
from condyn_pin._core.arrays import Array, finite
from condyn_pin._core.threads import one_blas_thread
from condyn_pin.constraints.constraint import Constraint
from condyn_pin.constraints.drift import Drift
from condyn_pin.constraints.forces import AppliedForce
from condyn_pin.constraints.path import check_along
from condyn_pin.dynamics.scene import Scene, check_at_all_times, check_scene
from condyn_pin.dynamics.solvers.solver import Solver
from condyn_pin.dynamics.workspace import Workspace
from condyn_pin.errors import CondynError, NotAssembled
from condyn_pin.mechanism.closing import with_anchors
from condyn_pin.simulation.events import (
    Event,
    EventRecord,
    EventWatch,
    RunEnd,
    Snapshot,
    Switch,
    ZenoDetected,
    switch,
)
from condyn_pin.simulation.integrators.integrator import Integrator, StepEffects
from condyn_pin.simulation.motion_status import Effects, MotionLimits, Run, RunStatus
from condyn_pin.simulation.plan import (
    Plan,
    check_closing,
    check_deeper,
    check_initial_state,
    check_penetration,
    check_rows,
    check_solver,
    check_velocity,
    default_solver,
    plan,
    velocity_of_steps,
)
from condyn_pin.simulation.records import (
    BLOCK,
    NO_WORK,
    ContactWork,
    Recorder,
    Remark,
    Remarks,
    Row,
    merge,
)
from condyn_pin.simulation.stability import stiff_damping, stiff_springs
from condyn_pin.simulation.system import CorrectedStepper, System
from condyn_pin.simulation.torques import Torque, TorqueJacobian
from condyn_pin.simulation.trajectory import Trajectory

# Where the rates of a path are compared with its differences, as shares of the duration.
_LOOKS = (0.21, 0.47, 0.83)


def simulate(
    scene: Scene,
    q: ArrayLike,
    v: ArrayLike,
    tau: float | ArrayLike | Torque = 0.0,
    *,
    forces: Sequence[AppliedForce] = (),
    jacobian: TorqueJacobian | None = None,
    duration: float,
    dt: float = 1e-3,
    integrator: Integrator | None = None,
    drift: Drift | None = None,
    solver: Solver | None = None,
    record: int = 1,
    events: Sequence[Event] = (),
    close_start: bool = True,
    gravity: bool = True,
    springs: bool = True,
    damping: bool = True,
    armature: bool = True,
    limits: MotionLimits | None = None,
    progress: Callable[[float], object] | None = None,
) -> Trajectory:
    """Return the motion of a scene from a state.

    M(q) a + h(q, v) = tau - k (q - q0) - d v + J(q)^T lam + sum J_f(q)^T f,
    J a + gamma = a_ref

    Parameters
    ----------
    scene : Scene
        Contacts without an anchor are anchored where they are at the start.
    q, v : (nq,), (nv,) array_like
        A state that satisfies the constraints, up to 1e-4 m and rad, unless `close_start` is False.
    tau : 0, (nv,) array_like or callable, optional
        The torques applied [N, N m]: constant, or tau(t, q, v). A function is called at every stage
        of a step, with states that may be thrown away, and may not write to its arguments.
    forces : sequence of AppliedForce, optional
        Forces from outside, constant or functions of (t, q, v), called as tau is; none by default.
        The `tau` of the trajectory, and its work, have J_f^T f in them.
    jacobian : callable, optional
        (t, q, v) -> the derivatives of the function tau by q and by v, (nv, nv) each, for the
        integrators that are implicit (`Integrator.takes_jacobian`): stiff springs and dampers in it
        need no small dt then. Without it the fully implicit ones take differences where they need
        them, for 2 nv + 1 calls of tau a step, and `notices` names them. What `forces` do is added.
    duration : float
        Length of the motion [s].
    dt : float
        The step [s]. If `duration` is not a whole number of steps, it is reduced a little.
    integrator : Integrator, optional
        `StewartTrinkle()` by default where contacts may open (`EventDriven()` locates their
        events), else `RungeKutta4()`: four solves a step, and an error of order dt^4. For six
        digits it takes a tenth of the steps of a method of order 2, a thousandth of Euler's. For
        very long motions, or where energy matters most, take an integrator that keeps the
        constraints.
    drift : Drift, optional
        What keeps the constraints closed. By default `PostStabilization()`, which has no gains to
        choose; `NoDrift()` if no scene has constraints, events' scenes included, the integrator
        keeps them itself, or the solver makes them soft.
    solver : Solver, optional
        As in `solve`; by default with four iterations at most where rows are redundant, since more
        change nothing (`condyn_pin.simulation.plan`).
    record : int
        Keep every `record`-th sample. The first and the last one, and those at events, are always
        kept.
    events : sequence of Event, optional
        Changes on the way: other contacts, impacts, the end.
    close_start : bool
        Whether the start has to satisfy the constraints, and bodies to be apart. With False the
        drift scheme closes what is open, as `Baumgarte` does at the rate of its gains; it has to be
        one that does. Penetrations are pushed out by `StewartTrinkle`, at 0.2 m/s at most.
    gravity, springs, damping, armature : bool
        Which effects of the robot's model are on; see `Effects`.
    limits : MotionLimits, optional
        What gaps, penetrations and energy without work may be in a motion that is ok; by default
        after dt and the size of the machine.
    progress : callable, optional
        Called with the share of the motion that is done, from 0 to 1, a hundred times.

    Returns
    -------
    Trajectory
        Also of a run that broke down: its `status` and `reason` tell, and its samples go to the
        last state that could be solved. They say too where loops came open, bodies penetrated, or
        energy appeared or vanished without work, by more than `limits`.

    Raises
    ------
    InvalidArgument
        If an argument cannot be used, gains of `drift` are beyond the stability limit of the
        integrator, or `drift` cannot close the start.
    UnknownName
        If a force is on a frame that does not exist.
    NotAssembled
        If a loop is open at q, v does not keep it closed, or a contact penetrates.
    SolveFailed, StepFailed
        If not even the first state can be solved, or no step with contacts leads away from it.
    UnsupportedConstraint
        If the solver cannot take a kind of constraint, or the integrator lets no contact open.

    Notes
    -----
    Cost: `Integrator.solves_per_step` solves per step, and a few microseconds; an event with
    another scene costs about as much as a hundred solves.
    """
    check_scene(scene)
    check_at_all_times(scene, "a motion begins at t = 0")
    if progress is not None:
        check_called("progress", progress, "share")
    effects = Effects(gravity=gravity, springs=springs, damping=damping, armature=armature)
    check_type("close_start", close_start, bool, "True or False is needed")
    planned = plan(
        scene, tau, duration=duration, dt=dt, integrator=integrator, drift=drift, solver=solver,
        record=record, effects=effects, events=events, forces=forces, jacobian=jacobian,
        limits=limits,
    )  # fmt: skip
    for bound in scene.bounds:
        if bound.drive:
            times = [share * planned.duration for share in _LOOKS]
            check_along(bound.drive.along, bound.size, bound.name, times)
    state = first_state(scene, q, v, planned, closed=close_start)
    if close_start:
        check_penetration(scene, state[0], planned.integrator)
    elif scene.rows and not _is_closed(scene, *state, planned):
        check_closing(scene, planned.integrator, planned.drift)
    return follow(planned, *state, progress)[0]


def _is_closed(scene: Scene, q: Array, v: Array, plan: Plan) -> bool:
    """True if loops are closed at a state, in position and velocity."""
    try:
        check_initial_state(
            scene, q, v, allowed=velocity_of_steps(scene, q, v, plan.integrator, plan.dt)
        )
    except NotAssembled:
        return False
    return True


@one_blas_thread
def follow(
    plan: Plan,
    q: Array,
    v: Array,
    progress: Callable[[float], object] | None = None,
    phase: HybridPhase | None = None,
) -> tuple[Trajectory, HybridPhase]:
    """Return the motion from a state that was checked, and the phase that it ended on."""
    # A phase of the same plan, on which no event has changed the scene, spares the work of making
    # another.
    begun = perf_counter()
    plan.tau.differenced = 0
    with np.errstate(all="ignore"):  # what overflows is found by the next solve
        simulator = HybridSimulator(plan, q, v, phase)
        status, reason = _run(simulator, progress)
    phases, (t, positions, velocities, a, lam, torques), contact = merge(simulator.recorders)
    run = Run(
        duration=plan.duration, dt=plan.dt, integrator=plan.integrator, drift=plan.drift,
        solver=simulator.phase.solver, effects=plan.effects, limits=plan.limits, status=status,
        reason=reason,
        happened=tuple(simulator.happened), missed=simulator.missed(),
        differenced=plan.tau.differenced, remarks=simulator.remarks,
        wall_time=perf_counter() - begun,
    )  # fmt: skip
    motion = Trajectory(
        phases=phases,
        t=t,
        q=positions,
        v=velocities,
        a=a,
        lam=lam,
        tau=torques,
        run=run,
        contact=contact,
    )
    return motion, simulator.phase


def _run(
    simulator: HybridSimulator, progress: Callable[[float], object] | None
) -> tuple[RunStatus, str]:
    """Status and reason of a run, taken to its end."""
    steps, q0 = simulator.plan.steps, simulator.q
    stride = max(steps // 100, 1)

    def tick(done: int) -> None:
        if done % stride == 0 or done == steps:
            progress(done / steps)  # type: ignore[misc]

    try:
        simulator.run(tick if progress else None)
    except RunEnd as end:
        return RunStatus.ENDED, str(end)
    except ZenoDetected as end:
        return RunStatus.PILED_UP, str(end)
    except KeyboardInterrupt:
        if not any(recorder.count for recorder in simulator.recorders):
            raise
        return RunStatus.INTERRUPTED, f"interrupted after t = {simulator.t:g} s"
    except CondynError as error:
        lost = is_lost(simulator.v)
        if not lost:
            with suppress(CondynError):  # no step leads away from it, but it may be a sample
                simulator.end()
        if not any(recorder.count for recorder in simulator.recorders):
            raise
        hint = hint_of(simulator, q0)
        # what no step can follow grows without bound, whatever it meets on the way
        grown = lost or (hint and simulator.t > 0)
        status = RunStatus.DIVERGED if grown else RunStatus.FAILED
        return status, f"after t = {simulator.t:g} s: {hint}{error}{remedy_of(simulator)}"
    if is_lost(simulator.v):
        fastest = np.abs(simulator.v).max()
        reason = (
            f"{hint_of(simulator, q0)}it moves at {fastest:.3g} rad/s or m/s{remedy_of(simulator)}"
        )
        return RunStatus.DIVERGED, reason
    return RunStatus.FINISHED, ""


def first_state(
    scene: Scene, q: ArrayLike, v: ArrayLike, plan: Plan, *, closed: bool = True
) -> tuple[Array, Array]:
    """Return the first state, which has to satisfy the constraints if it is to be closed."""
    q_ = scene.robot.arguments.configuration("q", q)
    v_ = np.array(finite("v", v, scene.robot.nv))
    scene.robot.check_unedited()
    if closed:
        check_initial_state(
            scene, q_, v_, allowed=velocity_of_steps(scene, q_, v_, plan.integrator, plan.dt)
        )
    return q_, v_


# HybridSimulator: a scene in motion, phase after phase, with the events between them.
#
#     simulate          checks what it is given: a Plan, and a state that fits it
#        |
#     HybridSimulator   t, q, v; looks after each step which event comes first, and lets it happen
#        |              event after event
#     HybridPhase       one scene, as long as its constraints are the same; its samples
#        |              step after step
#     CorrectedStepper  (q, v) at t + dt by the integrator, then the correction of the drift scheme
#        |              stage after stage
#     System            tau, and by the solver a of M a + h = tau + J^T lam, J a + gamma = a_ref
#
# Integrators, drift schemes and solvers are frozen values: they come in as functions, bound to the
# memory of one system: `Stepper`, `Correction`, `BoundSolver`.


# Where an event is found, as a share of dt.
_FOUND = 1e-12

# What is left of a step after an event, and is not worth one, as a share of dt.
_NOTHING = 1e-9

# Events in one step, at most: more have piled up.
_MOST = 100


class HybridSimulator:
    """A run in progress: its state (t, q, v), its present phase, and its samples so far.

    It owns q and v. A `phase` of another run of this plan has its memory used again.
    """

    def __init__(self, plan: Plan, q: Array, v: Array, phase: HybridPhase | None = None) -> None:
        self.t, self.q, self.v = 0.0, q, v
        self.plan = plan
        self._places: dict[Constraint, Constraint] = {}
        self._asked = plan.scene  # as the user wrote it: its contacts may lack a place
        placed = self._placed(plan.scene)
        self.phase = phase or HybridPhase(placed, plan)
        self.phase.use(placed)
        self._work = NO_WORK  # of contacts, up to t
        self._remarks = self.phase.remarks = Remarks()
        self.recorders = [self.phase.begin(self.t, q, v, self._work)]
        self.happened: list[EventRecord] = []
        self._watch = EventWatch(plan.events)
        if plan.events:
            self._watch.values = self._look(self.t, q, v)

    def run(self, tick: Callable[[int], None] | None = None) -> None:
        """Take the steps of the plan; `tick` is told how many are taken."""
        # Ended or ZenoDetected if an event ends the run, or happens again at once.
        located = self.plan.integrator.locates_events
        (self._run_watched if self._watch.events or located else self._run_free)(tick)
        self.end()

    def end(self) -> None:
        """Keep the last state, unless the last step did."""
        self.phase.end(self.t, self.q, self.v, self._work)

    def _run_free(self, tick: Callable[[int], None] | None) -> None:
        """Take the steps where no event can happen: nothing is checked in between."""
        take, turn, recorder = self.phase.stepper.take, self.phase.turn, self.phase.recorder
        every, dt, rows = self.plan.every, self.plan.dt, recorder.rows
        t, q, v, effects = self.t, self.q, self.v, self.phase.stepper.effects
        try:
            for k in range(self.plan.steps):
                t1 = (k + 1) * dt
                q, v = take(t, q, v, t1, rows.append if k % every == turn else None, self._work)
                t = t1
                if effects:
                    self._work, _, notes = effects(self._work)
                    self._remarks.count(notes)
                if len(rows) == BLOCK:
                    recorder.pack()
                if tick:
                    tick(k + 1)
        finally:
            self.t, self.q, self.v = t, q, v

    def _run_watched(self, tick: Callable[[int], None] | None) -> None:
        """Take the steps, and look after each which event has happened in it."""
        for k in range(self.plan.steps):
            step = self.phase.step(self.t, self.q, self.v, k, self._work)
            t1 = (k + 1) * self.plan.dt
            q, v, effects = self._through_events(t1, step, (k + 1) % self.plan.every == 0)
            self._add(t1, effects)
            self.t, self.q, self.v = t1, q, v
            if tick:
                tick(k + 1)

    @property
    def remarks(self) -> tuple[Remark, ...]:
        """Messages of the steps of the run."""
        return self._remarks.all

    def missed(self) -> tuple[str, ...]:
        """Return a sentence for each event that did not happen."""
        names, values = {event.name for event in self.happened}, self._watch.values
        return tuple(
            f"{event.name} did not happen: {event.missed(values[event.name], self._asked)}"
            for event in self._watch.events
            if event.name not in names
        )

    def _through_events(self, t1: float, step: PhaseStep, keep: bool) -> PhaseStep:
        """Return the last step to t1, a sample if it is to be kept, from that without events."""
        for _ in range(_MOST):
            q1, v1, _ = step
            values = self._look(t1, q1, v1)
            event, share = self._first(t1, values)
            if event is None:
                break
            self.phase.take_back(self.t)
            self._go(event, self.t + share * (t1 - self.t))
            self._happen(event)
            if self._is_there(t1):
                step = PhaseStep(self.q, self.v, StepEffects(self._work))
            else:
                step = self.phase.part(self.t, self.q, self.v, self._work, t1, keep=keep)
        else:
            names = " and ".join(sorted({each.name for each in self.happened[-_MOST:]}))
            raise ZenoDetected(
                f"more than {_MOST} events ({names}) from t = {self.t:g} s to {t1:g} s: one "
                "undoes the other; a point that is held sideways while its normal force ends has "
                "to slide, as a PlanarContact does"
            )
        if not self._is_there(t1):  # else the last event was at t1, and its values are known
            self._watch.after_step(t1, values)
        return step

    def _look(self, t: float, q: Array, v: Array) -> dict[str, float]:
        """Return the value of every event at a state."""
        return self._watch.look(self.phase.snapshot(t, q, v), self._asked)

    def _first(self, t1: float, values: dict[str, float]) -> tuple[Event | None, float]:
        """First event on the way to t1, and the share of the way at which it happens."""
        first: tuple[Event | None, float] = (None, inf)
        for event in self._watch.fallen(values):
            share = self._share(event, t1, self._watch.values[event.name], values[event.name])
            if share < first[1]:
                first = event, share
        return first

    def _is_there(self, t1: float) -> bool:
        """True if the time left to t1 is too short for a step."""
        return t1 - self.t <= _NOTHING * self.plan.dt

    def _share(self, event: Event, t1: float, before: float, after: float) -> float:
        """Share of the way to t1 at which the value of an event is zero [1]."""
        from scipy.optimize import brentq

        if self._is_there(t1):
            return 0.0
        if event.at is not None:
            return (event.at - self.t) / (t1 - self.t)
        way = t1 - self.t

        def value(share: float) -> float:
            if share in (0.0, 1.0):
                return after if share else before
            t = self.t + share * way
            q, v, _ = self.phase.part(self.t, self.q, self.v, self._work, t)
            return event.value(self.phase.snapshot(t, q, v))

        return float(brentq(value, 0.0, 1.0, xtol=_FOUND, rtol=_FOUND))

    def _go(self, event: Event, t: float) -> None:
        """Go on by less than a step, to an event at t."""
        t = t if event.at is None else event.at
        if t - self.t > _NOTHING * self.plan.dt:
            self.q, self.v, effects = self.phase.part(self.t, self.q, self.v, self._work, t)
            self._add(t, effects)
        self.t = max(t, self.t)  # also if that is not worth a step: a time does not come again

    def _add(self, t1: float, effects: StepEffects) -> None:
        """Add the work and the located events of a step to t1 that counts."""
        self._work = effects.work
        for located in effects.events:
            if abs(t1 - located.t) <= _NOTHING * self.plan.dt:
                located = located.at(t1)  # k dt and (k - 1) dt + dt are one time
            if self.plan.at_events:
                self.recorders.append(self.phase.split(located.before, located.after))
            sample = sum(recorder.count for recorder in self.recorders)
            self.happened.append(located.happened(sample - self.plan.at_events))

    def _happen(self, event: Event) -> None:
        """Let an event happen here; Ended if it ends the run."""
        self.end()
        sample = sum(recorder.count for recorder in self.recorders)
        if event.ends:
            self.happened.append(EventRecord(event.name, self.t, sample - 1))
            raise RunEnd(f"event {event.name!r} at t = {self.t:g} s")
        before, left = self.phase.scene, self._asked
        # a contact that was lifted has its place wherever it touches again
        self._places = {c: self._places[c] for c in self._asked.constraints if c in self._places}
        met = event.met or event.scene
        assert met is not None
        # contacts that may open act in the steps, and not in the impact of an event
        held, met = before.bilateral, self._placed(met).bilateral
        held, met = held.at(self.t), met.at(self.t)
        change = switch(held, met, self.q, self.v, restitution=event.restitution)
        jump, self.v = change.v - self.v, change.v
        if event.scene is None or event.scene is left:
            what = f"event {event.name!r}: its impact tears apart what goes on: let met hold that: "
            check_velocity(before, self.q, jump, what=what)
        else:
            after = self._placed(event.scene)
            what = f"event {event.name!r}: its scene does not fit the state: "
            now = after.at(self.t)
            allowed = velocity_of_steps(now, self.q, self.v, self.plan.integrator, self.plan.dt)
            check_initial_state(now, self.q, self.v, allowed=allowed, what=what)
            check_deeper(after, before, self.q, self.plan.integrator, what=what)
            self._asked = event.scene
            self.phase = HybridPhase(after, self.plan)
            self.phase.remarks = self._remarks
        self.recorders.append(self.phase.begin(self.t, self.q, self.v, self._work))
        self.happened.append(_event_record(event, self.t, sample, before, self.phase.scene, change))
        self._watch.after_event(event, left, self._look(self.t, self.q, self.v), self._asked)

    def _placed(self, scene: Scene) -> Scene:
        """Return a scene as the run has it: its contacts with their places, effects off or on."""
        return with_anchors(self.plan.effects.applied_to(scene), self.q, self._places)


def _event_record(
    event: Event, t: float, sample: int, before: Scene, after: Scene, change: Switch
) -> EventRecord:
    old, new = set(before.names), set(after.names)
    return EventRecord(
        event.name,
        t,
        sample,
        change.impact.energy_lost if change.impact else 0.0,
        tuple(name for name in after.names if name not in old),
        tuple(name for name in before.names if name not in new),
    )


# HybridPhase: a part of a motion with the same constraints.


class PhaseStep(NamedTuple):
    """State behind a step of a phase, and the effects of the step."""

    q: Array
    v: Array
    effects: StepEffects


class HybridPhase:
    """One scene, every contact anchored, with its solver, its stepper and its samples.

    `stepper` takes steps of the plan's dt; `turn` says which of so many steps, as one is kept of,
    is the sample. `remarks` are those of the run; `work` is that of contacts since its start.
    """

    def __init__(self, scene: Scene, plan: Plan) -> None:
        self.scene, self.plan = scene, plan
        check_rows(scene, plan.integrator)
        held = scene.bilateral.at(0.0)  # the system takes it through time
        self.solver = default_solver(held) if plan.solver is None else plan.solver
        workspace = Workspace(held, self.solver, drift=plan.drift.rows)
        check_solver(self.solver, plan)
        effects = plan.effects
        self.system = System(
            workspace, plan.tau, springs=effects.springs, damping=effects.damping,
            contacts=scene.contact_bounds,
        )  # fmt: skip
        self._samples_start = plan.integrator.a_at == "start"
        self.turn = 0 if self._samples_start else plan.every - 1
        self.remarks = Remarks()

    def use(self, scene: Scene) -> None:
        """Begin anew with a scene whose contacts may be anchored elsewhere, in the same memory."""
        if scene is not self.scene:
            self.scene = scene
            self.system.use(scene)

    def begin(self, t: float, q: Array, v: Array, work: ContactWork = NO_WORK) -> Recorder:
        """Begin to keep samples, with another stepper; return what they go to."""
        self.recorder = Recorder(self.scene)
        self.plan.tau.begin(t, q, v)
        self.stepper = self._stepper_of(self.plan.dt)
        if not self._samples_start:  # else the first step keeps it
            self.recorder.add(self.sample(t, q, v, work))
        return self.recorder

    def step(self, t: float, q: Array, v: Array, k: int, work: ContactWork = NO_WORK) -> PhaseStep:
        """Take step k, which ends at (k + 1) dt, and keep its sample if it is its turn."""
        # the first sample of a phase always is
        keep = k % self.plan.every == self.turn or not self.recorder.count
        if self._samples_start and self.recorder.last == t:
            keep = False  # an event of contacts has kept it
        return self._take(self.stepper, t, q, v, work, (k + 1) * self.plan.dt, keep)

    def part(
        self, t: float, q: Array, v: Array, work: ContactWork, t1: float, *, keep: bool = False
    ) -> PhaseStep:
        """Take a step to t1; `keep` says whether its end is to be a sample."""
        keep = not self.recorder.count if self._samples_start else keep
        return self._take(self._stepper_of(t1 - t), t, q, v, work, t1, keep)

    def split(self, before: Row, after: Row) -> Recorder:
        """Go on with another recorder behind an event; return it."""
        if self.recorder.last != before[0]:
            self.recorder.add(before)
        self.recorder = Recorder(self.scene)
        self.recorder.add(after)
        return self.recorder

    def take_back(self, t: float) -> None:
        """Forget the sample of a step from t that does not count."""
        if not self._samples_start:
            self.recorder.drop_after(t)

    def end(self, t: float, q: Array, v: Array, work: ContactWork) -> None:
        """Keep the last state, unless the last step did."""
        if self.recorder.last != t:
            self.recorder.add(self.sample(t, q, v, work))

    def sample(self, t: float, q: Array, v: Array, work: ContactWork = NO_WORK) -> Row:
        """Sample of a state, by the solve there; a step that begins with the same one has it."""
        try:
            return self.stepper.sample(t, q, v, work)
        finally:
            self._effects(self.stepper, work)

    def snapshot(self, t: float, q: Array, v: Array) -> Snapshot:
        """State as conditions of events see it."""
        return Snapshot(t, q, v, self.system, self.sample)

    def _take(
        self, stepper: CorrectedStepper, t: float, q: Array, v: Array, work: ContactWork, t1: float,
        keep: bool,
    ) -> PhaseStep:  # fmt: skip
        try:
            q, v = stepper.take(t, q, v, t1, self.recorder.add if keep else None, work)
        finally:
            effects = self._effects(stepper, work)
        return PhaseStep(q, v, effects)

    def _effects(self, stepper: CorrectedStepper, work: ContactWork) -> StepEffects:
        """Effects of the last step of a stepper, its notes counted, also of one that failed."""
        effects = stepper.effects(work) if stepper.effects else StepEffects(work)
        self.remarks.count(effects.notes)
        return effects

    def _stepper_of(self, dt: float) -> CorrectedStepper:
        return CorrectedStepper(self.system, self.plan.integrator, self.plan.drift, dt)


# Why a run broke down, and what may help.


# A velocity beyond this is no motion of a machine [rad/s, m/s].
LOST: Final = 1e10


def is_lost(v: Array) -> bool:
    """True if a velocity is not finite, or above that of any machine."""
    speed = float(np.abs(v).max(initial=0.0))
    return not (isfinite(speed) and speed < LOST)


def hint_of(simulator: HybridSimulator, q0: Array) -> str:
    """Message on a damper or spring that is too stiff for a run from q0, if there is one."""
    plan, system = simulator.plan, simulator.phase.system
    integrator = plan.integrator.between_events
    hint = stiff_damping(system, integrator, plan.dt, q0)
    hint = hint or stiff_springs(system, integrator, plan.dt, q0)
    return f"{hint}; " if hint else ""


def remedy_of(simulator: HybridSimulator) -> str:
    """Advice to pass a jacobian of the torque function; empty where steps do not need one."""
    plan = simulator.plan
    if not (plan.integrator.uses_torque_jacobian and plan.tau.could_be_differenced):
        return ""
    return "; if tau(t, q, v) is stiff, pass its derivatives as jacobian=..."
