"""ContactLeg: smooth motion by an integrator, up to the first event."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.contact.modes import SLIDE
from condyn_pin.simulation.integrators.base import Integrator
from condyn_pin.simulation.integrators.contact_begin import Begun
from condyn_pin.simulation.integrators.contact_hold import ContactHold, Held
from condyn_pin.simulation.integrators.contact_look import ContactLook
from condyn_pin.simulation.integrators.contact_margins import Margins, fallen, margins
from condyn_pin.simulation.integrators.slip_guide import Guide, SlipGuide
from condyn_pin.simulation.integrators.smooth_motion import SmoothMotion
from condyn_pin.simulation.system import System

# Where an event is found, as a share of a leg.
_FOUND = 1e-14

# How often the rates at which guided slips turn are corrected, and the angle by which one has to
# turn for the others to say how they depend on it [rad].
_CORRECTED = 8
_TURNED = 1e-5

# Legs are not halved below this share of a step.
_SHORTEST = 1e-9


class Leg(NamedTuple):
    """The end of a leg.

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
    """A leg of some size: its size, its end, and forces and margins there."""

    h: float
    look: ContactLook
    held: Held
    margins: Margins


class ContactLeg:
    """Legs of one system by one integrator."""

    def __init__(self, system: System, inner: Integrator) -> None:
        self._system, self._inner, self._candidates = system, inner, system.contacts
        self._guide = SlipGuide(system.contacts)

    def take(self, now: Begun, end: float) -> Leg:
        """Return the end of a leg from a state to the first event, or to a time."""
        left = end - now.look.t
        bent = np.zeros(self._candidates.cones, dtype=bool)
        guide, most = self._guide.before(now, left, bent), left
        while True:
            hold, made, off = self._guided(now, guide)
            if (off & guide.ends).any():
                bent |= off & guide.ends
                guide = self._guide.before(now, most, bent)
                continue
            again = off.any() or self._guide.has_turned(hold, made.look)
            if again and guide.h > _SHORTEST * left:
                most = guide.h / 2
                guide = self._guide.before(now, most, bent)
                continue
            fell = fallen(made.margins, made.held, made.look, now.look)
            share, part = 1.0, -1
            if fell:
                share, part = min(self._share(now, hold, made, *each) for each in fell)
                made = self._moved(now, hold, guide.h, share)
            t1 = end if made.h == left else now.look.t + made.h
            work = self._work(now, hold, made)
            return Leg(t1, made.look.q, made.look.v, work, bool(fell), part in (1, 2, 3))

    def _guided(self, now: Begun, guide: Guide) -> tuple[ContactHold, _Try, NDArray[np.bool_]]:
        """Return a leg whose guided slips turn as they have to, and which of them are off.

        By Newton's method on the rates; how speeds across slips depend on them is looked at once.
        """
        turning, slopes = np.zeros(len(guide.guided)), None
        hold, made, across = self._turned(now, guide, turning)
        which = np.flatnonzero(guide.guided & ~guide.ends)
        for _ in range(_CORRECTED):
            off = self._guide.is_off(guide, across, made.look)
            if not off[which].any():
                break
            if slopes is None:
                each = np.eye(len(turning))[which] * (_TURNED / guide.h)
                changed = [self._turned(now, guide, turning + one)[2] - across for one in each]
                slopes = np.array(changed)[:, which].T * (guide.h / _TURNED)
            turning[which] -= np.linalg.lstsq(slopes, across[which], rcond=None)[0]
            hold, made, across = self._turned(now, guide, turning)
        return hold, made, self._guide.is_off(guide, across, made.look)

    def _turned(self, now: Begun, guide: Guide, turning: Array) -> tuple[ContactHold, _Try, Array]:
        """Return a leg whose guided slips turn at some rates, and how fast they end across."""
        hold = now.hold
        if guide.guided.any():
            hold = hold.guiding(guide.guided, turning.copy(), now.look.t)
        made = self._moved(now, hold, guide.h, 1.0)
        return hold, made, self._guide.across(hold, made.look)

    def _moved(self, now: Begun, hold: ContactHold, h: float, share: float) -> _Try:
        """Return where a share of a leg leads to."""
        look, size = now.look, share * h
        if size:
            smooth = SmoothMotion(self._system, hold, look.q, look.v, now.held.a)
            q, v, _ = self._inner.start(smooth, size).step(look.t, look.q, look.v)
            look = ContactLook(self._system, look.t + size, q, v)
        held = hold.solve(look)
        return _Try(size, look, held, margins(self._candidates, hold, now.look, look, held, share))

    def _share(
        self, now: Begun, hold: ContactHold, made: _Try, part: int, i: int
    ) -> tuple[float, int]:
        """Return at which share of a leg a margin is zero, and which one it is."""
        from scipy.optimize import brentq

        begun = margins(self._candidates, hold, now.look, now.look, now.held, 0.0)
        first, last = float(begun[part][i]), float(made.margins[part][i])
        if part == 0 and now.look.touches[i]:  # its gap over no share at all
            first = max(made.h * float(now.look.closing[i]), -last * _FOUND)
        if not first > 0:
            return 0.0, part

        def value(share: float) -> float:
            if share in (0.0, 1.0):
                return last if share else first
            return float(self._moved(now, hold, made.h, share).margins[part][i])

        return float(brentq(value, 0.0, 1.0, xtol=_FOUND, rtol=_FOUND)), part

    def _work(self, now: Begun, hold: ContactHold, made: _Try) -> float:
        """Return the work of friction on a leg [J], by Simpson's rule.

        The state in the middle is that of the cubic through both ends and their slopes.
        """
        start, end = now.held.lam.dot(now.look.slip), made.held.lam.dot(made.look.slip)
        if not made.h or not (len(hold.sliding) or (hold.of_dry == SLIDE).any()):
            return 0.0
        system, h, (look, look1) = self._system, made.h, (now.look, made.look)
        theta = np.asarray(pin.difference(system.model, look.q, look1.q))
        theta = theta / 2 + h / 8 * (look.v - system.rate(theta, look1.v))
        v = (look.v + look1.v) / 2 + h / 8 * (now.held.a - made.held.a)
        middle = ContactLook(system, look.t + h / 2, system.integrate(look.q, theta), v)
        power = hold.solve(middle).lam.dot(middle.slip)
        return h / 6 * float(start + 4 * power + end)
