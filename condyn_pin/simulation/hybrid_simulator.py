"""HybridSimulator: a scene in motion, phase after phase, with the events between them.

    simulate          checks what it is given: a Plan, and a state that fits it
       |
    HybridSimulator   t, q, v; looks after each step which event comes first, and lets it happen
       |              event after event
    HybridPhase       one scene, as long as its constraints are the same; its samples
       |              step after step
    CorrectedStepper  (q, v) at t + dt by the integrator, then the correction of the drift scheme
       |              stage after stage
    System            tau, and by the solver a of M a + h = tau + J^T lam, J a + gamma = a_ref

Integrators, drift schemes and solvers are frozen values: they come in as functions, bound to
the memory of one system: `Stepper`, `Correction`, `BoundSolver`.
"""

from __future__ import annotations

from collections.abc import Callable
from math import inf

from condyn_pin._core.arrays import Array
from condyn_pin.constraints.base import Constraint
from condyn_pin.dynamics.scene import Scene
from condyn_pin.mechanism.closing import with_anchors
from condyn_pin.simulation.contact_work import NO_WORK
from condyn_pin.simulation.events import Ended, Event, Happened, ZenoDetected
from condyn_pin.simulation.fit import check_deeper, check_fit, check_velocity, velocity_of_steps
from condyn_pin.simulation.hybrid_phase import HybridPhase
from condyn_pin.simulation.plan import Plan
from condyn_pin.simulation.recorder import BLOCK
from condyn_pin.simulation.remarks import Remark
from condyn_pin.simulation.snapshot import Snapshot
from condyn_pin.simulation.switching import Switch, switch
from condyn_pin.simulation.watch import Watch

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
        self._contact_work = self.phase.system.contact_work = NO_WORK
        self.phase.system.located = ()
        self._remarks = self.phase.system.remarks
        self._remarks.clear()
        self.recorders = [self.phase.begin(self.t, q, v)]
        self.happened: list[Happened] = []
        self._watch = Watch(plan.events)
        if plan.events:
            self._watch.values = self._look(self.t, q, v)

    def run(self, tick: Callable[[int], None] | None = None) -> None:
        """Take the steps of the plan; `tick` is told how many are taken.

        Raises
        ------
        Ended, ZenoDetected
            If an event ends the run, or happens again at once.
        """
        located = self.plan.integrator.locates_events
        (self._run_watched if self._watch.events or located else self._run_free)(tick)
        self.phase.end(self.t, self.q, self.v)

    def _run_free(self, tick: Callable[[int], None] | None) -> None:
        """Take the steps where no event can happen: nothing is checked in between."""
        take, turn, recorder = self.phase.stepper.take, self.phase.turn, self.phase.recorder
        every, dt, rows = self.plan.every, self.plan.dt, recorder.rows
        t, q, v = self.t, self.q, self.v
        try:
            for k in range(self.plan.steps):
                t1 = (k + 1) * dt
                q, v = take(t, q, v, t1, rows.append if k % every == turn else None)
                t = t1
                if len(rows) == BLOCK:
                    recorder.pack()
                if tick:
                    tick(k + 1)
        finally:
            self.t, self.q, self.v = t, q, v

    def _run_watched(self, tick: Callable[[int], None] | None) -> None:
        """Take the steps, and look after each which event has happened in it."""
        for k in range(self.plan.steps):
            q, v = self.phase.step(self.t, self.q, self.v, k)
            t1 = (k + 1) * self.plan.dt
            q, v = self._through_events(t1, q, v, (k + 1) % self.plan.every == 0)
            self._keep_located(t1)
            self.t, self.q, self.v = t1, q, v
            self._contact_work = self.phase.system.contact_work
            if tick:
                tick(k + 1)

    @property
    def remarks(self) -> tuple[Remark, ...]:
        """What its steps have to say."""
        return self._remarks.all

    def missed(self) -> tuple[str, ...]:
        """Return a sentence for each event that did not happen."""
        names, values = {event.name for event in self.happened}, self._watch.values
        return tuple(
            f"{event.name} did not happen: {event.missed(values[event.name], self._asked)}"
            for event in self._watch.events
            if event.name not in names
        )

    def _through_events(self, t1: float, q1: Array, v1: Array, keep: bool) -> tuple[Array, Array]:
        """Return the state at t1, a sample if it is to be kept, from that without events."""
        for _ in range(_MOST):
            values = self._look(t1, q1, v1)
            event, share = self._first(t1, values)
            if event is None:
                break
            self.phase.take_back(self.t)
            self.phase.system.contact_work = self._contact_work  # of steps that count
            self.phase.system.located = ()
            self._go(event, self.t + share * (t1 - self.t))
            self._happen(event)
            if self._is_there(t1):
                q1, v1 = self.q, self.v
            else:
                q1, v1 = self.phase.part(self.t, self.q, self.v, t1, keep=keep)
        else:
            names = " and ".join(sorted({each.name for each in self.happened[-_MOST:]}))
            raise ZenoDetected(
                f"more than {_MOST} events ({names}) from t = {self.t:g} s to {t1:g} s: one "
                "undoes the other; a point that is held sideways while its normal force ends has "
                "to slide, as a PlanarContact does"
            )
        if not self._is_there(t1):  # else the last event was at t1, and its values are known
            self._watch.after_step(t1, values)
        return q1, v1

    def _look(self, t: float, q: Array, v: Array) -> dict[str, float]:
        """Return the value of every event at a state."""
        return self._watch.look(Snapshot(t, q, v, self.phase.system), self._asked)

    def _first(self, t1: float, values: dict[str, float]) -> tuple[Event | None, float]:
        """Return the first event on the way to t1, and at which share of it."""
        first: tuple[Event | None, float] = (None, inf)
        for event in self._watch.fallen(values):
            share = self._share(event, t1, self._watch.values[event.name], values[event.name])
            if share < first[1]:
                first = event, share
        return first

    def _is_there(self, t1: float) -> bool:
        """Whether what is left to t1 is not worth a step."""
        return t1 - self.t <= _NOTHING * self.plan.dt

    def _share(self, event: Event, t1: float, before: float, after: float) -> float:
        """Return at which share of the way to t1 the value of an event is zero."""
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
            q, v = self.phase.part(self.t, self.q, self.v, t)
            return event.value(Snapshot(t, q, v, self.phase.system))

        return float(brentq(value, 0.0, 1.0, xtol=_FOUND, rtol=_FOUND))

    def _go(self, event: Event, t: float) -> None:
        """Go on by less than a step, to an event at t."""
        t = t if event.at is None else event.at
        if t - self.t > _NOTHING * self.plan.dt:
            self.q, self.v = self.phase.part(self.t, self.q, self.v, t)
            self._contact_work = self.phase.system.contact_work
            self._keep_located(t)
        self.t = max(t, self.t)  # also if that is not worth a step: a time does not come again

    def _keep_located(self, t1: float) -> None:
        """Keep the events of contacts in a step to t1 that counts."""
        system = self.phase.system
        for located in system.located:
            if abs(t1 - located.t) <= _NOTHING * self.plan.dt:
                located = located.at(t1)  # k dt and (k - 1) dt + dt are one time
            if self.plan.at_events:
                self.recorders.append(self.phase.split(located.before, located.after))
            sample = sum(recorder.count for recorder in self.recorders)
            self.happened.append(located.happened(sample - self.plan.at_events))
        system.located = ()

    def _happen(self, event: Event) -> None:
        """Let an event happen here; Ended if it ends the run."""
        self.phase.end(self.t, self.q, self.v)
        sample = sum(recorder.count for recorder in self.recorders)
        if event.ends:
            self.happened.append(Happened(event.name, self.t, sample - 1))
            raise Ended(f"event {event.name!r} at t = {self.t:g} s")
        before, left = self.phase.scene, self._asked
        # a contact that was lifted has its place wherever it touches again
        self._places = {c: self._places[c] for c in self._asked.constraints if c in self._places}
        met = event.met or event.scene
        assert met is not None
        # contacts that may open take part in the steps, and not in the impact of an event
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
            check_fit(now, self.q, self.v, allowed=allowed, what=what)
            check_deeper(after, before, self.q, self.plan.integrator, what=what)
            self._asked = event.scene
            self.phase = HybridPhase(after, self.plan)
            self.phase.system.contact_work = self._contact_work
            self.phase.system.remarks = self._remarks
        self.recorders.append(self.phase.begin(self.t, self.q, self.v))
        self.happened.append(_happened(event, self.t, sample, before, self.phase.scene, change))
        self._watch.after_event(event, left, self._look(self.t, self.q, self.v), self._asked)

    def _placed(self, scene: Scene) -> Scene:
        """Return a scene as it takes part: its contacts with their places, effects off or on."""
        return with_anchors(self.plan.effects.applied_to(scene), self.q, self._places)


def _happened(
    event: Event, t: float, sample: int, before: Scene, after: Scene, change: Switch
) -> Happened:
    old, new = set(before.names), set(after.names)
    return Happened(
        event.name,
        t,
        sample,
        change.impact.energy_lost if change.impact else 0.0,
        tuple(name for name in after.names if name not in old),
        tuple(name for name in before.names if name not in new),
    )
