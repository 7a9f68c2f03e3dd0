"""ModeDynamics: smooth motion while no contact opens, closes, sticks or slips.

    stick    sigma' = 0 in all three rows
    slide    sigma_n' = 0,    lam_t = -mu lam_n s,    s = sigma_t / |sigma_t|
    open     lam = 0

With E the columns of the forces that are unknown, (-mu s, 1) of what slides, and R the rows whose
sigma' is zero,

    lam = E x + f,    R (G E) x + R (G f + g) = 0.

R G E is not symmetric where something slides. The direction of a `guided` slip is not that of its
velocity but s(t) = Q(w (t - t_0)) s, a rotation at a rate that is given (`SlipGuide`).

Redundant contacts share a load in many ways: what x changes by since modes were last found is the
smallest such change.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core.arrays import Array, Indices
from condyn_pin.constraints.contacts.candidates import Candidates
from condyn_pin.contact.problem import OPEN, SLIDE, STICK, Modes
from condyn_pin.simulation.between_events.contact_terms import ContactTerms

# Singular values of R G E, rows and columns scaled to one, that redundant contacts leave.
_REDUNDANT = 1e-10


class Held(NamedTuple):
    """Accelerations and forces at a state."""

    a: Array  # (nv,)
    lam: Array  # (rows,), of all candidates [N, N m]
    of_constraints: Array  # [N, N m]
    rate: Array  # (rows,), sigma' of all candidates [m/s^2]
    ease: Array  # (rows,), diagonal of G of what is not open [1/kg]


class ModeDynamics:
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
    guided : (cones,) bool array, optional
        Which of the cones that slide are guided.
    turning : (cones,) array, optional
        At which rate [rad/s].
    since : float
        Where they begin to turn [s].
    """

    def __init__(
        self, candidates: Candidates, modes: Modes, along: Array, sense: Array, lam: Array,
        guided: NDArray[np.bool_] | None = None, turning: Array | None = None, since: float = 0.0,
    ) -> None:  # fmt: skip
        cones, lines = candidates.cones, candidates.half_lines
        self.candidates, self.modes, self.along = candidates, modes, along
        self.sense, self.lam, self.since = sense, lam, since
        none = np.zeros(cones, dtype=bool)
        self.guided: NDArray[np.bool_] = none if guided is None else guided
        self.turning = np.zeros(cones) if turning is None else turning
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
        self._R = np.array([place[row] for row in still.tolist()], dtype=np.intp)
        self._E = np.zeros((len(rows), len(still)))
        self._E[self._R, np.arange(len(still))] = 1.0
        self._t1 = np.array([place[3 * i] for i in self.sliding.tolist()], dtype=np.intp)
        column = {row: i for i, row in enumerate(still.tolist())}
        self._n = np.array([column[3 * i + 2] for i in self.sliding.tolist()], dtype=np.intp)
        dry = np.flatnonzero(self.of_dry == SLIDE)
        first = candidates.rows - candidates.intervals
        known = np.zeros(candidates.rows)
        known[first + dry] = -candidates.limits[dry] * self.sense[dry]
        self._known = known[rows]

    def guiding(self, which: NDArray[np.bool_], turning: Array, since: float) -> ModeDynamics:
        """Return the same modes, with these cones guided."""
        return ModeDynamics(
            self.candidates, self.modes, self.along, self.sense, self.lam, which, turning, since
        )

    def with_forces(self, lam: Array) -> ModeDynamics:
        """Return the same modes, with other forces that redundant contacts stay near to."""
        return ModeDynamics(self.candidates, self.modes, self.along, self.sense, lam)

    def ahead(self, t: float) -> Array:
        """Return where cones go that are guided, and where the others went first (cones, 2)."""
        angle = np.where(self.guided, self.turning * (t - self.since), 0.0)
        c, s, (x, y) = np.cos(angle), np.sin(angle), self.along.T
        return np.column_stack((c * x - s * y, s * x + c * y))

    def reversed_in(self, after: ModeDynamics, t: float) -> NDArray[np.bool_]:
        """Return which candidates slide on in other modes, but back (candidates,)."""
        back = np.zeros(len(self.modes), dtype=bool)
        k, n = len(self.along), len(self.sense)
        back[:k] = np.einsum("kx,kx->k", self.ahead(t), after.along) < 0
        back[len(back) - n :] = self.sense * after.sense < 0
        return np.asarray(back & (self.modes == SLIDE) & (after.modes == SLIDE))

    def directions(self, terms: ContactTerms) -> Array:
        """Return s of all cones (cones, 2)."""
        ahead = self.ahead(terms.t)
        turns = terms.slides & (np.einsum("kx,kx->k", terms.tangent, ahead) > 0) & ~self.guided
        size = np.where(turns, terms.speed, 1.0)[:, None]
        return np.where(turns[:, None], terms.tangent / size, ahead)

    def solve(self, terms: ContactTerms) -> Held:
        """Return accelerations and forces at a state."""
        now, lam, ease = terms.forced(self.rows), np.zeros(len(terms.J)), np.zeros(len(terms.J))
        G = now.G
        found = self._forces(terms, G, now.contact_velocities + terms.drift[self.rows])
        lam[self.rows], ease[self.rows] = found, G.diagonal()
        a = now.velocity(found)
        rate = terms.J.dot(a) + terms.drift
        return Held(a, lam, now.constraint_impulses(found), rate, ease)

    def free_forces(self, terms: ContactTerms) -> Array:
        """Return forces (rows, k) that redundant contacts have among themselves."""
        free = np.zeros((len(terms.J), 0))
        if not len(self.still):
            return free
        E, A, size = self._equation(terms, terms.forced(self.rows).G)
        _, S, Vt = np.linalg.svd(size[:, None] * A * size)
        null = Vt[np.count_nonzero(_REDUNDANT * S[0] < S) :].T
        free = np.zeros((len(terms.J), null.shape[1]))
        free[self.rows] = E.dot(size[:, None] * null)
        return free

    def _forces(self, terms: ContactTerms, G: Array, g: Array) -> Array:
        R, f = self._R, self._known
        if not len(R):
            return f
        E, A, size = self._equation(terms, G)
        before = self.lam[self.still]
        left = -((G.dot(f) + g)[R] + A.dot(before)) * size
        x, *_ = np.linalg.lstsq(size[:, None] * A * size, left, rcond=_REDUNDANT)
        return np.asarray(E.dot(before + size * x) + f)

    def _equation(self, terms: ContactTerms, G: Array) -> tuple[Array, Array, Array]:
        """Return E, R G E, and units of the unknowns: forces of stops are moments."""
        E, i = self._E, self.sliding
        if len(i):
            E = E.copy()
            pull = -self.candidates.friction[i, None] * self.directions(terms)[i]
            E[self._t1, self._n], E[self._t1 + 1, self._n] = pull.T
        size = 1 / np.sqrt(np.maximum(G.diagonal()[self._R], np.finfo(float).tiny))
        return E, G.dot(E)[self._R], size
