"""EventSteps: steps of one size, with the events of contacts located within them.

    begin      what has to happen in an instant, and the modes that go on       Transition
    segment        smooth motion by an integrator, until a margin falls to zero     Segments
    close      what is held is closed, and moves along itself, to rounding

until the step is over. A step knows nothing but the state that it begins with: one that is taken
back, or taken again in parts, as events of the user ask for, finds the same.
"""

from __future__ import annotations

from math import inf, isclose
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array, Indices
from condyn_pin._core.linalg import MinimumNorm, factorise
from condyn_pin._core.models import algorithms
from condyn_pin.constraints.contacts.candidates import Candidates
from condyn_pin.contact.problem import OPEN, SLIDE
from condyn_pin.model.soundness import singular_mass
from condyn_pin.simulation.events import ContactEvent, ZenoDetected
from condyn_pin.simulation.integrators.integrator import Integrator, StepEffects
from condyn_pin.simulation.records import NO_WORK, ContactWork, Row, touch_of
from condyn_pin.simulation.system import System
from condyn_pin.stepping.modes import (
    ContactTerms,
    FixedModes,
    Margins,
    ModeDynamics,
    fallen,
    mode_margins,
)
from condyn_pin.stepping.transition import NextModes, PhaseStart, Transition

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
        self._begun: tuple[float, PhaseStart] | None = None
        self._v: Array | None = None  # as the state that has begun was handed in
        self._ended: tuple[Array, ModeDynamics] | None = None  # q at the end of the last step
        # work [J] of the parts of the last step, in turn, each with its event if it is one
        self._parts: list[tuple[float, ContactEvent | None]] = []

    def step(self, t: float, q: Array, v: Array) -> tuple[Array, Array, Array]:
        """Return q and v at the end of a step, and the acceleration at its start."""
        end, notes = t + self._dt, self._begin.notes
        self._parts.clear()
        now = self._at(t, q, v)
        notes[:] = [note for note in notes if note[0] >= t]  # others were of the step before
        dynamics, a = self._dynamics_before(q) or now.dynamics, now.held.a
        for _ in range(_MOST):
            self._count(dynamics, v, now)
            segment, dynamics = self._segment.take(now, end), now.dynamics
            self._parts.append((segment.work, None))
            is_last = end - segment.t <= _NOTHING * self._dt
            q, v = self._closed(segment, dynamics)
            if segment.is_event or not is_last:
                t1 = end if is_last else float(segment.t)
                now = self._begin.at(t1, q, v, at_end=segment.at_end)
            if is_last:
                if segment.is_event:
                    self._count(dynamics, v, now)
                    v, dynamics = now.terms.v, now.dynamics
                    self._keep(end, q, v, now.without_impulse())
                self._ended = q, dynamics
                return q, v, a
        raise ZenoDetected(
            f"more than {_MOST} segments from t = {t:g} s to {end:g} s: events pile up; "
            "take a longer shortest_bounce, or a stepper, such as StewartTrinkle()"
        )

    def effects(self, work: ContactWork) -> StepEffects:
        """Effects of the last step, behind this work of contacts."""
        events = []
        for part, event in self._parts:
            work = work.more(contact=part)
            if event is not None:
                events.append(event.behind(work))
        return StepEffects(work, tuple(events), tuple(self._begin.notes))

    def sample(self, t: float, q: Array, v: Array, work: ContactWork = NO_WORK) -> Row:
        """Sample of a state, with the contact forces of the motion that follows."""
        now = self._at(t, q, v)
        return self._row(t, q, v, now.dynamics, now.held, now.natural, work)

    def _at(self, t: float, q: Array, v: Array) -> PhaseStart:
        """Start of the smooth motion from a state; that of the last state is cached."""
        if self._begun is not None:
            at, begun = self._begun
            if q is begun.terms.q and v is self._v and isclose(t, at, rel_tol=1e-14):
                return begun
        self._begin.notes.clear()
        begun = self._begin.at(t, q, v)
        self._keep(t, q, v, begun)
        return begun

    def _keep(self, t: float, q: Array, v: Array, begun: PhaseStart) -> None:
        self._begun, self._v = (t, begun), v

    def _dynamics_before(self, q: Array) -> ModeDynamics | None:
        """Contact dynamics at the end of the step before, if this step begins there."""
        return self._ended[1] if self._ended is not None and self._ended[0] is q else None

    def _count(self, dynamics: ModeDynamics, v: Array, now: PhaseStart) -> None:
        """Count what happens in the instant in which modes change, with the velocity v."""
        back, event = dynamics.reversed_in(now.dynamics, now.terms.t), None
        if now.what or back.any() or (dynamics.modes != now.dynamics.modes).any():
            terms = ContactTerms(self._system, now.terms.t, now.terms.q, v)
            event = self._event(dynamics, terms, now, back)
        self._parts.append((now.work, event))

    def _event(
        self, dynamics: ModeDynamics, terms: ContactTerms, now: PhaseStart, back: NDArray[np.bool_]
    ) -> ContactEvent:
        """Event between old and new modes; `back` flags reversed slips."""
        t = terms.t
        before = self._row(t, terms.q, terms.v, dynamics, dynamics.solve(terms), 0.0)
        after = self._row(t, terms.q, now.terms.v, now.dynamics, now.held, now.natural)
        modes = dynamics.modes, now.dynamics.modes
        candidates = self._system.contacts
        return ContactEvent(
            what=now.what, candidates=candidates, modes=modes, back=back, impulse=now.impulse,
            energy_lost=0.0 - now.work, before=before, after=after, driven=now.driven,
        )  # fmt: skip

    def _row(
        self, t: float, q: Array, v: Array, dynamics: ModeDynamics, held: FixedModes,
        natural: float, work: ContactWork = NO_WORK,
    ) -> Row:  # fmt: skip
        lam = np.concatenate((held.of_constraints, held.lam))
        touch, is_driven = np.zeros(0), self._system.scene.is_driven
        if len(dynamics.modes):
            touch = touch_of(natural, work, dynamics.modes, is_driven=is_driven)
        return t, q, v, held.a, lam, self._system.applied.at_sample(t, q, v), touch

    def _closed(self, segment: Segment, dynamics: ModeDynamics) -> tuple[Array, Array]:
        """End of a segment, with held contacts closed and at rest to rounding."""
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
        """Factors of the constraints and rows of contacts."""
        system, equations = self._system, self._system.equations
        J_b = equations.consistent_jacobian(q)
        run = algorithms(equations.data)
        run.computeJointJacobians(system.model, equations.data, q)
        J = np.concatenate((J_b, system.contacts.evaluate(equations.data, q)[1][rows]))
        why = singular_mass(system.model, q)
        return factorise(system.mass(q), J, tolerances.RANK, why=why)


# Segments: smooth motion by an integrator, up to the first event.


# Where an event is found, as a share of a segment.
_FOUND = 1e-14

# How often the rates at which guided slips turn are corrected, and the angle by which one has to
# turn for the others to say how they depend on it [rad].
_CORRECTED = 8
_TURNED = 1e-5

# Segments are not halved below this share of a step.
_SHORTEST = 1e-9


class Segment(NamedTuple):
    """The end of a segment."""

    # t, q, v: the state there
    t: float
    q: Array
    v: Array
    work: float  # of friction on the way [J]
    is_event: bool  # whether something has come to its end there
    at_end: bool  # whether that is the force of a contact


class _SegmentAttempt(NamedTuple):
    """A segment of some size: its size, its end, and forces and margins there."""

    h: float
    terms: ContactTerms
    held: FixedModes
    margins: Margins


class Segments:
    """Segments of one system by one integrator."""

    def __init__(self, system: System, inner: Integrator) -> None:
        self._system, self._inner, self._candidates = system, inner, system.contacts
        self._guide = SlipGuide(system.contacts)

    def take(self, now: PhaseStart, end: float) -> Segment:
        """Return the end of a segment from a state to the first event, or to a time."""
        left = end - now.terms.t
        bent = np.zeros(self._candidates.cones, dtype=bool)
        guide, most = self._guide.before(now, left, bent), left
        while True:
            dynamics, made, off = self._guided(now, guide)
            if (off & guide.ends).any():
                bent |= off & guide.ends
                guide = self._guide.before(now, most, bent)
                continue
            again = off.any() or self._guide.has_turned(dynamics, made.terms)
            if again and guide.h > _SHORTEST * left:
                most = guide.h / 2
                guide = self._guide.before(now, most, bent)
                continue
            fell = fallen(made.margins, made.held, made.terms, now.terms)
            share, part = 1.0, -1
            if fell:
                share, part = min(self._share(now, dynamics, made, *each) for each in fell)
                made = self._moved(now, dynamics, guide.h, share)
            t1 = end if made.h == left else now.terms.t + made.h
            work = self._work(now, dynamics, made)
            return Segment(t1, made.terms.q, made.terms.v, work, bool(fell), part in (1, 2, 3))

    def _guided(
        self, now: PhaseStart, guide: SlipGuidance
    ) -> tuple[ModeDynamics, _SegmentAttempt, NDArray[np.bool_]]:
        """Segment with guided slips turned as required, and flags of those that miss."""
        # By Newton's method on the rates; how speeds across slips depend on them is found at once.
        turning, slopes = np.zeros(len(guide.guided)), None
        dynamics, made, across = self._turned(now, guide, turning)
        which = np.flatnonzero(guide.guided & ~guide.ends)
        for _ in range(_CORRECTED):
            off = self._guide.is_off(guide, across, made.terms)
            if not off[which].any():
                break
            if slopes is None:
                each = np.eye(len(turning))[which] * (_TURNED / guide.h)
                changed = [self._turned(now, guide, turning + one)[2] - across for one in each]
                slopes = np.array(changed)[:, which].T * (guide.h / _TURNED)
            turning[which] -= np.linalg.lstsq(slopes, across[which], rcond=None)[0]
            dynamics, made, across = self._turned(now, guide, turning)
        return dynamics, made, self._guide.is_off(guide, across, made.terms)

    def _turned(
        self, now: PhaseStart, guide: SlipGuidance, turning: Array
    ) -> tuple[ModeDynamics, _SegmentAttempt, Array]:
        """Segment with guided slips turned at given rates, and their final velocity across."""
        dynamics = now.dynamics
        if guide.guided.any():
            dynamics = dynamics.guiding(guide.guided, turning.copy(), now.terms.t)
        made = self._moved(now, dynamics, guide.h, 1.0)
        return dynamics, made, self._guide.across(dynamics, made.terms)

    def _moved(
        self, now: PhaseStart, dynamics: ModeDynamics, h: float, share: float
    ) -> _SegmentAttempt:
        """End of a share of a segment of length h [s], with its forces and margins."""
        terms, size = now.terms, share * h
        if size:
            smooth = SmoothMotion(self._system, dynamics, terms.q, terms.v, now.held.a)
            q, v, _ = self._inner.start(smooth, size).step(terms.t, terms.q, terms.v)
            terms = ContactTerms(self._system, terms.t + size, q, v)
        held = dynamics.solve(terms)
        return _SegmentAttempt(
            size,
            terms,
            held,
            mode_margins(self._candidates, dynamics, now.terms, terms, held, share),
        )

    def _share(
        self, now: PhaseStart, dynamics: ModeDynamics, made: _SegmentAttempt, part: int, i: int
    ) -> tuple[float, int]:
        """Share of a segment at which a margin is zero, and the part of that margin."""
        from scipy.optimize import brentq

        begun = mode_margins(self._candidates, dynamics, now.terms, now.terms, now.held, 0.0)
        first, last = float(begun[part][i]), float(made.margins[part][i])
        if part == 0 and now.terms.touches[i]:  # its gap over no share at all
            first = max(made.h * float(now.terms.closing[i]), -last * _FOUND)
        if not first > 0:
            return 0.0, part

        def value(share: float) -> float:
            if share in (0.0, 1.0):
                return last if share else first
            return float(self._moved(now, dynamics, made.h, share).margins[part][i])

        return float(brentq(value, 0.0, 1.0, xtol=_FOUND, rtol=_FOUND)), part

    def _work(self, now: PhaseStart, dynamics: ModeDynamics, made: _SegmentAttempt) -> float:
        """Return the work of friction on a segment [J], by Simpson's rule."""
        # The state in the middle is that of the cubic through both ends and their slopes.
        start, end = now.held.lam.dot(now.terms.sigma), made.held.lam.dot(made.terms.sigma)
        if not made.h or not (len(dynamics.sliding) or (dynamics.of_dry == SLIDE).any()):
            return 0.0
        system, h, (terms, last) = self._system, made.h, (now.terms, made.terms)
        manifold = system.manifold
        y = manifold.between(terms.q, last.q, h / 2 * (terms.v + last.v))
        V, A = manifold.of_start(y, last.v), manifold.straight(terms.v, now.held.a)
        rate, A1 = manifold.rates(y, V, last.v, made.held.a)
        y = y / 2 + h / 8 * (terms.v - rate)
        at, v = manifold.place(terms.q, y, (terms.v + V) / 2 + h / 8 * (A - A1))
        middle = ContactTerms(system, terms.t + h / 2, at, v)
        power = dynamics.solve(middle).lam.dot(middle.sigma)
        return h / 6 * float(start + 4 * power + end)


# SmoothMotion: a system as an integrator sees it between two events of its contacts.


class SmoothMotion(System):
    """System in the same memory, its contacts in modes that are held.

    What is known at its start is not solved for again.
    """

    def __init__(
        self, system: System, dynamics: ModeDynamics, q: Array, v: Array, a: Array
    ) -> None:
        vars(self).update(vars(system))
        self._whole, self._dynamics, self._known = system, dynamics, (q, v, a)

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        """Return a (nv,) while modes are as they are."""
        q0, v0, a0 = self._known
        if q is q0 and v is v0:
            return a0
        return self._dynamics.solve(ContactTerms(self._whole, t, q, v)).a


# SlipGuide: how long a segment may be while contacts slide, and which slips are guided in it.
#
# Across its direction s a slip of the speed r follows the forces f by friction k = mu lam_n G_tt,
#
#     (r s)' . n = f . n - k s . n,        n across s,
#
# at the rate k / r: the slower, the stiffer. What begins to slide passes through that, and so does
# what ends.
#
#     begins, or is slow      guided: s turns evenly to where the slip goes at the end of the
#     segment
#     ends without turning    guided along a line: it goes through zero smoothly, and that is
#     located
#     ends and turns          the faster the slower it is: it turns by little in each, and loses
#                             a quarter of its speed, until it would end within a nanosecond
#
# That s is the direction of the slip at both ends makes it the trapezoidal rule, which is stable
# however stiff the slip is.


# By how much a slip may turn in a segment [rad], as its rate at the start says, and how far it may
# end from where it began (cosine) before the segment is taken again, half as long.
_TURN = 0.1
_TURNED_SLIP = 0.95

# Share of the time to its end that a slip which turns goes on for in a segment.
_SLOWED = 0.25

# A slip is slow where its direction follows the forces faster than in this share of a segment.
_SLOW = 0.5

# Force across a slip, relative to friction, that counts as zero.
_STRAIGHT = 1e-9

# A speed across a slip that is zero [m/s], relative to the speed of the robot where it is faster:
# by how much a slow one may be off the direction in which friction balances the forces, and one
# that was to end along a line. What the rates at which slips turn are found to, relative to the
# slip, or to the robot where that is more.
_SETTLED, _NONE = 1e-7, 1e-9
_SLIP_FOUND, _ROUNDED = 1e-10, 1e-13


class SlipGuidance(NamedTuple):
    """Length of a segment, and the slips that are guided in it."""

    h: float  # largest length of the segment [s]
    # guided, ends (cones,): which slips are guided, and which of them along a line to their end
    guided: NDArray[np.bool_]
    ends: NDArray[np.bool_]


class SlipGuide:
    """Guides the slips of one system."""

    def __init__(self, candidates: Candidates) -> None:
        self._candidates = candidates

    def before(self, now: PhaseStart, left: float, bent: NDArray[np.bool_]) -> SlipGuidance:
        """Length and guided slips of a segment of `left` seconds at most."""
        # `bent` flags slips that were guided along a line to their end, and missed it.
        terms, rough = now.terms, self._rough(now.dynamics)
        guided, ending = np.zeros_like(rough), np.zeros_like(rough)
        rates = now.held.rate[: 3 * len(rough)].reshape(-1, 3)[:, :2]
        friction = float(self._pulls(now.held)[rough].sum())
        for i in np.flatnonzero(rough):
            speed, s = terms.speed[i] if terms.slides[i] else 0.0, now.dynamics.along[i]
            ahead = float(s.dot(rates[i]))
            across = abs(float(s[0] * rates[i, 1] - s[1] * rates[i, 0]))
            ends = ahead < 0 and 0 < speed < -2 * ahead * left
            slow = speed < _SLOW * friction * left
            line = across <= _STRAIGHT * friction
            settled = line or across * speed <= _SETTLED * terms.fastest * friction
            if (ends and line and not bent[i]) or (slow and settled and not ends):
                guided[i], ending[i] = True, ends
                continue
            if across * left > _TURN * speed:
                left = _TURN * speed / across
            if ends:
                left = min(left, -_SLOWED * speed / ahead)
            if slow:
                left = min(left, speed / (_SLOW * friction))
        return SlipGuidance(left, guided, ending)

    def has_turned(self, dynamics: ModeDynamics, end: ContactTerms) -> bool:
        """True if a slip without guidance has turned by more than the tolerance."""
        on = np.einsum("kx,kx->k", dynamics.along, end.tangent)
        turned = end.slides & (on < _TURNED_SLIP * end.speed)
        return bool((self._rough(dynamics) & ~dynamics.guided & turned).any())

    def across(self, dynamics: ModeDynamics, end: ContactTerms) -> Array:
        """Slip velocity of guided cones across their direction at the end (cones,) [m/s]."""
        s, v = dynamics.ahead(end.t), end.tangent
        return np.where(dynamics.guided, s[:, 0] * v[:, 1] - s[:, 1] * v[:, 0], 0.0)

    def is_off(self, guide: SlipGuidance, across: Array, end: ContactTerms) -> NDArray[np.bool_]:
        """Flags (cones,) of slip velocities `across` above the tolerance."""
        found = np.maximum(_SLIP_FOUND * end.speed, _ROUNDED * end.fastest)
        return np.asarray(np.abs(across) > np.where(guide.ends, _NONE * end.fastest, found))

    def _rough(self, dynamics: ModeDynamics) -> NDArray[np.bool_]:
        return np.asarray((dynamics.of_cones == SLIDE) & (self._candidates.friction > 0))

    def _pulls(self, held: FixedModes) -> Array:
        """Acceleration of each cone by friction at its limit (cones,) [m/s^2]."""
        cones = 3 * self._candidates.cones
        normal, ease = held.lam[2:cones:3], held.ease[:cones].reshape(-1, 3)[:, :2]
        return np.asarray(self._candidates.friction * normal * ease.max(axis=1, initial=0.0))
