"""ContactHold: smooth motion while no contact opens, closes, sticks or slips.

    stick    sigma' = 0 in all three rows
    slide    sigma_n' = 0,    lam_t = -mu lam_n s,    s = sigma_t / |sigma_t|
    open     lam = 0

With E the columns of the forces that are unknown, (-mu s, 1) of what slides, and W the rows of
sigma' that are zero,

    lam = E x + f,    W (G E x + G f + g) = 0.

W G E is not symmetric where something slides. What slides slowly turns the more easily the slower
it is, with a rate mu lam_n G_tt / |sigma_t|, which no explicit method follows. A slip that does not
turn is held `straight`: s is fixed, and what acts across it is balanced, not to let rounding grow.

Redundant contacts share a load in many ways: what x
changes by since modes were last found is the smallest such change.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from condyn_pin._core.arrays import Array, Indices
from condyn_pin.constraints.contacts.candidates import Candidates
from condyn_pin.contact.modes import OPEN, SLIDE, STICK, Modes
from condyn_pin.simulation.integrators.contact_look import ContactLook

# Singular values of W G E, rows and columns scaled to one, that redundant contacts leave.
_REDUNDANT = 1e-10


class Held(NamedTuple):
    """The answer of a hold at a state."""

    a: Array  # (nv,)
    lam: Array  # (rows,), of all candidates [N, N m]
    of_constraints: Array  # [N, N m]
    rate: Array  # (rows,), sigma' of all candidates [m/s^2]
    ease: Array  # (rows,), diagonal of G of what is not open [1/kg]


class ContactHold:
    """What contacts do until the next event.

    Parameters
    ----------
    candidates : Candidates
    modes : (candidates,) array of int
        Places in `MODES`.
    along : (cones, 2) array
        Where what slides goes, unit vectors; for those that have no velocity yet.
    sense : (intervals,) array
        The same of dry friction, 1 or -1.
    lam : (rows,) array
        Forces by which the modes were found.
    straight : (cones,) bool array
        Which cones slide `along` whatever their velocity says: to go through zero smoothly.
    """

    def __init__(
        self, candidates: Candidates, modes: Modes, along: Array, sense: Array, lam: Array,
        straight: Array | None = None,
    ) -> None:  # fmt: skip
        cones, lines = candidates.cones, candidates.half_lines
        self.candidates, self.modes, self.along = candidates, modes, along
        self.sense, self.lam = sense, lam
        self.straight = np.zeros(cones, dtype=bool) if straight is None else straight
        self.of_cones, self.of_dry = modes[:cones], modes[cones + lines :]
        sizes = np.repeat((3, 1), (cones, len(modes) - cones))
        self.rows: Indices = np.flatnonzero(np.repeat(modes != OPEN, sizes))
        # rows that stand still: all of what sticks, the normals of what slides
        stands = np.repeat(modes == STICK, sizes)
        stands[2 : 3 * cones : 3] |= self.of_cones == SLIDE
        self.still: Indices = np.flatnonzero(stands)
        self._place_unknowns()

    def _place_unknowns(self) -> None:
        """Find where the unknowns, and what follows from them, are among the rows."""
        candidates, rows, still = self.candidates, self.rows, self.still
        place = {row: i for i, row in enumerate(rows.tolist())}
        self.sliding: Indices = np.flatnonzero(self.of_cones == SLIDE)
        lines = self.sliding[self.straight[self.sliding]]
        count = len(still) + len(lines)
        self._W = np.zeros((count, len(rows)))
        self._W[np.arange(len(still)), [place[row] for row in still.tolist()]] = 1.0
        for k, i in enumerate(lines.tolist(), start=len(still)):
            x, y = self.along[i]
            self._W[k, place[3 * i] : place[3 * i] + 2] = -y, x
        self._t1 = np.array([place[3 * i] for i in self.sliding.tolist()], dtype=np.intp)
        column = {row: i for i, row in enumerate(still.tolist())}
        self._n = np.array([column[3 * i + 2] for i in self.sliding.tolist()], dtype=np.intp)
        dry = np.flatnonzero(self.of_dry == SLIDE)
        first = candidates.rows - candidates.intervals
        known = np.zeros(candidates.rows)
        known[first + dry] = -candidates.limits[dry] * self.sense[dry]
        self._known = known[rows]

    def going_straight(self, which: Array) -> ContactHold:
        """Return the same hold, with these cones sliding on in the direction that they have."""
        return ContactHold(
            self.candidates, self.modes, self.along, self.sense, self.lam, which
        )

    def with_forces(self, lam: Array) -> ContactHold:
        """Return the same hold, with other forces that redundant contacts stay near to."""
        return ContactHold(
            self.candidates, self.modes, self.along, self.sense, lam, self.straight
        )

    def directions(self, look: ContactLook) -> Array:
        """Return s of all cones (cones, 2)."""
        ahead = np.einsum("kx,kx->k", look.tangent, self.along) > 0
        turns = look.slides & ahead & ~self.straight
        size = np.where(turns, look.speed, 1.0)[:, None]
        return np.where(turns[:, None], look.tangent / size, self.along)

    def solve(self, look: ContactLook) -> Held:
        """Return accelerations and forces at a state."""
        now, lam, ease = look.forced(self.rows), np.zeros(len(look.J)), np.zeros(len(look.J))
        G = now.G
        found = self._forces(look, G, now.contact_velocities + look.drift[self.rows])
        lam[self.rows], ease[self.rows] = found, G.diagonal()
        a = now.velocity(found)
        rate = look.J.dot(a) + look.drift
        return Held(a, lam, now.constraint_impulses(found), rate, ease)

    def _forces(self, look: ContactLook, G: Array, g: Array) -> Array:
        W, f = self._W, self._known
        if not len(W):
            return f
        E = W.T.copy()
        if len(self.sliding):
            i = self.sliding
            pull = -self.candidates.friction[i, None] * self.directions(look)[i]
            E[self._t1, self._n], E[self._t1 + 1, self._n] = pull.T
        # unknowns in units of their own: forces of stops are moments
        size = 1 / np.sqrt(np.maximum((W**2).dot(G.diagonal()), np.finfo(float).tiny))
        before = W.dot(self.lam[self.rows])
        A, b = W.dot(G.dot(E)), W.dot(G.dot(f) + g)
        left = -(b + A.dot(before)) * size
        x, *_ = np.linalg.lstsq(size[:, None] * A * size, left, rcond=_REDUNDANT)
        return np.asarray(E.dot(before + size * x) + f)
