"""EventSteps: steps of one size, with the events of contacts located within them.

    begin      what has to happen in an instant, and the modes that go on       ContactBegin
    leg        smooth motion by an integrator, until a margin falls to zero     ContactLeg
    close      what is held is closed, and moves along itself, to rounding

until the step is over. A step knows nothing but the state that it begins with: one that is taken
back, or taken again in parts, as events of the user ask for, finds the same.
"""

from __future__ import annotations

from math import inf, isclose

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array, Indices
from condyn_pin._core.linalg.minimum_norm import MinimumNorm, factorise
from condyn_pin.contact.modes import OPEN
from condyn_pin.contact.solvers.base import ContactSolver
from condyn_pin.model.soundness import singular_mass
from condyn_pin.simulation.contact_event import ContactEvent
from condyn_pin.simulation.contact_record import touch_of
from condyn_pin.simulation.events import ZenoDetected
from condyn_pin.simulation.integrators.base import Integrator
from condyn_pin.simulation.integrators.contact_begin import Begun, ContactBegin
from condyn_pin.simulation.integrators.contact_hold import ContactHold, Held
from condyn_pin.simulation.integrators.contact_leg import ContactLeg, Leg
from condyn_pin.simulation.integrators.contact_look import ContactLook
from condyn_pin.simulation.recorder import Row
from condyn_pin.simulation.system import System

# Legs of one step, at most. A ball that comes to rest in it makes some hundred.
_MOST = 1000

# Newton's steps that close what is held, at most, and what they leave [m, rad].
_CLOSINGS = 5
_CLOSED = 1e-14

# What is left of a step, as a share of it, that is no leg.
_NOTHING = 1e-12


class EventSteps:
    """The steps of one system with contacts."""

    def __init__(
        self, system: System, dt: float, inner: Integrator, solver: ContactSolver, shortest: float
    ) -> None:
        self._system, self._dt = system, dt
        self._begin = ContactBegin(system, solver, shortest)
        self._leg = ContactLeg(system, inner)
        self._begun: tuple[float, Begun] | None = None
        self._v: Array | None = None  # as the state that has begun was handed in
        self._ended: tuple[Array, ContactHold] | None = None  # q at the end of the last step

    def step(self, t: float, q: Array, v: Array) -> tuple[Array, Array, Array]:
        """Return q and v at the end of a step, and the acceleration at its start."""
        system, end, events = self._system, t + self._dt, list[ContactEvent]()
        now = self._at(t, q, v)
        hold, a = self._hold_before(q) or now.hold, now.held.a
        for _ in range(_MOST):
            self._count(events, hold, v, now)
            leg, hold = self._leg.take(now, end), now.hold
            system.contact_work += leg.work
            is_last = end - leg.t <= _NOTHING * self._dt
            q, v = self._closed(leg, hold)
            if leg.is_event or not is_last:
                t1 = end if is_last else float(leg.t)
                now = self._begin.at(t1, q, v, at_end=leg.at_end)
            if is_last:
                if leg.is_event:
                    self._count(events, hold, v, now)
                    v, hold = now.look.v, now.hold
                    self._keep(end, q, v, now.without_impulse())
                self._ended, system.located = (q, hold), tuple(events)
                return q, v, a
        raise ZenoDetected(
            f"more than {_MOST} legs from t = {t:g} s to {end:g} s: events of contacts pile up; "
            "take a longer shortest_bounce, or a stepper, such as StewartTrinkle()"
        )

    def sample(self, t: float, q: Array, v: Array) -> Row:
        """Return a sample of a state: with what contacts do from there on."""
        now = self._at(t, q, v)
        return self._row(t, q, v, now.hold, now.held, now.natural)

    def _at(self, t: float, q: Array, v: Array) -> Begun:
        """Return how motion goes on from a state; that of the last one asked for is known."""
        if self._begun is not None:
            at, begun = self._begun
            if q is begun.look.q and v is self._v and isclose(t, at, rel_tol=1e-14):
                return begun
        begun = self._begin.at(t, q, v)
        self._keep(t, q, v, begun)
        return begun

    def _keep(self, t: float, q: Array, v: Array, begun: Begun) -> None:
        self._begun, self._v = (t, begun), v

    def _hold_before(self, q: Array) -> ContactHold | None:
        """Return what was held at the end of the step before, if this one goes on from there."""
        return self._ended[1] if self._ended is not None and self._ended[0] is q else None

    def _count(self, events: list[ContactEvent], hold: ContactHold, v: Array, now: Begun) -> None:
        """Count what happens in an instant that a hold ends in, with the velocity v."""
        self._system.contact_work += now.work
        if now.what or (hold.modes != now.hold.modes).any():
            look = ContactLook(self._system, now.look.t, now.look.q, v)
            events.append(self._event(hold, look, now))

    def _event(self, hold: ContactHold, look: ContactLook, now: Begun) -> ContactEvent:
        """Return what happened between the end of a hold and what goes on."""
        t, work = look.t, self._system.contact_work
        before = self._row(t, look.q, look.v, hold, hold.solve(look), 0.0, work - now.work)
        after = self._row(t, look.q, now.look.v, now.hold, now.held, now.natural)
        modes = hold.modes, now.hold.modes
        candidates = self._system.contacts
        return ContactEvent(now.what, candidates, modes, now.impulse, 0.0 - now.work, before, after)

    def _row(
        self, t: float, q: Array, v: Array, hold: ContactHold, held: Held, natural: float,
        work: float | None = None,
    ) -> Row:  # fmt: skip
        work = self._system.contact_work if work is None else work
        lam = np.concatenate((held.of_constraints, held.lam))
        touch = touch_of(natural, work, hold.modes) if len(hold.modes) else np.zeros(0)
        return t, q, v, held.a, lam, self._system.applied.at_sample(t, q, v), touch

    def _closed(self, leg: Leg, hold: ContactHold) -> tuple[Array, Array]:
        """Return the end of a leg with what is held closed, and still, to rounding."""
        system, q, least = self._system, leg.q, inf
        if not len(hold.still) and not system.scene.rows:
            return leg.q, leg.v
        candidates, best = system.contacts, leg.q
        lines = candidates.cones + candidates.half_lines
        pressing = np.flatnonzero(hold.modes[:lines] != OPEN)
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
        return best, self._factors(best, hold.still).tangent(leg.v)

    def _factors(self, q: Array, rows: Indices) -> MinimumNorm:
        """Return those of constraints and rows of contacts."""
        system, equations = self._system, self._system.equations
        J_b = equations.jacobian(q)
        pin.computeJointJacobians(system.model, equations.data, q)
        J = np.concatenate((J_b, system.contacts.evaluate(equations.data, q)[1][rows]))
        why = singular_mass(system.model, q)
        return factorise(system.mass(q), J, tolerances.RANK, why=why)
