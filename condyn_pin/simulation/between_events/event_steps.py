"""EventSteps: steps of one size, with the events of contacts located within them.

    begin      what has to happen in an instant, and the modes that go on       Transition
    segment        smooth motion by an integrator, until a margin falls to zero     Segments
    close      what is held is closed, and moves along itself, to rounding

until the step is over. A step knows nothing but the state that it begins with: one that is taken
back, or taken again in parts, as events of the user ask for, finds the same.
"""

from __future__ import annotations

from math import inf, isclose

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array, Indices
from condyn_pin._core.linalg import MinimumNorm, factorise
from condyn_pin._core.trees import algorithms
from condyn_pin.contact.problem import OPEN
from condyn_pin.model.soundness import singular_mass
from condyn_pin.simulation.between_events.contact_terms import ContactTerms
from condyn_pin.simulation.between_events.mode_dynamics import Held, ModeDynamics
from condyn_pin.simulation.between_events.next_modes import NextModes
from condyn_pin.simulation.between_events.segment import Segment, Segments
from condyn_pin.simulation.between_events.transition import Begun, Transition
from condyn_pin.simulation.contact_event import ContactEvent
from condyn_pin.simulation.contact_record import touch_of
from condyn_pin.simulation.contact_work import ContactWork
from condyn_pin.simulation.events import ZenoDetected
from condyn_pin.simulation.integrators.base import Integrator
from condyn_pin.simulation.recorder import Row
from condyn_pin.simulation.system import System

# Legs of one step, at most. A ball that comes to rest in it makes some hundred.
_MOST = 1000

# Newton's steps that close what is held, at most, and what they leave [m, rad].
_CLOSINGS = 5
_CLOSED = 1e-14

# What is left of a step, as a share of it, that is no segment.
_NOTHING = 1e-12


class EventSteps:
    """The steps of one system with contacts."""

    def __init__(
        self, system: System, dt: float, inner: Integrator, choice: NextModes, shortest: float
    ) -> None:
        self._system, self._dt = system, dt
        self._begin = Transition(system, choice, shortest)
        self._segment = Segments(system, inner)
        self._begun: tuple[float, Begun] | None = None
        self._v: Array | None = None  # as the state that has begun was handed in
        self._ended: tuple[Array, ModeDynamics] | None = None  # q at the end of the last step

    def step(self, t: float, q: Array, v: Array) -> tuple[Array, Array, Array]:
        """Return q and v at the end of a step, and the acceleration at its start."""
        system, end, events = self._system, t + self._dt, list[ContactEvent]()
        now = self._at(t, q, v)
        dynamics, a = self._dynamics_before(q) or now.dynamics, now.held.a
        for _ in range(_MOST):
            self._count(events, dynamics, v, now)
            segment, dynamics = self._segment.take(now, end), now.dynamics
            system.contact_work = system.contact_work.more(contact=segment.work)
            is_last = end - segment.t <= _NOTHING * self._dt
            q, v = self._closed(segment, dynamics)
            if segment.is_event or not is_last:
                t1 = end if is_last else float(segment.t)
                now = self._begin.at(t1, q, v, at_end=segment.at_end)
            if is_last:
                if segment.is_event:
                    self._count(events, dynamics, v, now)
                    v, dynamics = now.terms.v, now.dynamics
                    self._keep(end, q, v, now.without_impulse())
                self._ended, system.located = (q, dynamics), tuple(events)
                return q, v, a
        raise ZenoDetected(
            f"more than {_MOST} segments from t = {t:g} s to {end:g} s: events pile up; "
            "take a longer shortest_bounce, or a stepper, such as StewartTrinkle()"
        )

    def sample(self, t: float, q: Array, v: Array) -> Row:
        """Return a sample of a state: with what contacts do from there on."""
        now = self._at(t, q, v)
        return self._row(t, q, v, now.dynamics, now.held, now.natural)

    def _at(self, t: float, q: Array, v: Array) -> Begun:
        """Return how motion goes on from a state; that of the last one asked for is known."""
        if self._begun is not None:
            at, begun = self._begun
            if q is begun.terms.q and v is self._v and isclose(t, at, rel_tol=1e-14):
                return begun
        begun = self._begin.at(t, q, v)
        self._keep(t, q, v, begun)
        return begun

    def _keep(self, t: float, q: Array, v: Array, begun: Begun) -> None:
        self._begun, self._v = (t, begun), v

    def _dynamics_before(self, q: Array) -> ModeDynamics | None:
        """Return what was held at the end of the step before, if this one goes on from there."""
        return self._ended[1] if self._ended is not None and self._ended[0] is q else None

    def _count(
        self, events: list[ContactEvent], dynamics: ModeDynamics, v: Array, now: Begun
    ) -> None:
        """Count what happens in the instant in which modes change, with the velocity v."""
        system = self._system
        system.contact_work = system.contact_work.more(contact=now.work)
        back = dynamics.reversed_in(now.dynamics, now.terms.t)
        if now.what or back.any() or (dynamics.modes != now.dynamics.modes).any():
            terms = ContactTerms(system, now.terms.t, now.terms.q, v)
            events.append(self._event(dynamics, terms, now, back))

    def _event(
        self, dynamics: ModeDynamics, terms: ContactTerms, now: Begun, back: NDArray[np.bool_]
    ) -> ContactEvent:
        """Return what happened between the old modes and the new ones, and what slides `back`."""
        t, work = terms.t, self._system.contact_work
        before = self._row(
            t,
            terms.q,
            terms.v,
            dynamics,
            dynamics.solve(terms),
            0.0,
            work.more(contact=-now.work),
        )
        after = self._row(t, terms.q, now.terms.v, now.dynamics, now.held, now.natural)
        modes = dynamics.modes, now.dynamics.modes
        candidates = self._system.contacts
        return ContactEvent(
            now.what, candidates, modes, back, now.impulse, 0.0 - now.work, before, after,
            now.driven,
        )  # fmt: skip

    def _row(
        self, t: float, q: Array, v: Array, dynamics: ModeDynamics, held: Held, natural: float,
        work: ContactWork | None = None,
    ) -> Row:  # fmt: skip
        work = self._system.contact_work if work is None else work
        lam = np.concatenate((held.of_constraints, held.lam))
        touch, is_driven = np.zeros(0), self._system.scene.is_driven
        if len(dynamics.modes):
            touch = touch_of(natural, work, dynamics.modes, is_driven=is_driven)
        return t, q, v, held.a, lam, self._system.applied.at_sample(t, q, v), touch

    def _closed(self, segment: Segment, dynamics: ModeDynamics) -> tuple[Array, Array]:
        """Return the end of a segment with what is held closed, and still, to rounding."""
        system, q, least = self._system, segment.q, inf
        if not len(dynamics.still) and not system.scene.rows:
            return segment.q, segment.v
        system.at(segment.t)
        rates = system.equations.wanted[1].copy()
        candidates, best = system.contacts, segment.q
        lines = candidates.cones + candidates.half_lines
        pressing = np.flatnonzero(dynamics.modes[:lines] != OPEN)
        for _ in range(_CLOSINGS):
            c = system.equations.violation(q)
            gaps = candidates.gaps(system.equations.data, q)[pressing]
            c = np.concatenate((c, gaps))
            worst = float(np.abs(c).max(initial=0.0))
            if not worst < least:
                break
            best, least = q, worst
            if worst <= _CLOSED:
                break
            q = system.integrate(q, self._factors(q, candidates.normals[pressing]).closing(c))
        rates = np.concatenate((rates, np.zeros(len(dynamics.still))))
        return best, self._factors(best, dynamics.still).at_rates(segment.v, rates)

    def _factors(self, q: Array, rows: Indices) -> MinimumNorm:
        """Return those of constraints and rows of contacts."""
        system, equations = self._system, self._system.equations
        J_b = equations.consistent_jacobian(q)
        run = algorithms(equations.data)
        run.computeJointJacobians(system.model, equations.data, q)
        J = np.concatenate((J_b, system.contacts.evaluate(equations.data, q)[1][rows]))
        why = singular_mass(system.model, q)
        return factorise(system.mass(q), J, tolerances.RANK, why=why)
