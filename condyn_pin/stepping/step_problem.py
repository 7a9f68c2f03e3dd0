"""A step with contacts as it is posed, tried and taken.

Posed: a step with contacts, all of it but the answer.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from itertools import compress
from math import isfinite
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dtrtrs

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array, Indices
from condyn_pin._core.models import algorithms
from condyn_pin.constraints.contacts.candidates import Candidates
from condyn_pin.contact.condense import Condensed
from condyn_pin.contact.problem import (
    ContactProblem,
    ContactSets,
    components,
    scale_of,
    stiffness_of,
)
from condyn_pin.contact.restitution import ImpactAnswer
from condyn_pin.contact.solution import (
    attempt_contact,
    drop_inconsistent_rows,
    fallbacks,
    first_attempt,
)
from condyn_pin.contact.solvers.contact_solver import ContactSolver, SolverResult
from condyn_pin.simulation.integrators.contact_scheme import (
    AT_REST,
    ActiveContacts,
    ContactScheme,
    allowed_gaps,
    are_slower,
)
from condyn_pin.simulation.manifold import Manifold
from condyn_pin.simulation.records import NO_WORK, ContactWork, Note
from condyn_pin.simulation.system import System


class StepProblem(NamedTuple):
    """A step before its contact problem is solved; floating bodies in their axes at `at`."""

    at: Array  # (nq,), where M and h are taken, and J of the constraints
    v: Array  # (nv,), the velocity before
    mean: Array  # (nv,), the velocity of h
    turning: Array  # (nv,), w x u of floating bodies at `mean`
    tau: Array  # (nv,), springs and damping as they act at the end of the step [N, N m]
    gaps: Array  # of all cones and half-lines, at `at` [m, rad]
    J: Array  # (rows, nv), of all candidates, at `at`
    straight: Array | None  # (nq,), the end of a path from `at` along v, if gaps were asked there
    path: (
        Array | None
    )  # (nv,), the velocity along which contacts are taken to its end; None: at `at`
    J_c: Array  # (m, nv), of the active ones, where they are taken
    J_n: Array  # (k, nv), the rates of their gaps at `at`
    chosen: ActiveCandidates
    condensed: Condensed
    near: ActiveContacts
    problem: ContactProblem
    strike: ImpactAnswer | None = None  # the impact with which the step begins
    span: float = 0.0  # over which springs and damping act: dt, or its half in the middle [s]
    t: float = 0.0  # when the equations are taken [s]
    kept: ReusedParts | None = None

    def total(self, lam: Array) -> Array:
        """Return all impulses of the contacts (m,), of the impact and of the step behind it."""
        if self.strike is None:
            return lam
        total = lam.copy()
        total[: len(self.strike.lam)] += self.strike.lam
        return total

    def velocity(self, lam: Array) -> Array:
        """Return v+ (nv,) of impulses (m,) of the step behind the impact."""
        return self.condensed.velocity(self.total(lam))


class ReusedParts(NamedTuple):
    """Parts of an earlier attempt that a step keeps when it is tried again along a path."""

    of: NDArray[np.int_]  # (nv,), the attempt whose path each velocity has; -1 for the next one
    gaps: NDArray[np.bool_]  # of all candidates, which are taken at the beginning
    first: StepProblem  # as they were there


# Chosen: the active contacts of a step.


class ActiveCandidates:
    """Active candidates of a step, with their data for a contact problem."""

    def __init__(self, candidates: Candidates, active: NDArray[np.bool_], dt: float) -> None:
        cones = candidates.cones
        lines = cones + candidates.half_lines
        self.active, self.rows = active, _all_or(candidates.rows_of(active))
        self.near, self.is_everything = active[:lines], bool(active.all())
        self.gaps = _all_or(self.near)
        # active ones whose paths bend: their places among all of these, and among active gaps
        curved = active[candidates.curved]
        self.of_curved, self.curved_count = _all_or(curved), int(np.count_nonzero(curved))
        self.curved: Indices | slice = slice(0, self.curved_count)
        if not isinstance(candidates.curved, slice):
            self.curved = (np.cumsum(self.near) - 1)[candidates.curved][curved]
        k, stops = np.count_nonzero(active[:cones]), np.count_nonzero(active[cones:lines])
        self.normals: Indices | slice = slice(2, 3 * k, 3)
        if stops:
            self.normals = np.concatenate((np.arange(2, 3 * k, 3), 3 * k + np.arange(stops)))
        self.restitution = np.zeros(k + stops)
        self.restitution[:k] = candidates.restitution[active[:cones]]
        self.cones = _all_or(active[:cones])
        self.friction = candidates.friction[active[:cones]]
        self.half_lines = int(stops)
        self.limits = candidates.limits[active[lines:]] * dt  # [N s]
        self.names = tuple(compress(candidates.names, active))
        self.sets = ContactSets(self.friction, self.half_lines, self.limits)

    def impact(self, near: ActiveContacts) -> ContactProblem:
        """Return the cones and half-lines of a step as they are before it: g is J_c v."""
        m = self._striking.size
        return ContactProblem.trusted(
            G=near.G[:m, :m], g=near.before[:m], friction=self.friction,
            half_lines=self.half_lines, limits=self._striking.limits, R=None, law="ncp",
            level="impulse", names=self.names[: len(near.gaps)], sets=self._striking,
        )  # fmt: skip

    @cached_property
    def _striking(self) -> ContactSets:
        return ContactSets(self.friction, self.half_lines, np.zeros(0))

    def problem(self, scheme: ContactScheme, near: ActiveContacts) -> ContactProblem:
        """Return the contact problem of a step."""
        g, R = scheme.bias(near)
        stiffness = stiffness_of(near.G, R)  # what is asked for in any case takes longer if cached
        return ContactProblem.trusted(
            G=near.G, g=g, friction=self.friction, half_lines=self.half_lines, limits=self.limits,
            R=R, law=scheme.law, level="impulse", names=self.names, sets=self.sets,
            stiffness=stiffness, scale=scale_of(stiffness, g),
        )  # fmt: skip


def _all_or(some: NDArray[np.bool_]) -> NDArray[np.bool_] | slice:
    """Return flags, or the slice of everything where all are set, which copies nothing."""
    return slice(None) if some.all() else some


# Where the paths of a step end: contacts as they are there, for steps in which bodies turn far.
#
#     gap(q (+) dt v+)  ~  gap_e + dt J_e (v+ - u),    gap_e and J_e at q (+) dt u
#
# with u the velocity that the attempt before has found. Impulses act along J_e^T, against what goes
# through at the end of the step: without friction it is the projection
#
#     min |v+ - v_free|_M^2 / 2    with    gap(q (+) dt v+) >= 0,
#
# by problems that are linear in the gaps. Those along J^T of the beginning may turn a limb further
# into the floor, the more of them the further, and lift what bends into the floor at the cost of
# nobody: a fall of Go2 has won 130 J so, and went 2.7 mm deep. From the second attempt on u goes
# half of the way, for limbs swing to and fro over the answer.
#
# Shapes that meet in several points meet in others at the end of a long step. They count as they
# meet there, and may penetrate by as much as the deepest of them did at the beginning.


# A step in which joints turn less bends the path of a limb of a metre by 0.05 mm at most [rad, m].
STRAIGHT = 1e-2

# How far from where it should a step may end [m, rad].
MISSED = 1e-4


class EndOfStep(NamedTuple):
    """All candidates where a path ends."""

    gaps: Array  # of cones and half-lines [m, rad]
    J: Array  # (rows, nv), for velocities in the axes of where the path begins


class EndsOfPaths:
    """The ends of the paths of one system in steps of one size."""

    def __init__(self, system: System, floating: Manifold, dt: float) -> None:
        self._system, self._floating, self._dt = system, floating, dt
        self._contacts, self._data = system.contacts, system.equations.data
        self._run = algorithms(self._data)
        self._pairs = self._contacts.several

    def gap_errors(self, posed: StepProblem, lam: Array, v1: Array) -> Array | None:
        """Error of gaps at the end of a step (k,) [m, rad]; None if within tolerance."""
        # Too deep, or pressed on before it touches; or pressed on along J at the beginning where
        # its path bends into the ground from there.
        dt, near = self._dt, posed.near
        bent = max(map(abs, near.bends.tolist()), default=0.0)
        is_straight = posed.path is None and bent < MISSED and are_slower(v1, STRAIGHT / dt)
        if is_straight and not self._may_meet(posed):
            return None
        q1 = self._floating.integrate(posed.at, dt * v1)
        self._run.forwardKinematics(self._system.model, self._data, q1)
        start, _ = self.begun(posed)
        allowed, its = allowed_gaps(start, dt), posed.chosen.gaps
        allowed[its] = np.where(near.pressed, near.allowed, allowed[its])
        above = self._contacts.gaps(self._data, q1) - (start - allowed)
        for places in self._pairs:  # they have other points there
            above[places] = above[places].min()
        off = np.maximum(-above, 0.0)
        if len(lam):
            n = near.normals
            speeds = posed.problem.velocities(lam)[n]  # those that the law leaves
            presses = lam[n] * posed.problem.scale[0] > np.abs(speeds)
            early = np.where(presses, above[its] - dt * speeds, 0.0)
            lifted = np.where(presses, -near.bends, 0.0)
            if posed.path is not None:
                lifted[slice(None) if posed.kept is None else ~posed.kept.gaps[its]] = 0.0
            off[its] = np.maximum(off[its], np.maximum(early, lifted))
        return off if off.max(initial=0.0) > MISSED else None

    def _may_meet(self, posed: StepProblem) -> bool:
        """True if shapes are near a ground, where other edges may be what they meet."""
        near = self._contacts.on_ground
        return bool(near.any() and posed.gaps[: len(near)][near].min() < STRAIGHT)

    def alone(self, posed: StepProblem) -> tuple[Array, Array]:
        """Group of each gap and of each velocity, coupled ones in one group."""
        # Gaps that nothing moves, and velocities that move none, are in no group: -1.
        contacts, condensed = self._contacts, posed.condensed.with_contacts(posed.J)
        X, L = condensed.X, condensed.factors.L
        starts = np.searchsorted(contacts.blocks, np.arange(len(contacts.names)))
        moves, pulls = (
            np.logical_or.reduceat(rows.T != 0.0, starts, axis=0) for rows in (dtrtrs(L.T, X)[0], X)
        )
        gaps, velocities = np.full(len(posed.gaps), -1), np.full(len(X), -1)
        for i, group in enumerate(components(pulls.astype(float) @ pulls.T != 0.0)):
            velocities[moves[group].any(axis=0)] = i
            gaps[group[: len(gaps)]] = i
        gaps[(X[:, contacts.normals] == 0.0).all(axis=0)] = -1
        return gaps, velocities

    def begun(self, posed: StepProblem) -> tuple[Array, Array]:
        """Return gaps at the beginning, and their rates, for the places of candidates at the end.

        Of two shapes that meet in several points: the deepest in all places, or zero.
        """
        gaps, J_n = posed.gaps, posed.J[self._contacts.normals]
        if not self._contacts.pairs:
            return gaps, J_n
        gaps, J_n = np.where(gaps == np.inf, 0.0, gaps), J_n.copy()  # a seam hides what has no gap
        for places in self._pairs:
            deepest = places.start + int(gaps[places].argmin())
            into = float(gaps[deepest]) < 0.0
            gaps[places] = gaps[deepest] if into else 0.0
            J_n[places] = J_n[deepest] if into else 0.0
        return gaps, J_n

    def there(self, at: Array, u: Array) -> EndOfStep:
        """Return all candidates at the end of a path along u (nv,)."""
        q1 = self._floating.integrate(at, self._dt * u)
        self._run.computeJointJacobians(self._system.model, self._data, q1)
        gaps, J = self._contacts.evaluate(self._data, q1)
        return EndOfStep(gaps, self._floating.rows_before(J, u, self._dt))

    def active_flags(
        self, posed: StepProblem, there: EndOfStep, near: NDArray[np.bool_]
    ) -> NDArray[np.bool_]:
        """Flags of active gaps: those before, those that close, and pairs as they meet."""
        # `near` says which are near at the end.
        active = posed.chosen.near | (there.gaps < 0)
        for places in self._pairs:
            active[places] = near[places]
        return active


def next_path(posed: StepProblem, path: Array, v1: Array) -> Array:
    """Return the path after one that has led to v+: for velocities, and how they change."""
    # The first of them is along v, and with an impact nothing goes on as it did.
    return v1 if posed.path is None else 0.5 * (path + v1)


def kept_paths(of: NDArray[np.int_], paths: Sequence[Array], after: Array) -> Array:
    """Return velocities of a path, or how they change: those of attempts before, or `after` them.

    That of the first attempt is zero: its contacts are taken where they begin.
    """
    path = after.copy()
    for i, before in enumerate(paths):
        path[of == i] = before[of == i] if i else 0.0
    return path


# Curved paths: how far gaps end from where straight paths would take them within a step.
#
#     s = gap(q (+) dt v) - gap - dt J_n v = dt^2 / 2 Jdot_n v + ...
#
# The tip of a limb of 0.2 m at 200 rad/s is 1 mm off its tangent after 0.5 ms.


class CurvatureCorrection:
    """The paths of what is over planes, and of cables, in steps of one size.

    Pairs of bodies count as straight at first, for they meet in other points at the end of a long
    step (`EndsOfPaths`). Stops of joints are linear in q.
    """

    def __init__(self, system: System, floating: Manifold, dt: float) -> None:
        self._system, self._floating, self._dt = system, floating, dt
        self._run = algorithms(system.equations.data)

    def bends(
        self, q: Array, v: Array, gaps: Array, speeds: Array, chosen: ActiveCandidates
    ) -> tuple[Array, Array | None]:
        """Return s of the active cones and half-lines (k,) [m], and q (+) dt v, in 5 us."""
        # `gaps` (k,) [m, rad] and `speeds` J_c v (m,) are those at q, where the path begins along
        # v. None for q where no path of an active one bends. The data of the system keep its
        # placements.
        contacts, data, dt = self._system.contacts, self._system.equations.data, self._dt
        bends, curved = np.zeros(len(gaps)), chosen.curved
        if not chosen.curved_count:
            return bends, None
        end = self._floating.integrate(q, dt * v)
        self._run.forwardKinematics(self._system.model, data, end)
        ends = contacts.curved_gaps(data, end)[chosen.of_curved]
        bends[curved] = ends - gaps[curved] - dt * speeds[chosen.normals][curved]
        return bends, end


# The work of the contacts in a step, each part by its cause.
#
#     W = lam . w,    w = (J_c v + J_c v+) / 2
#
# is what impulses do to the kinetic energy. With p, at which a step pushes out, lam_n p / 2 of it
# is there only because a gap was negative, and so is lam_n (J_n v) / 2 where such a contact still
# moves out as the step before has left it: `correction`.
#
# The rest has a sign. Impulses act against velocities: lam . (J_c v+) is -mu |lam_n| |sigma_t| of
# friction and -lam_n gap / dt of gaps that close, and what they change them by is lost. But they
# act along J of one place of a step, for velocities at its end. Where paths bend, or what moves
# comes to rest and is held within the step, W may be positive: such a step gives what no contact
# would. That is `algorithmic`, and goes to zero with dt. What Newton's law of restitution may give
# where several contacts meet with friction is in it too, and does not.


def step_work(scheme: ContactScheme, posed: StepProblem, lam: Array, v1: Array) -> ContactWork:
    """Work of impulses lam (m,) in a step to v+ (nv,) [J]."""
    # Compliant contacts do work of either sign, as springs: all of it is `contact`.
    if not len(lam):
        return NO_WORK
    near = posed.near
    work = 0.5 * float(lam.dot(near.before + posed.J_c.dot(v1)))
    if scheme.penetrates_at_rest:
        return ContactWork(work, 0.0, 0.0)
    correction = _pushing_out(near, lam, work) if scheme.closes_gaps else 0.0
    rest = work - correction
    return ContactWork(min(rest, 0.0), correction, max(rest, 0.0))


def drive_work(posed: StepProblem, lam: Array, rows: Indices) -> float:
    """Work of driven `rows` of the constraints in a step with impulses lam (m,) [J]."""
    # l_b . (J_b v + J_b v+) / 2,    J_b = U S V^T L^T
    condensed = posed.condensed
    factors, r = condensed.factors, condensed.factors.rank
    moved = factors.V.T.dot(posed.v.dot(factors.L)) + condensed.held
    rates = (factors.U[rows, :r] * factors.S[:r]).dot(moved)
    return 0.5 * float(condensed.constraint_impulses(lam)[rows].dot(rates))


def _pushing_out(near: ActiveContacts, lam: Array, work: float) -> float:
    """Return the part of work that is there only because gaps were negative [J]."""
    if min(near.gaps.tolist(), default=0.0) >= -AT_REST:
        return 0.0
    rates = near.allowed / near.dt  # -p
    deep = rates < 0.0
    lam_n, before = lam[near.normals][deep], near.before[near.normals][deep]
    now = -0.5 * float(lam_n.dot(rates[deep]))
    left = 0.5 * float(lam_n.dot(np.maximum(before, 0.0)))
    return now + min(left, max(work - now, 0.0))


# StepAttempt: a step with an answer of its contact solver, and how it comes by one.


# How deep a penetration is that is spoken of [m, rad].
_SEEN: Final = 1e-6

# Share of a push below which a penetration counts as not pushed out [1].
_HALF: Final = 0.5


class StepAttempt(NamedTuple):
    """A step with an answer of its contact solver."""

    posed: StepProblem
    v: Array  # (nv,), the velocity after it, in the axes of `posed` [m/s, rad/s]
    attempt: SolverResult
    natural: float  # residual of the contact problem

    def is_answer_of(self, solver: ContactSolver) -> bool:
        """True if the impulses are as accurate as the solver promises."""
        if solver.exact:
            return self.natural <= tolerances.CONTACT_SOLVED
        return self.attempt.answered and isfinite(self.natural)


class AcceptedStep(NamedTuple):
    """A step that was taken."""

    posed: StepProblem
    v: Array
    attempt: SolverResult
    natural: float
    work: ContactWork
    tried: tuple[StepAttempt, ...]  # what it came from, in turn, and itself
    missed: tuple[str, float] | None = None  # a contact, and how far off it ends [m, rad]
    through: tuple[str, ...] = ()  # contacts that it has gone past, from one side to the other

    @property
    def notes(self) -> list[Note]:
        """Warnings about the step, other than those of its contact problem."""
        strike, near = self.posed.strike, self.posed.near
        notes = [] if strike is None else [Note(*note) for note in strike.notes]
        deep = near.gaps < -_SEEN
        if deep.any() and (its := np.flatnonzero(deep & near.pushed_by_less_than(_HALF))).size:
            names = tuple(self.posed.problem.names[i] for i in its)
            depths = ", ".join(f"{-gap:.2g}" for gap in near.gaps[its])
            text = (
                f"{', '.join(names)}: pressed from more than one side, {depths} m or rad deep, and "
                "not pushed out: gaps and shapes contradict each other"
            )
            notes.append(Note("pressed", names, text))
        if self.missed is not None:
            name, off = self.missed
            text = (
                f"{name} ends {off:.2g} m or rad from where its step would have it, for paths bend "
                "too far within one: take a smaller dt"
            )
            notes.append(Note("missed", (), text))
        notes += [
            Note(
                "through",
                (name,),
                f"{name}: the bodies pass through each other within a step, in which they come "
                "nearer by more than they are thick: take a smaller dt, or StewartTrinkle()",
            )
            for name in self.through
        ]
        return notes


def answered(posed: StepProblem, solver: ContactSolver) -> StepAttempt:
    """Return a step with impulses that meet its contact problem, or the best that were found."""
    # Redundant contacts are checked before the solver tries all else that it has, which may take a
    # thousand times as long, and again where that has not helped.
    problem, accuracy = posed.problem, tolerances.CONTACT_SOLVED
    if not solver.exact:
        return _with_answer(posed, *attempt_contact(problem, solver, None, accuracy))
    found, natural = first_attempt(problem, solver, None, accuracy)
    for is_best in (False, True):
        if natural <= accuracy:
            break
        # what is not finite contradicts nothing
        consistent = drop_inconsistent_rows(problem, found.lam) if isfinite(natural) else None
        if consistent is not None:
            problem, posed = consistent, posed._replace(problem=consistent)
            found, natural = attempt_contact(problem, solver, found.lam, accuracy)
        elif not is_best:
            found, natural = fallbacks(problem, solver, found, accuracy)
    return _with_answer(posed, found, natural)


def _with_answer(posed: StepProblem, found: SolverResult, natural: float) -> StepAttempt:
    if posed.strike is not None and not posed.strike.natural <= natural:
        natural = posed.strike.natural
    return StepAttempt(posed, posed.velocity(found.lam), found, natural)
