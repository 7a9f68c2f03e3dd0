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

from functools import cached_property
from math import isfinite
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array, Indices
from condyn_pin._core.linalg import MinimumNorm, factorise
from condyn_pin._core.models import algorithms
from condyn_pin.constraints.contacts.candidates import Candidates
from condyn_pin.contact.condense import Condensed, condense
from condyn_pin.contact.problem import OPEN, SLIDE, STICK, Modes
from condyn_pin.errors import StepFailed
from condyn_pin.model.soundness import singular_mass
from condyn_pin.simulation.system import System

# Singular values of R G E, rows and columns scaled to one, that redundant contacts leave.
_REDUNDANT = 1e-10


class FixedModes(NamedTuple):
    """Accelerations and forces at a state."""

    a: Array  # (nv,)
    lam: Array  # (rows,), of all candidates [N, N m]
    of_constraints: Array  # [N, N m]
    rate: Array  # (rows,), sigma' of all candidates [m/s^2]
    ease: Array  # (rows,), diagonal of G of what is not open [1/kg]


class ModeDynamics:
    """Dynamics of contacts in fixed modes, until the next event.

    modes (candidates,): places in `MODES`
    along (cones, 2): slip directions, unit vectors; also of cones without velocity yet
    sense (intervals,): slip directions of dry friction, 1 or -1
    lam (rows,): forces by which the modes were found
    guided (cones,): flags of sliding cones that are guided
    turning (cones,): rotation rates of their slip directions [rad/s]
    since: time at which the rotation begins [s]
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
        """The modes, with the slips of these cones guided."""
        return ModeDynamics(
            candidates=self.candidates,
            modes=self.modes,
            along=self.along,
            sense=self.sense,
            lam=self.lam,
            guided=which,
            turning=turning,
            since=since,
        )

    def with_forces(self, lam: Array) -> ModeDynamics:
        """The modes, with other forces that redundant contacts stay near to."""
        return ModeDynamics(self.candidates, self.modes, self.along, self.sense, lam)

    def ahead(self, t: float) -> Array:
        """Slip directions at t of guided cones, and initial ones of the others (cones, 2)."""
        angle = np.where(self.guided, self.turning * (t - self.since), 0.0)
        c, s, (x, y) = np.cos(angle), np.sin(angle), self.along.T
        return np.column_stack((c * x - s * y, s * x + c * y))

    def reversed_in(self, after: ModeDynamics, t: float) -> NDArray[np.bool_]:
        """Flags of candidates that slide on in other modes in reverse (candidates,)."""
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

    def solve(self, terms: ContactTerms) -> FixedModes:
        """Return accelerations and forces at a state."""
        now, lam, ease = terms.forced(self.rows), np.zeros(len(terms.J)), np.zeros(len(terms.J))
        G = now.G
        found = self._forces(terms, G, now.contact_velocities + terms.drift[self.rows])
        lam[self.rows], ease[self.rows] = found, G.diagonal()
        a = now.velocity(found)
        rate = terms.J.dot(a) + terms.drift
        return FixedModes(a, lam, now.constraint_impulses(found), rate, ease)

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


# ContactTerms: all that equations of motion with contacts are made of, at one state.
#
# M a + h = tau + J_b^T l_b + J_c^T lam,    J_b a + gamma = 0,    sigma' = J_c a + Jdot_c v
#
# with gamma less s'' for rows that are driven along s(t): they move at J_b v = s'.


# A contact that is nearer touches [m, rad]: what steps close is open by rounding.
_TOUCHING = 1e-9

# Speeds that are none: normal ones are taken away to rounding where a contact rests, and slip that
# would end within a nanosecond [m/s, rad/s]. Relative to the speed of the robot where it is faster.
_RESTING = 1e-10
_STILL = 1e-9


class ContactTerms:
    """A system with contacts at one state; no array is written to later.

    StepFailed if the state, or what acts there, is not finite.

    t: time [s]
    q, v, tau: the state, and the torques with springs and damping
    M, h, J_b, gamma: as in the equation
    gaps (k,): of cones and half-lines [m, rad]
    J (rows, nv), drift (rows,): J_c and Jdot_c v of all candidates
    sigma (rows,): J_c v [m/s, rad/s]
    path (3, m): s, s' and s'' of what is driven; zero of all other constraints
    """

    def __init__(self, system: System, t: float, q: Array, v: Array) -> None:
        self._system, self.t, self.q, self.v = system, t, q, v
        self._check_finite(q, v)
        candidates, data = system.contacts, system.equations.data
        self.tau = system.torque(t, q, v)
        system.at(t)
        self.path = system.equations.wanted.copy()
        self.M, self.h, self.J_b, self.gamma = system.equations.consistent_parts(q, v)
        self.gaps, self.J = candidates.evaluate(data, q)
        algorithms(data).forwardKinematics(system.model, data, q, v, np.zeros(len(v)))
        self.drift = candidates.drift(data)
        self.sigma = self.J.dot(v)
        self._check_finite(self.tau, self.h, self.drift, self.gamma)

    def _check_finite(self, *parts: Array) -> None:
        if not isfinite(sum(float(part.dot(part)) for part in parts)):
            raise StepFailed(
                f"t = {self.t:g} s: the motion is not finite, its numbers overflow; look at v, tau "
                "and masses, or take a smaller dt"
            )

    @cached_property
    def factors(self) -> MinimumNorm:
        """Of M and J_b."""
        why = singular_mass(self._system.model, self.q)
        return factorise(self.M, self.J_b, tolerances.RANK, why=why)

    @cached_property
    def fastest(self) -> float:
        """The largest speed of the robot, or 1 [m/s, rad/s]."""
        return max(1.0, float(np.abs(self.v).max(initial=0.0)))

    @property
    def closing(self) -> Array:
        """D gap/dt of cones and half-lines [m/s, rad/s]."""
        return np.asarray(self.sigma[self._system.contacts.normals])

    @property
    def touches(self) -> NDArray[np.bool_]:
        """Flags of cones and half-lines that touch."""
        return np.asarray(self.gaps <= _TOUCHING)

    @property
    def approaches(self) -> NDArray[np.bool_]:
        """Flags of touching cones and half-lines that approach."""
        return np.asarray(self.touches & (self.closing < -_RESTING * self.fastest))

    @property
    def rests(self) -> NDArray[np.bool_]:
        """Flags of touching cones and half-lines that neither approach nor leave."""
        return np.asarray(self.touches & (np.abs(self.closing) <= _RESTING * self.fastest))

    @cached_property
    def tangent(self) -> Array:
        """Slip of the cones along t1 and t2 (cones, 2) [m/s]."""
        return np.asarray(self.sigma[: 3 * self._system.contacts.cones].reshape(-1, 3)[:, :2])

    @cached_property
    def speed(self) -> Array:
        """Slip speed of the cones (cones,) [m/s]."""
        return np.hypot(self.tangent[:, 0], self.tangent[:, 1])

    @property
    def slides(self) -> NDArray[np.bool_]:
        """Flags of sliding cones (cones,); slower slips count as zero."""
        return np.asarray(self.speed > _STILL * self.fastest)

    @property
    def dry(self) -> Array:
        """Velocities along dry friction [rad/s, m/s], zero where they are none."""
        count = self._system.contacts.intervals
        v = self.sigma[len(self.sigma) - count :]
        return np.where(np.abs(v) > _STILL * self.fastest, v, 0.0)

    def forced(self, rows: Indices) -> Condensed:
        """Return the rows of contacts with the constraints eliminated, for accelerations."""
        J_c, still = self.J[rows], np.zeros(len(self.v))
        rates = self.path[1:] if self._system.scene.is_driven else None
        return condense(self.factors, J_c, still, self.tau - self.h, -self.gamma, rates)

    def struck(self, rows: Indices) -> Condensed:
        """Rows of contacts with the constraints eliminated, for impulses: no finite forces."""
        none = np.zeros(len(self.v))
        rates = self.path[1]
        driven = rates if self._system.scene.is_driven else None
        return condense(self.factors, self.J[rows], self.v, none, rates, driven)

    def held(self, v: Array, rows: Indices) -> Array:
        """Return the nearest velocity with which constraints are kept and these rows still."""
        if not len(rows) and not len(self.J_b):
            return v
        J = np.concatenate((self.J_b, self.J[rows]))
        why = singular_mass(self._system.model, self.q)
        wanted = np.concatenate((self.path[1], np.zeros(len(rows))))
        return factorise(self.M, J, tolerances.RANK, why=why).at_rates(v, wanted)


# How redundant contacts share a load: evenly if they can, else as far from limits as there is.
#
#     lam = E x + f,    R (G E) x + R (G f + g) = 0,    x = x_0 + Z y,    (R G E) Z = 0
#
# All of them move the robot alike. The smallest forces are a function of the state alone; where
# they would pull, or leave a cone, y is found that keeps all within by as much as possible,
#
#     max s,    lam_n >= s,    mu lam_n - d . lam_t >= s  for directions d in the ground,
#
# a linear program, with the directions of the forces that it finds among d the next time. Only
# where none are within has a contact come to its end.


# A margin, relative to the largest force, that is zero: an event is found to rounding of its time.
AT_ITS_END = 1e-6

# Directions in the ground to begin with, and how often more are added.
_SIDES, _MORE = 8, 12


class LoadSharing(NamedTuple):
    """The modes of a scene with the forces that redundant contacts stay near to."""

    dynamics: ModeDynamics
    held: FixedModes
    least: float  # the least margin, relative to the largest force


def shared_loads(
    candidates: Candidates, dynamics: ModeDynamics, terms: ContactTerms
) -> LoadSharing:
    """Load sharing of redundant contacts with forces within their limits, where possible."""
    even = _with_limits(candidates, dynamics, terms, np.zeros(len(terms.J)))
    if even.least > AT_ITS_END:
        return even
    found = _with_limits(candidates, dynamics, terms, dynamics.lam)
    if found.least > AT_ITS_END:
        return found
    lam = _centred(candidates, found, terms)
    return (
        found
        if lam is None
        else max(
            found, _with_limits(candidates, dynamics, terms, lam), key=lambda shares: shares.least
        )
    )


def _with_limits(
    candidates: Candidates, dynamics: ModeDynamics, terms: ContactTerms, lam: Array
) -> LoadSharing:
    dynamics = dynamics.with_forces(lam)
    held = dynamics.solve(terms)
    parts = mode_margins(candidates, dynamics, terms, terms, held, 0.0)[1:4]
    largest = float(np.abs(held.lam).max(initial=0.0)) or 1.0
    return LoadSharing(
        dynamics, held, min(float(part.min(initial=np.inf)) for part in parts) / largest
    )


def _centred(candidates: Candidates, found: LoadSharing, terms: ContactTerms) -> Array | None:
    """Return forces (rows,) as far within their limits as any; None if there is no choice."""
    from scipy.optimize import linprog

    free = found.dynamics.free_forces(terms)
    if not free.shape[1]:
        return None
    lam0 = best = found.held.lam
    size = float(np.abs(lam0).max(initial=0.0)) or 1.0
    angles = 2 * np.pi * np.arange(_SIDES) / _SIDES
    facets = [np.column_stack((np.cos(angles), np.sin(angles)))] * candidates.cones
    for _ in range(_MORE):
        C, b = _limits(candidates, found.dynamics, facets)
        # C (lam0 + free y) + b >= s size
        A = np.column_stack((-C @ free, np.full(len(C), size)))
        cost = np.r_[np.zeros(free.shape[1]), -1.0]
        bounds = [(None, None)] * free.shape[1] + [(None, 1.0)]
        answer = linprog(cost, A_ub=A, b_ub=C @ lam0 + b, bounds=bounds)
        if answer.status != 0:
            return best
        best = np.asarray(lam0 + free @ answer.x[:-1])
        F = best[: 3 * candidates.cones].reshape(-1, 3)[:, :2]
        pull = np.hypot(F[:, 0], F[:, 1])
        within = _with_limits(candidates, found.dynamics, terms, best).least
        if within > answer.x[-1] / 2 or not answer.x[-1] > AT_ITS_END:
            return best
        facets = [
            np.vstack((d, f / p)) if p else d for d, f, p in zip(facets, F, pull, strict=True)
        ]
    return best


def _limits(
    candidates: Candidates, dynamics: ModeDynamics, facets: list[Array]
) -> tuple[Array, Array]:
    """Return C and b of the limits C lam + b >= 0 of what presses and sticks."""
    rows, first = list[Array](), candidates.rows - candidates.intervals
    one, mu = np.eye(candidates.rows), candidates.friction
    for i, mode in enumerate(dynamics.of_cones):
        if mode != OPEN:
            rows.append(one[3 * i + 2])
        if mode == STICK and mu[i] > 0:
            rows += [mu[i] * one[3 * i + 2] - d @ one[3 * i : 3 * i + 2] for d in facets[i]]
    lines = dynamics.modes[candidates.cones : candidates.cones + candidates.half_lines]
    rows += [one[3 * candidates.cones + k] for k in np.flatnonzero(lines == STICK)]
    b = [0.0] * len(rows)
    for k in np.flatnonzero(dynamics.of_dry == STICK):
        rows += [one[first + k], -one[first + k]]
        b += [float(candidates.limits[k])] * 2
    return np.array(rows).reshape(-1, candidates.rows), np.array(b)


def let_go(candidates: Candidates, shares: LoadSharing) -> ModeDynamics:
    """Return the modes in which contacts at the end of theirs open, or slip."""
    dynamics, lam = shares.dynamics, shares.held.lam
    k, lines, first = (
        candidates.cones,
        candidates.half_lines,
        candidates.rows - candidates.intervals,
    )
    end = AT_ITS_END * float(np.abs(lam).max(initial=0.0))
    F, mu, modes = lam[: 3 * k].reshape(-1, 3), candidates.friction, dynamics.modes.copy()
    along, sense = dynamics.along.copy(), dynamics.sense.copy()
    pull = np.hypot(F[:, 0], F[:, 1])
    slips = (modes[:k] == STICK) & (mu > 0) & (mu * F[:, 2] - pull < end) & (pull > 0)
    along[slips] = -F[slips, :2] / pull[slips, None]
    modes[:k][slips] = SLIDE
    modes[: k + lines][lam[candidates.normals] < end] = OPEN
    dry = (modes[k + lines :] == STICK) & (candidates.limits - np.abs(lam[first:]) < end)
    sense[dry] = -np.sign(lam[first:][dry])
    modes[k + lines :][dry] = SLIDE
    return ModeDynamics(candidates, modes, along, sense, lam)


# Margins: how far contacts are from the next event.
#
#     open     gap                         then it touches
#     closed   lam_n                       opens
#     stick    mu lam_n - |lam_t|          slips
#     slide    sigma_t . s                 stands still
#
# An event is where a margin falls to zero. A contact that leaves has a gap of zero to begin with:
# its gap over the share of the step that is made has none, and is zero where it returns.


# Gaps, forces relative to the largest, and speeds relative to that of the robot, that are zero but
# for rounding: redundant contacts have them all the time.
_GAP = 1e-12
_FORCE = 1e-9
_SPEED = 1e-9


class Margins(NamedTuple):
    """Margins at a state, each an array."""

    # gaps, forces (cones + half_lines,): [m, rad], [N, N m]; infinite of what is in the other mode
    gaps: Array
    forces: Array
    # cones, dry: of friction that sticks [N, N m]; infinite of what slides
    cones: Array
    dry: Array
    # slips, dry_slips: speeds of what slides [m/s, rad/s]; infinite of what sticks
    slips: Array
    dry_slips: Array


def mode_margins(
    candidates: Candidates,
    dynamics: ModeDynamics,
    begun: ContactTerms,
    terms: ContactTerms,
    held: FixedModes,
    share: float,
) -> Margins:
    """Return the margins at a state that a share of a step leads to from where it began."""
    k, lines, mu = candidates.cones, candidates.cones + candidates.half_lines, candidates.friction
    is_open, inf = dynamics.modes[:lines] == OPEN, np.inf
    gone = (terms.gaps - np.minimum(begun.gaps, 0.0)) / (share or 1.0)
    gaps = np.where(begun.touches, gone, terms.gaps)
    F = held.lam[: 3 * k].reshape(-1, 3)
    stick = mu * F[:, 2] - np.hypot(F[:, 0], F[:, 1])
    slip = np.einsum("kx,kx->k", terms.tangent, dynamics.ahead(terms.t))
    dry = slice(candidates.rows - candidates.intervals, None)
    rough = mu > 0
    return Margins(
        np.where(is_open, gaps, inf),
        np.where(is_open, inf, held.lam[candidates.normals]),
        np.where((dynamics.of_cones == STICK) & rough, stick, inf),
        np.where(dynamics.of_dry == STICK, candidates.limits - np.abs(held.lam[dry]), inf),
        np.where((dynamics.of_cones == SLIDE) & rough, slip, inf),
        np.where(dynamics.of_dry == SLIDE, dynamics.sense * terms.sigma[dry], inf),
    )


def fallen(
    now: Margins, held: FixedModes, terms: ContactTerms, begun: ContactTerms
) -> list[tuple[int, int]]:
    """Part and place of each margin that has fallen below zero by more than rounding."""
    force = _FORCE * float(np.abs(held.lam).max(initial=0.0))
    speed = _SPEED * terms.fastest
    gap = np.where(begun.touches, _GAP, 0.0)
    least: tuple[Any, ...] = (gap, force, force, force, speed, speed)
    return [
        (part, int(i))
        for part, (values, zero) in enumerate(zip(now, least, strict=True))
        for i in np.flatnonzero(values < -zero)
    ]
