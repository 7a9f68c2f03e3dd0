"""ContactLeg: smooth motion by an integrator, up to the first event.

What slides slowly is stiff across its direction (`ContactHold`). A slip that begins or ends without
turning is held straight: it goes through zero smoothly, and its end is located as that of a gap is.
One that turns does so the faster the slower it is: legs are so short that it turns by little, that
an explicit method is stable, and that it loses a quarter of its speed, until what is left of it
would end within a nanosecond.
"""

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
from condyn_pin.simulation.integrators.smooth_motion import SmoothMotion
from condyn_pin.simulation.system import System

# Where an event is found, as a share of a leg.
_FOUND = 1e-14

# By how much a slip may turn in a leg [rad], as its rate at the start says, and how far it may end
# from where it began (cosine) before the leg is taken again, half as long.
_TURN = 0.1
_TURNED = 0.95

# Share of the time to its end that a slip which turns goes on for in a leg.
_SLOWED = 0.25

# A slip is stiff where its direction would follow the forces within this share of a leg.
_STIFF = 0.5

# Acceleration across a slip, relative to that of friction, with which it does not turn. What is
# held back in a leg would have become a speed across it, which is none [m/s], relative to the speed
# of the robot where it is faster.
_STRAIGHT = 1e-9
_HELD_BACK = 1e-9

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

    def take(self, now: Begun, end: float) -> Leg:
        """Return the end of a leg from a state to the first event, or to a time."""
        left = end - now.look.t
        turning = np.zeros(self._candidates.cones, dtype=bool)
        h, straight = self._size(now, left, turning)
        while True:
            hold = now.hold.going_straight(straight) if straight.any() else now.hold
            made = self._moved(now, hold, h, 1.0)
            if self._has_turned(now, made, straight) and h > _SHORTEST * left:
                h /= 2
                continue
            fell = fallen(made.margins, made.held, made.look, now.look)
            share, part = 1.0, -1
            if fell:
                share, part = min(self._share(now, hold, made, *each) for each in fell)
                made = self._moved(now, hold, h, share)
            bent = straight & self._is_bent(now, made)
            if bent.any() and h > _SHORTEST * left:
                turning |= bent & now.look.slides
                h, straight = self._size(now, left if (bent & turning).any() else h / 2, turning)
                continue
            t1 = end if share * h == left else now.look.t + share * h
            work = self._work(now, hold, made)
            return Leg(t1, made.look.q, made.look.v, work, bool(fell), part in (1, 2, 3))

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

    def _size(
        self, now: Begun, left: float, turning: NDArray[np.bool_]
    ) -> tuple[float, NDArray[np.bool_]]:
        """Return how long a leg may be [s], and which cones slide straight to their end in it."""
        cones, straight, look = self._candidates.cones, np.zeros_like(turning), now.look
        rates = now.held.rate[: 3 * cones].reshape(-1, 3)[:, :2]
        rough = (now.hold.of_cones == SLIDE) & (self._candidates.friction > 0)
        friction = float(self._pulls(now.held)[rough].sum())
        for i in np.flatnonzero(rough):
            speed, s = look.speed[i] if look.slides[i] else 0.0, now.hold.along[i]
            ahead = float(s.dot(rates[i]))
            across = abs(float(s[0] * rates[i, 1] - s[1] * rates[i, 0]))
            ends = ahead < 0 and speed < -2 * ahead * left
            stiff = speed < _STIFF * friction * left
            if not speed or ((ends or stiff) and not turning[i] and across <= _STRAIGHT * friction):
                straight[i] = True
                continue
            if across * left > _TURN * speed:
                left = _TURN * speed / across
            if ends:
                left = min(left, -_SLOWED * speed / ahead)
            left = min(left, speed / (_STIFF * friction)) if stiff else left
        return left, straight

    def _pulls(self, held: Held) -> Array:
        """Return what friction at its limit accelerates each cone by (cones,) [m/s^2]."""
        cones = 3 * self._candidates.cones
        normal, ease = held.lam[2:cones:3], held.ease[:cones].reshape(-1, 3)[:, :2]
        return np.asarray(self._candidates.friction * normal * ease.max(axis=1, initial=0.0))

    def _has_turned(self, now: Begun, made: _Try, straight: NDArray[np.bool_]) -> bool:
        """Whether the direction of a slip has changed by more than a leg may."""
        rough = (now.hold.of_cones == SLIDE) & (self._candidates.friction > 0) & ~straight
        on = np.einsum("kx,kx->k", now.hold.along, made.look.tangent)
        turned = made.look.slides & (on < _TURNED * made.look.speed)
        return bool((rough & turned).any())

    def _is_bent(self, now: Begun, made: _Try) -> NDArray[np.bool_]:
        """Return which slips would have left their line, had they not been held."""
        cones = 3 * self._candidates.cones
        F, ease = (x[:cones].reshape(-1, 3)[:, :2] for x in (made.held.lam, made.held.ease))
        s = now.hold.along
        across = np.abs(s[:, 0] * F[:, 1] - s[:, 1] * F[:, 0]) * ease.max(axis=1, initial=0.0)
        return np.asarray(across * made.h > _HELD_BACK * now.look.fastest)

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
