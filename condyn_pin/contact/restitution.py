"""Restitution: laws of what contacts give back at an impact, with friction.

    sigma+ = sigma- + G lam,    dT = lam . (sigma- + sigma+) / 2

    Newton       sigma_n+ + e sigma_n- >= 0,  orthogonal to lam_n,  Coulomb's law at the end
    Poisson      expansion gives e times the normal impulses of compression
    Energetic    expansion gives back e^2 of the normal work of compression (Stronge)

Without friction, and with one e, the three are one; so they are where normal impulses move nothing
along the contact, as at a ball. Elsewhere Newton's law turns friction into rebound: a leaning rod
that strikes a floor with e = 1 and mu = 0.5 may bounce with a fifth more energy than it had. The
other two go through an impact in two phases, and never add energy:

    compression    Coulomb's and Signorini's law with e = 0, which takes the normal work
                   D_i = -lam_n,i (sigma_n,i- + sigma_n,i) / 2
    expansion      normal impulses theta e_i lam_n,i, friction |l_t| <= mu l_n under them (convex);
                   theta is 1 (Poisson), or such that the normal work given back is sum e_i^2 D_i,
                   and all work given back at most max e^2 of all that compression took
    again          while something approaches, and in the end with e = 0

One contact that strikes by itself goes along its own path in place of that, exactly
(`normal_path`), and so do phases of many pieces.

Several contacts that strike in one instant do so by a law of their own, which restitution leaves
open: all at once, or one after the other (`chain`). Both keep momentum and add no energy; notices
say where it matters.

References
----------
Stronge. Rigid body collisions with friction. Proceedings of the Royal Society A 431, 1990.
Brach. Rigid body collisions. Journal of Applied Mechanics 56, 1989: Newton's law gains energy.
Brogliato. Nonsmooth mechanics. Springer, 2016, chapters 4 and 5.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from math import hypot
from typing import ClassVar, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core import tolerances
from condyn_pin._core.arguments import check_count, check_type, listed, register
from condyn_pin._core.arrays import Array
from condyn_pin.contact.normal_path import End, normal_path
from condyn_pin.contact.problem import ContactProblem, Island, island_of, islands
from condyn_pin.contact.solution import fallbacks, first_attempt
from condyn_pin.contact.solvers.newton import SemismoothNewton

RESTITUTION_LAWS: dict[str, type[RestitutionLaw]] = {}

# Approach that is none, relative to the largest velocity of the contacts: what compression leaves.
_NONE: Final = 1e-10

# How often contacts strike again in one impact, at most; stacks with small e come to rest so.
_PASSES: Final = 60

# Normal impulses by what slips, relative to G_nn, that are rounding: a ball has none.
_APART: Final = 1e-12

# The largest share of e by which expansion is scaled: what jams gives nothing back however it is
# pushed.
_MOST: Final = 2.0

# Sweeps over the contacts for friction under given normal impulses, and Newton's steps from there.
_SWEEPS, _STEPS, _RESIDUAL = 40, 30, 1e-13

# Energy that an impact gains beside rounding, relative to what its impulses take and give.
_GAINED: Final = 1e-9


class ImpactAnswer(NamedTuple):
    """An impact, as a law of restitution answers it."""

    lam: Array  # (m,) impulses of the contacts that it answers; zero of all others [N s]
    # (contacts,) which contacts these are: of the others Newton's law is the answer
    apart: NDArray[np.bool_]
    natural: float  # residual of the contact problems behind it [1]
    # what deserves attention: its kind, names of contacts, and a sentence
    notes: tuple[tuple[str, tuple[str, ...], str], ...]


@dataclass(frozen=True)
class RestitutionLaw(ABC):
    """A law of restitution; a frozen value."""

    title: ClassVar[str]

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        register(RESTITUTION_LAWS, cls.__name__.lower(), cls, f"a law named {cls.__name__}")

    def strike(
        self, problem: ContactProblem, restitution: Array, *, always: bool = False
    ) -> ImpactAnswer:
        """Return the impulses of an impact where the law is not Newton's.

        Parameters
        ----------
        problem : ContactProblem
            Of cones and half-lines that touch: g is sigma before the impact [m/s].
        restitution : (contacts,) array
            Of each of them, zero of half-lines [1].
        always : bool
            Also where Newton's law gives the same.

        Notes
        -----
        Cost: 0.3 ms for one contact in a plane, 10 ms in space or for several.
        """
        lam, apart, natural = np.zeros(problem.rows), np.zeros(len(restitution), dtype=bool), 0.0
        notes = list[tuple[str, tuple[str, ...], str]]()
        for island, contacts in _parts(problem):
            part = island.problem(problem)
            e = restitution[contacts]
            slow = _NONE * float(np.abs(part.g).max(initial=0.0))
            if not ((part.g[part.sets.normals] < -slow) & (e > 0)).any():
                continue
            if together := _at_once(part, e):
                text = (
                    f"{listed(together)} touch and strike at once, and impact laws differ where "
                    f"several do: {self._order}"
                )
                notes.append(("at once", together, text))
            if not always and _is_newtons(part, e):
                continue
            answer = self._answer(part, e)
            if answer.gained:
                text = (
                    f"restitution: Newton's law adds {answer.gained:.3g} J at "
                    f"{listed(part.names)}, where friction turns into rebound; Energetic(), the "
                    "default, does not"
                )
                notes.append(("gained", part.names, text))
                continue
            if answer.lam is not None:
                lam[island.rows], apart[contacts] = answer.lam, True
                natural = max(natural, answer.missed / problem.scale[1])
        return ImpactAnswer(lam, apart, natural, tuple(notes))

    @property
    def _order(self) -> str:
        """Order in which several contacts strike, as the end of a sentence."""
        return "this is all of them at once; Energetic(chain=True) passes impacts on"

    @abstractmethod
    def _answer(self, problem: ContactProblem, e: Array) -> _Answer:
        """Return the impulses of contacts that feel each other."""


class _Answer(NamedTuple):
    """Impulses of contacts that feel each other; None where Newton's law answers."""

    lam: Array | None
    missed: float  # what the contact problems behind it are off by [m/s]
    gained: float = 0.0  # energy that the law adds [J]


@dataclass(frozen=True)
class Newton(RestitutionLaw):
    """Newton's law of restitution: speeds of separation are e times those of approach.

    sigma_n+ + e sigma_n- >= 0,    orthogonal to lam_n

    With friction it may add energy; where it does, notices say how much.

    References
    ----------
    Newton. Philosophiae naturalis principia mathematica, 1687.
    """

    title: ClassVar[str] = "Newton"

    def _answer(self, problem: ContactProblem, e: Array) -> _Answer:
        n = problem.sets.normals
        g = problem.g.copy()
        g[n] += e * np.minimum(g[n], 0.0)
        lam, missed = _coulomb(problem.replaced(g=g))
        gained = work(problem, lam)
        small = _GAINED * float(np.abs(lam).dot(np.abs(problem.g)))
        is_solved = missed <= tolerances.CONTACT_SOLVED * problem.scale[1]
        return _Answer(None, missed, gained if is_solved and gained > small else 0.0)


@dataclass(frozen=True)
class Poisson(RestitutionLaw):
    """Poisson's law of restitution: expansion has e times the normal impulse of compression.

    lam_n of expansion = e lam_n of compression

    It never adds energy, and takes some where friction alone would take less.

    References
    ----------
    Pfeiffer, Glocker. Multibody dynamics with unilateral contacts. Wiley, 1996.
    """

    title: ClassVar[str] = "Poisson"

    def _answer(self, problem: ContactProblem, e: Array) -> _Answer:
        return _Answer(*_until_apart(problem, e, "poisson", 1))


@dataclass(frozen=True)
class Energetic(RestitutionLaw):
    """Stronge's law of restitution: expansion gives back e^2 of the work of compression.

    normal work given back = sum e_i^2 D_i,    D_i the normal work that contact i took

    It never adds energy. One contact that strikes by itself follows its path exactly; several go
    through two phases.

    Parameters
    ----------
    pieces : int
        Pieces of each phase of several contacts: with many of them, friction follows slip that
        turns or stops on the way. One contact needs none.
    chain : bool
        Whether only contacts that approach strike, all of these together, and those that they push
        on strike after them: Newton's cradle passes its balls on. Otherwise all that touch strike
        at once.

    Raises
    ------
    InvalidArgument
        If `pieces` is no count, or `chain` neither True nor False.

    References
    ----------
    Stronge. Rigid body collisions with friction. Proceedings of the Royal Society A 431, 1990.
    """

    title: ClassVar[str] = "energetic"

    pieces: int = 1
    chain: bool = False

    def __post_init__(self) -> None:
        check_count("pieces", self.pieces)
        check_type("chain", self.chain, bool, "True or False is needed")

    @property
    def _order(self) -> str:
        if not self.chain:
            return super()._order
        return "this passes impacts on from contact to contact; Energetic() is all of them at once"

    def strike(
        self, problem: ContactProblem, restitution: Array, *, always: bool = False
    ) -> ImpactAnswer:
        """Return the impulses of an impact where the law is not Newton's."""
        return super().strike(problem, restitution, always=always or self.chain)

    def _answer(self, problem: ContactProblem, e: Array) -> _Answer:
        return _Answer(*_until_apart(problem, e, "stronge", self.pieces, chain=self.chain))


def check_law(law: object) -> None:
    """Refuse what is no law of restitution."""
    check_type(
        "restitution_law", law, RestitutionLaw, "a law is needed, such as Energetic() or Newton()"
    )


def work(problem: ContactProblem, lam: Array) -> float:
    """Return lam . (sigma- + sigma+) / 2, the energy that impulses add [J]; g is sigma-."""
    return 0.5 * float(lam.dot(problem.g + problem.velocities(lam)))


def _parts(problem: ContactProblem) -> list[tuple[Island, NDArray[np.int_]]]:
    """Return the contacts that feel each other, with their places."""
    blocks = problem.sets.blocks
    everything = np.arange(len(problem.names))
    apart = islands(problem) or (island_of(problem.sets, problem.names, everything),)
    return [(island, np.unique(blocks[island.rows])) for island in apart]


def _at_once(problem: ContactProblem, e: Array) -> tuple[str, ...]:
    """Return the names of several contacts that strike in one instant."""
    small = _NONE * float(np.abs(problem.g).max(initial=0.0))
    those = np.flatnonzero((problem.g[problem.sets.normals] <= small) & (e > 0))
    return tuple(problem.names[i] for i in those) if len(those) > 1 else ()


def _is_newtons(problem: ContactProblem, e: Array) -> bool:
    """True if Newton's law gives the same impulses."""
    # Without friction and with one e; and at one contact where normal impulses leave slip alone,
    # and slip keeps its direction.
    if not problem.friction.any() and (e == e[0]).all():
        return True
    if len(e) > 1:
        return False
    G, (x, y), size = problem.G, problem.g[:2], float(np.abs(problem.G).max())
    if hypot(G[0, 2], G[1, 2]) > _APART * size:
        return False
    turns = x * (G[1, 0] * x + G[1, 1] * y) - y * (G[0, 0] * x + G[0, 1] * y)
    return bool(abs(turns) <= _APART * size * (x * x + y * y))


def _until_apart(
    problem: ContactProblem, e: Array, end: End, pieces: int, *, chain: bool = False
) -> tuple[Array, float]:
    """Impulses with which nothing approaches any more, of repeated strikes."""
    # All that touch strike at once, or in a `chain` those that approach; contacts without
    # restitution hold.
    n, worst, lam = problem.sets.normals, 0.0, np.zeros(problem.rows)
    small = _NONE * float(np.abs(problem.g).max(initial=0.0))
    for _ in range(_PASSES):
        left = problem.replaced(g=problem.velocities(lam))
        hits = left.g[n] < -small
        if not hits.any():
            return lam, worst
        those = np.flatnonzero(hits | (e == 0) if chain else np.ones_like(hits))
        island = island_of(left.sets, left.names, those)
        found, missed = _single_strike(island.problem(left), e[those], end, pieces)
        lam[island.rows] += found
        worst = max(worst, missed)
    left = problem.replaced(g=problem.velocities(lam))
    found, missed = _coulomb(left)
    return lam + found, max(worst, missed)


def _single_strike(problem: ContactProblem, e: Array, end: End, pieces: int) -> tuple[Array, float]:
    """Impulses of contacts that strike once: one along its path, several in two phases."""
    if len(problem.friction) == 1 and not problem.half_lines:
        mu = float(problem.friction[0])
        return normal_path(problem.G, problem.g, mu, float(e[0]), end), 0.0
    comp, taken_n, missed = _compressed(problem, pieces)
    n = problem.sets.normals
    push, after = e * comp[n], problem.replaced(g=problem.velocities(comp))
    if end == "poisson" or not push.any():
        return comp + _expanded(after, push, pieces).lam, missed
    to_return, most = float((e**2).dot(taken_n)), -(float(e.max()) ** 2) * work(problem, comp)
    if to_return <= 0.0:
        return comp, missed
    from scipy.optimize import brentq

    def beyond(theta: float) -> float:
        given = _expanded(after, theta * push, pieces)
        return max(given.normal_work - to_return, given.work - most)

    theta = brentq(beyond, 0.0, _MOST, xtol=1e-13) if beyond(_MOST) > 0.0 else 1.0
    return comp + _expanded(after, theta * push, pieces).lam, missed


def _compressed(problem: ContactProblem, pieces: int) -> tuple[Array, Array, float]:
    """Return impulses of compression, the normal work that each contact took, and a residual."""
    # The normal impulses of Coulomb's law with e = 0 give a direction; along it friction follows in
    # pieces until the normal power of all together is zero, and Coulomb's law stops what approaches
    # still.
    n, (whole, missed) = problem.sets.normals, _coulomb(problem)
    if pieces == 1:
        return whole, _taken(problem, whole), missed
    lam, taken, push = np.zeros(problem.rows), np.zeros(len(n)), whole[n] / pieces
    size = float(np.abs(problem.g).max(initial=0.0))
    for _ in range(50 * pieces):
        now = problem.replaced(g=problem.velocities(lam))
        found = _friction_under(now, push)
        first, last = push.dot(now.g[n]), push.dot(now.velocities(found)[n])
        if last >= 0.0:
            found = found * (first / (first - last))
        taken += _taken(now, found)
        lam = lam + found
        if last >= 0.0:
            break
    now = problem.replaced(g=problem.velocities(lam))
    if (now.g[n] < -_NONE * size).any():
        found, more = _coulomb(now)
        return lam + found, taken + _taken(now, found), max(missed, more)
    return lam, taken, missed


def _taken(problem: ContactProblem, lam: Array) -> Array:
    n = problem.sets.normals
    return np.asarray(-0.5 * lam[n] * (problem.g[n] + problem.velocities(lam)[n]))


class _Expansion(NamedTuple):
    """Impulses and work of expansion."""

    lam: Array
    work: float  # [J]
    normal_work: float  # [J]


def _expanded(problem: ContactProblem, push: Array, pieces: int) -> _Expansion:
    """Return the expansion of normal impulses `push` (contacts,), friction following in pieces."""
    lam, all_work, normal_work = np.zeros(problem.rows), 0.0, 0.0
    for _ in range(pieces):
        now = problem.replaced(g=problem.velocities(lam))
        found = _friction_under(now, push / pieces)
        all_work += work(now, found)
        normal_work -= float(_taken(now, found).sum())
        lam = lam + found
    return _Expansion(lam, all_work, normal_work)


def _coulomb(problem: ContactProblem) -> tuple[Array, float]:
    """Return impulses that end all approach by Coulomb's law, and what they miss of it [m/s]."""
    solver, enough = SemismoothNewton(), tolerances.CONTACT_SOLVED
    found, natural = first_attempt(problem, solver, None, tolerances.CONTACT_POLISHED)
    if not natural <= enough:
        found, natural = fallbacks(problem, solver, found, enough)
    return found.lam, natural * problem.scale[1]


def _friction_under(problem: ContactProblem, push: Array) -> Array:
    """Return impulses with these normal ones, and friction that opposes slip under them (Tresca).

    min  l_t G_tt l_t / 2 + sigma_t . l_t,    |l_t,i| <= mu_i l_n,i

    Convex, so that slip is unique: by sweeps over the contacts, and Newton's method from there.
    """
    sets = problem.sets
    lam, k = np.zeros(problem.rows), len(problem.friction)
    lam[sets.normals] = push
    limits = problem.friction * push[:k]
    rows = sets.of_cones[:, :2].ravel()
    if not (limits > 0.0).any():
        return lam
    A, b = problem.G[np.ix_(rows, rows)], problem.velocities(lam)[rows]
    lam[rows] = _within_disks(A, b, limits)
    return lam


def _within_disks(A: Array, b: Array, limits: Array) -> Array:
    """Return x of min x A x / 2 + b . x with |x_i| <= limit_i, of pairs x_i."""
    k = len(limits)
    stiff = [float(np.linalg.eigvalsh(A[i : i + 2, i : i + 2])[-1]) for i in range(0, 2 * k, 2)]
    x, size = np.zeros(2 * k), float(np.abs(b).max())
    for _ in range(_SWEEPS):
        moved = 0.0
        for i, (most, c) in enumerate(zip(limits.tolist(), stiff, strict=True)):
            if not (most and c):
                continue
            its = slice(2 * i, 2 * i + 2)
            x_i = _clip_norms(x[its] - (A[its].dot(x) + b[its]) / c, most)
            moved = max(moved, c * float(np.abs(x_i - x[its]).max()))
            x[its] = x_i
        if moved <= _RESIDUAL * size:
            return x
    best, least = x, _slip_law_error(A, b, x, limits, stiff)
    for _ in range(_STEPS):
        if least <= _RESIDUAL * size:
            break
        x = _newtons_step(A, b, x, limits)
        error = _slip_law_error(A, b, x, limits, stiff)
        if not error < least:
            break
        best, least = x, error
    return best


def _clip_norms(x: Array, most: float) -> Array:
    size = hypot(*x)
    return x * (most / size) if size > most else x


def _slip_law_error(A: Array, b: Array, x: Array, limits: Array, stiff: list[float]) -> float:
    """Return the error of x in the law of friction at its own slip, as a velocity [m/s]."""
    s, worst = A.dot(x) + b, 0.0
    for i, (most, c) in enumerate(zip(limits.tolist(), stiff, strict=True)):
        its = slice(2 * i, 2 * i + 2)
        if most and c:
            off = x[its] - _clip_norms(x[its] - s[its] / c, most)
            worst = max(worst, c * float(np.abs(off).max()))
    return worst


def _newtons_step(A: Array, b: Array, x: Array, limits: Array) -> Array:
    """Return x after one step of Newton's method: what is inside sticks, all else slides."""
    s = A.dot(x) + b
    J, left = A.copy(), s.copy()
    for i, most in enumerate(limits.tolist()):
        its, (u, w) = slice(2 * i, 2 * i + 2), s[2 * i : 2 * i + 2]
        slip = hypot(u, w)
        if most and (hypot(*x[its]) < most * (1.0 - 1e-9) or not slip):
            continue
        J[its], left[its] = 0.0, x[its]
        J[2 * i, 2 * i] = J[2 * i + 1, 2 * i + 1] = 1.0
        if most:
            along = np.array([u, w]) / slip
            across = np.eye(2) - np.outer(along, along)
            J[its] += most / slip * across.dot(A[its])
            left[its] += most * along
    return np.asarray(x - np.linalg.lstsq(J, left, rcond=_APART)[0])
