"""Segments: smooth motion by an integrator, up to the first event."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core.arrays import Array
from condyn_pin.contact.problem import SLIDE
from condyn_pin.simulation.between_events.contact_terms import ContactTerms
from condyn_pin.simulation.between_events.margins import Margins, fallen, margins
from condyn_pin.simulation.between_events.mode_dynamics import Held, ModeDynamics
from condyn_pin.simulation.between_events.slip_guide import Guide, SlipGuide
from condyn_pin.simulation.between_events.smooth_motion import SmoothMotion
from condyn_pin.simulation.between_events.transition import Begun
from condyn_pin.simulation.integrators.base import Integrator
from condyn_pin.simulation.system import System

# Where an event is found, as a share of a segment.
_FOUND = 1e-14

# How often the rates at which guided slips turn are corrected, and the angle by which one has to
# turn for the others to say how they depend on it [rad].
_CORRECTED = 8
_TURNED = 1e-5

# Segments are not halved below this share of a step.
_SHORTEST = 1e-9


class Segment(NamedTuple):
    """The end of a segment.

    Attributes
    ----------
    t, q, v
        The state there.
    work : float
        Of friction on the way [J].
    is_event : bool
        Whether something has come to its end there.
    at_end : bool
        Whether that is the force of a contact.
    """

    t: float
    q: Array
    v: Array
    work: float
    is_event: bool
    at_end: bool


class _Try(NamedTuple):
    """A segment of some size: its size, its end, and forces and margins there."""

    h: float
    terms: ContactTerms
    held: Held
    margins: Margins


class Segments:
    """Segments of one system by one integrator."""

    def __init__(self, system: System, inner: Integrator) -> None:
        self._system, self._inner, self._candidates = system, inner, system.contacts
        self._guide = SlipGuide(system.contacts)

    def take(self, now: Begun, end: float) -> Segment:
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

    def _guided(self, now: Begun, guide: Guide) -> tuple[ModeDynamics, _Try, NDArray[np.bool_]]:
        """Return a segment whose guided slips turn as they have to, and which of them are off.

        By Newton's method on the rates; how speeds across slips depend on them is found at once.
        """
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

    def _turned(self, now: Begun, guide: Guide, turning: Array) -> tuple[ModeDynamics, _Try, Array]:
        """Return a segment whose guided slips turn at some rates, and how fast they end across."""
        dynamics = now.dynamics
        if guide.guided.any():
            dynamics = dynamics.guiding(guide.guided, turning.copy(), now.terms.t)
        made = self._moved(now, dynamics, guide.h, 1.0)
        return dynamics, made, self._guide.across(dynamics, made.terms)

    def _moved(self, now: Begun, dynamics: ModeDynamics, h: float, share: float) -> _Try:
        """Return where a share of a segment leads to."""
        terms, size = now.terms, share * h
        if size:
            smooth = SmoothMotion(self._system, dynamics, terms.q, terms.v, now.held.a)
            q, v, _ = self._inner.start(smooth, size).step(terms.t, terms.q, terms.v)
            terms = ContactTerms(self._system, terms.t + size, q, v)
        held = dynamics.solve(terms)
        return _Try(
            size, terms, held, margins(self._candidates, dynamics, now.terms, terms, held, share)
        )

    def _share(
        self, now: Begun, dynamics: ModeDynamics, made: _Try, part: int, i: int
    ) -> tuple[float, int]:
        """Return at which share of a segment a margin is zero, and which one it is."""
        from scipy.optimize import brentq

        begun = margins(self._candidates, dynamics, now.terms, now.terms, now.held, 0.0)
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

    def _work(self, now: Begun, dynamics: ModeDynamics, made: _Try) -> float:
        """Return the work of friction on a segment [J], by Simpson's rule.

        The state in the middle is that of the cubic through both ends and their slopes.
        """
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
