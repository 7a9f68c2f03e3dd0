"""SlipGuide: how long a segment may be while contacts slide, and which slips are guided in it.

Across its direction s a slip of the speed r follows the forces f by friction k = mu lam_n G_tt,

    (r s)' . n = f . n - k s . n,        n across s,

at the rate k / r: the slower, the stiffer. What begins to slide passes through that, and so does
what ends.

    begins, or is slow      guided: s turns evenly to where the slip goes at the end of the segment
    ends without turning    guided along a line: it goes through zero smoothly, and that is located
    ends and turns          the faster the slower it is: it turns by little in each, and loses
                            a quarter of its speed, until it would end within a nanosecond

That s is the direction of the slip at both ends makes it the trapezoidal rule, which is stable
however stiff the slip is.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core.arrays import Array
from condyn_pin.constraints.contacts.candidates import Candidates
from condyn_pin.contact.problem import SLIDE
from condyn_pin.simulation.between_events.contact_terms import ContactTerms
from condyn_pin.simulation.between_events.mode_dynamics import Held, ModeDynamics
from condyn_pin.simulation.between_events.transition import Begun

# By how much a slip may turn in a segment [rad], as its rate at the start says, and how far it may
# end from where it began (cosine) before the segment is taken again, half as long.
_TURN = 0.1
_TURNED = 0.95

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
_FOUND, _ROUNDED = 1e-10, 1e-13


class Guide(NamedTuple):
    """What to do in a segment.

    Attributes
    ----------
    h : float
        The longest that it may be [s].
    guided, ends : (cones,) bool array
        Which slips are guided, and which of them along a line to their end.
    """

    h: float
    guided: NDArray[np.bool_]
    ends: NDArray[np.bool_]


class SlipGuide:
    """Guides the slips of one system."""

    def __init__(self, candidates: Candidates) -> None:
        self._candidates = candidates

    def before(self, now: Begun, left: float, bent: NDArray[np.bool_]) -> Guide:
        """Return what to do in a segment of `left` seconds at most.

        `bent` are those that were taken to end along a line, and do not.
        """
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
        return Guide(left, guided, ending)

    def has_turned(self, dynamics: ModeDynamics, end: ContactTerms) -> bool:
        """Whether a slip that is not guided has changed its direction by more than it may."""
        on = np.einsum("kx,kx->k", dynamics.along, end.tangent)
        turned = end.slides & (on < _TURNED * end.speed)
        return bool((self._rough(dynamics) & ~dynamics.guided & turned).any())

    def across(self, dynamics: ModeDynamics, end: ContactTerms) -> Array:
        """Return how fast a guided slip is across its direction at the end (cones,) [m/s]."""
        s, v = dynamics.ahead(end.t), end.tangent
        return np.where(dynamics.guided, s[:, 0] * v[:, 1] - s[:, 1] * v[:, 0], 0.0)

    def is_off(self, guide: Guide, across: Array, end: ContactTerms) -> NDArray[np.bool_]:
        """Return for which cones that is more than nothing."""
        found = np.maximum(_FOUND * end.speed, _ROUNDED * end.fastest)
        return np.asarray(np.abs(across) > np.where(guide.ends, _NONE * end.fastest, found))

    def _rough(self, dynamics: ModeDynamics) -> NDArray[np.bool_]:
        return np.asarray((dynamics.of_cones == SLIDE) & (self._candidates.friction > 0))

    def _pulls(self, held: Held) -> Array:
        """Return what friction at its limit accelerates each cone by (cones,) [m/s^2]."""
        cones = 3 * self._candidates.cones
        normal, ease = held.lam[2:cones:3], held.ease[:cones].reshape(-1, 3)[:, :2]
        return np.asarray(self._candidates.friction * normal * ease.max(axis=1, initial=0.0))
