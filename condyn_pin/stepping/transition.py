"""Transition: impacts and shocks at one instant, before motion goes on smoothly.

    what approaches                       an impact
    what no force lets slide on           a shock
    what would return at once             rests

and then the modes with which it goes on. A contact that leaves with sigma_n > 0 while sigma_n' < 0
is back after 2 sigma_n / -sigma_n': where that is shorter than the shortest bounce, sigma_n is
taken away. Bounces that grow shorter without end, a ball's or those of a box that rocks, end so.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import compress
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.contacts.candidates import Candidates
from condyn_pin.contact.indeterminacy import Indeterminacy
from condyn_pin.contact.problem import OPEN, SLIDE, STICK, ContactProblem, ContactSets, Level, Modes
from condyn_pin.contact.restitution import RestitutionLaw
from condyn_pin.contact.solution import attempt_contact, attempt_near
from condyn_pin.contact.solvers.contact_solver import ContactSolver
from condyn_pin.errors import StepFailed
from condyn_pin.simulation.events import ZenoDetected
from condyn_pin.simulation.records import Note, notes_of
from condyn_pin.simulation.system import System, blocked_path_error
from condyn_pin.stepping.modes import (
    AT_ITS_END,
    ContactTerms,
    FixedModes,
    ModeDynamics,
    let_go,
    shared_loads,
)

# Velocities of what stands still that are rounding, relative to the speed of the robot.
_ROUNDED = 1e-14

# Impacts in one instant, at most: behind one contacts approach again only by rounding.
_MOST = 100


@dataclass(frozen=True, eq=False)
class PhaseStart:
    """A state from which motion goes on smoothly."""

    terms: ContactTerms  # the state behind all that has happened in this instant
    # dynamics, held: modes, and accelerations and forces
    dynamics: ModeDynamics
    held: FixedModes
    natural: float  # residual of the problem that gave the modes [1]
    impulse: Array  # (rows,) impulses of the instant [N s]
    work: float = 0.0  # their work [J]
    driven: float = 0.0  # work of driven constraints in the instant [J]
    what: str = ""  # ``impact``, ``shock``, or nothing

    def without_impulse(self) -> PhaseStart:
        """The state without its impulse and work, once these are counted."""
        return replace(self, impulse=np.zeros_like(self.impulse), work=0.0, driven=0.0, what="")


class Transition:
    """Impacts and shocks at one instant, for one system.

    shortest: the shortest bounce [s]
    notes: sentences on the instants so far, each with its time [s]
    """

    def __init__(self, system: System, choice: NextModes, shortest: float) -> None:
        self._system, self._shortest = system, shortest
        self._choice = choice
        self.notes: list[tuple[float, Note]] = []

    def at(self, t: float, q: Array, v: Array, *, at_end: bool = False) -> PhaseStart:
        """Start of the smooth motion from a state, behind its impacts and shocks."""
        # `at_end` is true if a force has just reached the limit of its contact.
        impulse, what = np.zeros(self._system.contacts.rows), ""
        work = driven = 0.0
        for _ in range(_MOST):
            terms = ContactTerms(self._system, t, q, v)
            if terms.approaches.any():
                struck, what = self._choice.impact(terms), "impact"
                self._note(t)
                self.notes += [(t, Note(*note)) for note in struck.notes]
            else:
                choice = self._choice.next(terms)
                self._note(t)
                if choice.dynamics is not None:
                    dynamics, held = self._shared(terms, choice.dynamics, at_end)
                    settled = self._settled(terms, dynamics, held)
                    if settled is v:
                        return PhaseStart(
                            terms=terms,
                            dynamics=dynamics,
                            held=held,
                            natural=choice.natural,
                            impulse=impulse,
                            work=work,
                            driven=driven,
                            what=what,
                        )
                    v = settled
                    continue
                struck, what = self._choice.shock(terms, choice), "shock"
            v, impulse = struck.v, impulse + struck.impulse
            work, driven = work + struck.work, driven + struck.driven
            at_end = False
        raise ZenoDetected(f"contacts go on striking at t = {t:g} s; take a stepper, as Moreau()")

    def _note(self, t: float) -> None:
        """Note the velocities that the last contact problem does not determine."""
        self.notes += [(t, note) for note in notes_of(self._choice.several)]

    def _shared(
        self, terms: ContactTerms, dynamics: ModeDynamics, at_end: bool
    ) -> tuple[ModeDynamics, FixedModes]:
        """Modes of the motion that follows and their forces, with the load shared."""
        shares = shared_loads(self._system.contacts, dynamics, terms)
        if not at_end or shares.least > AT_ITS_END:
            return shares.dynamics, shares.held
        dynamics = let_go(self._system.contacts, shares)
        return dynamics, dynamics.solve(terms)

    def _settled(self, terms: ContactTerms, dynamics: ModeDynamics, held: FixedModes) -> Array:
        """Velocity v without too short bounces, and with contacts at rest to rounding (nv,)."""
        normals = self._system.contacts.normals
        rate, leaving = held.rate[normals], terms.touches & ~terms.rests
        back = leaving & (2 * terms.closing < -self._shortest * rate)
        off = float(np.abs(terms.sigma[dynamics.still]).max(initial=0.0))
        if not back.any() and off <= _ROUNDED * terms.fastest:
            return terms.v
        return terms.held(terms.v, np.concatenate((dynamics.still, normals[back])))


# Which contacts press, stick and slide next: a contact problem of accelerations.
#
#     sigma' = G lam + J_c a_free + Jdot_c v,    K contains lam,    K* contains d(sigma'),
#     orthogonal
#
# of all that touches. What is still may stick: Coulomb's law says whether it does, and where it
# begins to slide. What slides goes on: its tangential row of sigma' is that much larger than all
# accelerations, so that the cone answers with -mu lam_n s. Where it does not, no force lets it
# slide on (Painlevé), and only an impulse does: a frictional shock,
#
#     M (v+ - v) = J_b^T l_b + J_c^T l,    J_b v+ = 0,    sigma+ = J_c v+,    l in K
#
# although nothing approaches. Impacts obey a law of restitution (`contact.restitution`); where that
# is Newton's, or gives the same, they are this problem with
#
#     sigma_n+ + e min(sigma_n, 0) >= 0,    orthogonal to l_n.
#
# References
# ----------
# Pfeiffer, Glocker. Multibody dynamics with unilateral contacts. Wiley, 1996.
# Génot, Brogliato. New results on Painlevé paradoxes. European Journal of Mechanics A 18, 1999.


# What slides has a larger sigma' than accelerations give, by this factor.
_FAR = 1e4

# Natural residual that is asked for: of what is _FAR larger, 1e-9 of the accelerations.
_ACCURATE = 1e-13

# Accelerations, and forces by what they accelerate, that are none, relative to the largest.
_NONE = 1e-8


class ModeChoice(NamedTuple):
    """Next modes of the contacts, and the residual of their problem."""

    dynamics: ModeDynamics | None  # None if no force lets what slides go on
    natural: float  # residual of the problem [1]
    guess: Array  # (rows,), impulses that stop what slides [N s]


class ImpactResult(NamedTuple):
    """An impact or a shock."""

    v: Array
    impulse: Array  # (rows,) [N s]
    work: float  # [J]
    driven: float  # work of driven constraints [J]
    notes: tuple[tuple[str, tuple[str, ...], str], ...] = ()


class NextModes:
    """Finds modes and impulses for the contacts of one system."""

    def __init__(
        self, candidates: Candidates, solver: ContactSolver, restitution: RestitutionLaw
    ) -> None:
        self._candidates, self._solver, self._restitution = candidates, solver, restitution
        self.several: tuple[Indeterminacy, ...] = ()  # of the last problem
        k, n = candidates.cones, candidates.half_lines
        self._all_dry = np.ones(candidates.intervals, dtype=bool)
        self._parts = slice(0, 3 * k), slice(3 * k, 3 * k + n), slice(3 * k + n, candidates.rows)

    def next(self, terms: ContactTerms) -> ModeChoice:
        """Modes of the contacts from a state in which none approaches."""
        candidates, (cones, lines, dry) = self._candidates, self._parts
        active = np.concatenate((terms.rests, self._all_dry))
        rows, lam, rate = candidates.rows_of(active), np.zeros(len(terms.J)), np.zeros(len(terms.J))
        slides = terms.slides & terms.rests[: candidates.cones] & (candidates.friction > 0)
        along, sense = np.zeros((candidates.cones, 2)), np.sign(terms.dry)
        along[slides] = terms.tangent[slides] / terms.speed[slides, None]
        pushed = np.zeros(len(terms.J))
        pushed[cones].reshape(-1, 3)[:, :2], pushed[dry] = along, sense
        now = terms.forced(np.flatnonzero(rows))
        g = now.contact_velocities + terms.drift[rows]
        scale = float(np.abs(g).max(initial=0.0)) or tolerances.GRAVITY
        far = g + _FAR * scale * pushed[rows]
        problem = self._problem(active, now.G, far, candidates.limits, "acceleration")
        lam[rows], natural = self._answer(problem, None)
        rate[rows] = problem.velocities(lam[rows]) / scale
        unit = problem.scale[0] / scale  # forces as accelerations, relative to the largest
        stopped = np.einsum("kx,kx->k", rate[cones].reshape(-1, 3)[:, :2], along) < _FAR / 2
        if (slides & stopped).any() or not natural <= tolerances.CONTACT_SOLVED:
            fastest = float(terms.speed[slides].max(initial=0.0))
            return ModeChoice(None, natural, lam * (fastest / (_FAR * scale)))
        of_cones = self._of_cones(lam[cones] * unit, rate[cones], slides, along)
        of_lines = np.where(lam[lines] * unit > _NONE, STICK, OPEN)
        moves = (sense == 0) & (np.abs(rate[dry]) > _NONE)
        sense[moves] = np.sign(rate[dry][moves])
        of_dry = np.where(sense == 0, STICK, SLIDE)
        modes = np.concatenate((of_cones, of_lines, of_dry))
        return ModeChoice(ModeDynamics(candidates, modes, along, sense, lam), natural, lam)

    def impact(self, terms: ContactTerms) -> ImpactResult:
        """Impact of approaching contacts, by the law of restitution."""
        e = np.zeros(len(terms.gaps))
        e[: self._candidates.cones] = self._candidates.restitution
        struck, natural = self._struck(terms, e, None)
        if not natural <= tolerances.CONTACT_SOLVED:
            self._check_path(terms)
            raise StepFailed(
                f"the impact of {self._named(terms.approaches)} at t = {terms.t:g} s: "
                f"{self._solver!r} leaves a natural residual of {natural:.1e}; take a stepper, "
                "such as Moreau()"
            )
        return struck

    def _check_path(self, terms: ContactTerms) -> None:
        """Refuse paths that press bodies into each other, where all bodies are rigid."""
        rows = np.asarray(self._candidates.normals)[terms.approaches]
        now = terms.struck(rows)
        stuck = (now.G.diagonal() == 0.0) & (now.contact_velocities < 0.0)
        if terms.path.any() and stuck.any():
            which = np.zeros(len(terms.gaps), dtype=bool)
            which[np.flatnonzero(terms.approaches)[stuck]] = True
            raise blocked_path_error(self._named(which), terms.t)

    def shock(self, terms: ContactTerms, choice: ModeChoice) -> ImpactResult:
        """Shock that stops slips where no finite force allows them to go on."""
        struck, natural = self._struck(terms, np.zeros(len(terms.gaps)), choice.guess)
        changed = np.abs(struck.v - terms.v).max(initial=0.0) > _NONE * terms.fastest
        if not (natural <= tolerances.CONTACT_SOLVED and changed):
            raise StepFailed(
                f"contacts {self._named(terms.rests)} at t = {terms.t:g} s: {self._solver!r} finds "
                f"no forces (natural residual {choice.natural:.1e}), and no impulse that would "
                "stop them; take a stepper, such as StewartTrinkle()"
            )
        return struck

    def _of_cones(
        self, force: Array, rate: Array, slides: NDArray[np.bool_], along: Array
    ) -> Modes:
        """Return the modes of cones; into `along` goes where what begins to slide goes."""
        S = rate.reshape(-1, 3)[:, :2]
        slip = np.hypot(*S.T)
        moves = ~slides & (self._candidates.friction > 0) & (slip > _NONE)
        along[moves] = S[moves] / slip[moves, None]
        sticks = ~slides & ~moves & (self._candidates.friction > 0)
        return np.where(force[2::3] > _NONE, np.where(sticks, STICK, SLIDE), OPEN)

    def _struck(
        self, terms: ContactTerms, e: Array, guess: Array | None
    ) -> tuple[ImpactResult, float]:
        """Impact of all touching contacts, and its natural residual."""
        # Contacts that the law of restitution resolves by itself rebound first, the rest by
        # Newton's.
        active = np.concatenate((terms.touches, ~self._all_dry))
        rows, impulse = self._candidates.rows_of(active), np.zeros(len(terms.J))
        now = terms.struck(np.flatnonzero(rows))
        problem = self._problem(active, now.G, now.contact_velocities, np.zeros(0), "impulse")
        e, first = e[terms.touches], np.zeros(problem.rows)
        notes: tuple[tuple[str, tuple[str, ...], str], ...] = ()
        missed = 0.0
        if e.any():
            strike = self._restitution.strike(problem, e)
            first, e, notes = strike.lam, np.where(strike.apart, 0.0, e), strike.notes
            missed = strike.natural
        g = problem.velocities(first) if first.any() else problem.g.copy()
        g[problem.sets.normals] += e * np.minimum(terms.closing[terms.touches], 0.0)
        begin = None if guess is None else guess[rows]
        found, natural = self._answer(problem.replaced(g=g), begin)
        impulse[rows], natural = first + found, max(natural, missed)
        v = now.velocity(impulse[rows])
        work = 0.5 * float(impulse.dot(terms.sigma + terms.J.dot(v)))
        driven = float(now.constraint_impulses(impulse[rows]).dot(terms.path[1]))
        return ImpactResult(v, impulse, work, driven, notes), natural

    def _answer(self, problem: ContactProblem, guess: Array | None) -> tuple[Array, float]:
        if guess is None:
            found, natural = attempt_contact(problem, self._solver, None, _ACCURATE)
        else:  # no impulse is an answer, and no force goes on from there
            found, natural = attempt_near(problem, self._solver, guess, _ACCURATE)
        self.several = found.several
        return found.lam, natural

    def _problem(
        self, active: NDArray[np.bool_], G: Array, g: Array, limits: Array, level: Level
    ) -> ContactProblem:
        """Return the problem of the candidates that are active, with limits of dry friction."""
        candidates = self._candidates
        k, lines = candidates.cones, candidates.cones + candidates.half_lines
        friction, stops = candidates.friction[active[:k]], int(active[k:lines].sum())
        return ContactProblem.trusted(
            G=G, g=g, friction=friction, half_lines=stops, limits=limits, R=None, law="ncp",
            level=level, names=tuple(compress(candidates.names, active)),
            sets=ContactSets(friction, stops, limits),
        )  # fmt: skip

    def _named(self, which: NDArray[np.bool_]) -> str:
        return ", ".join(compress(self._candidates.names, which))
