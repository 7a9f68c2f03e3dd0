"""ContactSolution: impulses that carry their own proof, and the attempts that find them.

Attempts at a contact problem: island by island, until a natural residual is accepted. Where several
motions obey Coulomb's law, the answer is that of `indeterminacy`, whatever the solver found.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from math import isfinite, isnan, nan
from time import perf_counter
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core import tolerances
from condyn_pin._core.arguments import check_accuracy_of_a, check_type, count_text
from condyn_pin._core.arrays import Array, finite, read_only, rounded, text_of
from condyn_pin._core.show import Outcome
from condyn_pin._core.threads import one_blas_thread
from condyn_pin.contact.indeterminacy import Indeterminacy, by_rule, is_determined
from condyn_pin.contact.problem import ContactProblem, islands
from condyn_pin.contact.residuals import (
    ContactResiduals,
    contact_residuals,
    infeasible_contacts,
    natural_residual,
)
from condyn_pin.contact.solvers.admm import ADMM
from condyn_pin.contact.solvers.contact_solver import ContactSolver, SolverResult
from condyn_pin.errors import InvalidArgument, SolveFailed

# Why an answer is not ok, and its cure; a status names all cures, an error those not tried.
_INACCURATE: Final = (
    "the impulses do not meet the law of the problem to the accuracy asked for, or momentum or "
    "loops, where the notices of a step report it"
)
_NOT_FINITE: Final = "the impulses are not finite although the problem is: its numbers overflow"
_NEWTON: Final = "solve with SemismoothNewton()"
_STOPPED: Final = (
    "the budget of other attempts ended before one of them met the law of the problem to the "
    "accuracy asked for"
)
_POLYGON: Final = (
    "a polygon in place of the cone, Lemke(), never meets a sliding contact closer than its sides "
    "are to the circle"
)
_LOCKED: Final = (
    "friction that locks bodies, as in Painleve's rod, may need Lemke(), or a smaller step"
)


class ContactStatus(Outcome):
    """Outcome of a contact solve; the value is advice."""

    OK = "the impulses meet the law of the problem to the accuracy asked for"
    INACCURATE = f"{_INACCURATE}: allow more iterations, or {_NEWTON}; {_POLYGON}; {_LOCKED}"
    INFEASIBLE = (
        "no impulse can keep the contacts apart, as they are asked to: they press on what cannot "
        "move; look at bodies that are fixed, at the gaps of contacts between them, and at the "
        "velocities that the scheme prescribes"
    )
    NOT_FINITE = f"{_NOT_FINITE}; {_NEWTON}, or in other units"
    OUT_OF_BUDGET = f"{_STOPPED}: raise it, ADMM(budget=1000); {_LOCKED}"

    def text(self, tried: str, more: str = "") -> str:
        """Name and cause, and cures but for the solver that was `tried`; `more` is one of them."""
        newton = "" if tried == "SemismoothNewton" else _NEWTON
        if self is ContactStatus.INACCURATE:
            why = _POLYGON if tried == "Lemke" else _LOCKED
            return self.text_of(_INACCURATE, "allow more iterations", newton, more, why)
        if self is ContactStatus.NOT_FINITE:
            return self.text_of(_NOT_FINITE, newton, "use other units")
        if self is ContactStatus.OUT_OF_BUDGET:
            return self.text_of(_STOPPED, f"raise it, {tried}(budget=1000)", more, _LOCKED)
        return str(self)


@dataclass(frozen=True, eq=False, repr=False)
class ContactSolution:
    """Impulses and velocities of contacts, with residuals recomputed.

    sigma = G lam + g + R lam

    Attributes
    ----------
    lam : (m,) array
        Impulses on the robot, all rows, in the axes of each contact [N s].
    sigma : (m,) array
        Velocities of the contacts after the step [m/s].
    natural : float
        |lam - P_K(lam - d)|, or |sigma| of what sticks, in units of the problem [1]: zero if and
        only if it is solved.
    status : ContactStatus
        OK if `natural` is within the accuracy that was asked for.
    iterations : int
        Of all methods that were tried.
    path : tuple of str
        The methods that were tried; the last one found the answer.
    solve_time : float
        Time of the solve without the proof [s].
    problem : ContactProblem
        What was solved.
    unmet : tuple of str
        Contacts that no impulse can meet together, if the status is infeasible.
    several : tuple of Indeterminacy
        Contacts whose velocities Coulomb's law does not determine: `lam` is then chosen by the rule
        of equally compliant contacts, in the limit of rigid ones.
    """

    lam: Array  # [N s]
    sigma: Array  # [m/s]
    natural: float
    status: ContactStatus
    iterations: int
    path: tuple[str, ...]
    solve_time: float  # [s]
    problem: ContactProblem
    unmet: tuple[str, ...] = ()
    several: tuple[Indeterminacy, ...] = ()

    @cached_property
    def residuals(self) -> ContactResiduals:
        """Residual of each condition, whatever the solver was; computed when read."""
        with np.errstate(all="ignore"):  # of impulses that are not finite
            return contact_residuals(self.problem, self.lam)

    @cached_property
    def unique_motion(self) -> bool | None:
        """True if sigma is the only one that obeys the law; None where that is not decided.

        False: `several` says which contacts leave it open. True where the problem is convex, and
        where each contact with friction is alone and has G_nn > mu |G_nt|. Contacts with friction
        that feel each other have one motion most often, and no cheap proof of it.
        """
        return False if self.several else True if is_determined(self.problem) else None

    @property
    def could_hold(self) -> tuple[str, ...]:
        """Contacts that could hold what they touch by friction, although one of them moves."""
        wedges = (each for each in self.several if each.kind == "wedge")
        return tuple(name for each in wedges for name in each.names)

    @cached_property
    def unique_forces(self) -> bool:
        """True if lam is the only answer: G + R has full rank, but for rows that nothing moves.

        Where it has not, as on four corners of a box, contacts share a load in many ways that move
        nothing: compare J^T lam, and not lam. A row of friction that nothing moves, as that out of
        the plane of a plane mechanism, has no force.
        """
        problem = self.problem
        G = problem.G if problem.R is None else problem.G + np.diag(problem.R)
        size = np.sqrt(G.diagonal())
        n = problem.sets.normals
        if not size[n].all() or not size[problem.sets.parts[2]].all():
            return False
        moved = np.flatnonzero(size)
        scaled = G[moved[:, None], moved] / np.outer(size[moved], size[moved])
        eigenvalues = np.linalg.eigvalsh(scaled)
        return not len(moved) or bool(eigenvalues[0] > tolerances.CONTACT_RANK * eigenvalues[-1])

    @property
    def forces(self) -> dict[str, Array]:
        """Impulses by contact [N s]: (t1, t2, n) of a cone, one number of a stop or of friction."""
        blocks = self.problem.sets.blocks
        return {name: self.lam[blocks == i] for i, name in enumerate(self.problem.names)}

    @property
    def notices(self) -> tuple[str, ...]:
        """Notices, a sentence each."""
        said = []
        if self.unmet:
            said.append(f"no impulse can meet {', '.join(self.unmet)}")
        if self._locked:
            said.append(
                f"friction locks {', '.join(self._locked)}: they carry any load among themselves, "
                "and Coulomb's law need not have an answer; with less friction it has"
            )
        said += [each.text for each in self.several]
        if self.status.ok and not self.several and not self.unique_forces:
            said.append(
                "the contacts are redundant: lam is one of many"
                + ("; the motion is the same" if self.unique_motion else "")
            )
        return tuple(said)

    @cached_property
    def _locked(self) -> tuple[str, ...]:
        """Contacts that a ccp has no answer for, where an ncp was not answered."""
        missed = ContactStatus.INACCURATE, ContactStatus.OUT_OF_BUDGET
        if self.status not in missed or self.problem.law != "ncp":
            return ()
        with np.errstate(all="ignore"):
            return infeasible_contacts(self.problem.replaced(law="ccp"))

    def __repr__(self) -> str:
        return (
            f"ContactSolution({len(self.problem.names)} contacts: {self.status.word}, "
            f"natural residual {self.natural:.1e})"
        )

    def __str__(self) -> str:
        impulses = self.problem.level == "impulse"
        lines = [
            f"{self.status.word} in {1e6 * self.solve_time:.1f} us, "
            f"{count_text(self.iterations, 'iteration')} of {', '.join(self.path) or 'nothing'}",
            *(f"{name:<16} {size:.1e}" for name, size in self.residuals._asdict().items()),
            f"{'impulses' if impulses else 'forces'} on the robot, axes of each contact "
            f"[{'N s' if impulses else 'N'}]:",
        ]
        for name, force in self.forces.items():
            lines.append(f"{name:<28} {rounded(force)}")
        lines += [f"note: {notice}" for notice in self.notices]
        return "\n".join(lines)


# Attempts, island by island, until a natural residual is accepted.


_Answer: TypeAlias = Callable[
    [ContactProblem, ContactSolver, Array | None, float], tuple[SolverResult, float]
]
_Choose: TypeAlias = Callable[
    [ContactProblem, SolverResult, float, float], tuple[SolverResult, float]
]


@one_blas_thread
def attempt_contact(
    problem: ContactProblem, solver: ContactSolver, guess: Array | None, accuracy: float
) -> tuple[SolverResult, float]:
    """Return impulses and their natural residual, for hot loops.

    The solver goes on until that residual is within `accuracy`, or it has nothing left to try.
    Independent groups of contacts are solved separately.

    Parameters
    ----------
    problem : ContactProblem
        The contact problem.
    solver : ContactSolver
        One that knows the law of the problem.
    guess : (m,) array or None
        Impulses to begin with [N s].
    accuracy : float
        As in `solve_contact`.

    Returns
    -------
    SolverResult
        The best that was found.
    float
        Its natural residual; larger than `accuracy`, or NaN, where the impulses are wrong [1].

    Notes
    -----
    Cost: that of the solver, and about 20 us.
    """
    return _solve_islands(problem, solver, guess, accuracy, _insist)


@one_blas_thread
def attempt_near(
    problem: ContactProblem, solver: ContactSolver, guess: Array, accuracy: float
) -> tuple[SolverResult, float]:
    """Return the impulses that the solver finds from a guess, whatever other answers there are."""
    return _solve_islands(
        problem, solver, guess, accuracy, _insist, lambda _, found, natural, __: (found, natural)
    )


@one_blas_thread
def first_attempt(
    problem: ContactProblem, solver: ContactSolver, guess: Array | None, accuracy: float
) -> tuple[SolverResult, float]:
    """Return the first attempt of a solver with its natural residual, accurate enough or not."""
    return _solve_islands(problem, solver, guess, accuracy, _first_attempt)


@one_blas_thread
def fallbacks(
    problem: ContactProblem, solver: ContactSolver, found: SolverResult, accuracy: float
) -> tuple[SolverResult, float]:
    """Return the best of an inaccurate first attempt and of the solver's other attempts."""

    def others(
        part: ContactProblem, solver: ContactSolver, lam: Array | None, enough: float
    ) -> tuple[SolverResult, float]:
        assert lam is not None
        begun = found._replace(lam=lam, iterations=0)  # those of all parts are added below
        return _best_of_fallbacks(part, solver, begun, natural_residual(part, lam), enough)

    best, natural = _solve_islands(problem, solver, found.lam, accuracy, others)
    return best._replace(iterations=found.iterations + best.iterations), natural


def _solve_islands(
    problem: ContactProblem,
    solver: ContactSolver,
    guess: Array | None,
    accuracy: float,
    answer: _Answer,
    choose: _Choose = by_rule,
) -> tuple[SolverResult, float]:
    """Return the answers of all islands of a problem as one, each as chosen among several."""
    if not problem.rows:
        return SolverResult(np.zeros(0), 0, ()), 0.0
    apart = islands(problem)
    if not apart:
        return choose(problem, *answer(problem, solver, guess, accuracy), accuracy)
    lam, iterations, path, answered = np.empty(problem.rows), 0, dict[str, None](), True
    naturals, several = list[float](), list[Indeterminacy]()
    cost, stopped = 0.0, False
    for island in apart:
        part = island.problem(problem)
        begin = None if guess is None else guess[island.rows]
        found, natural = choose(part, *answer(part, solver, begin, accuracy), accuracy)
        lam[island.rows] = found.lam
        iterations += found.iterations
        path |= dict.fromkeys(found.path)
        answered &= found.answered
        naturals.append(natural)
        several += found.several
        cost, stopped = cost + found.cost, stopped or found.stopped
    found = SolverResult(lam, iterations, tuple(path), answered, tuple(several), cost, stopped)
    return found, max(naturals) if isfinite(sum(naturals)) else nan


def _first_attempt(
    problem: ContactProblem, solver: ContactSolver, guess: Array | None, accuracy: float
) -> tuple[SolverResult, float]:
    """Return a cheap answer that the natural residual accepts, or else the first attempt."""
    if _closes_unmoved(problem, accuracy):
        lam = np.zeros(problem.rows)
        return SolverResult(lam, 0, (), answered=False), natural_residual(problem, lam)
    if guess is None and (quick := solver.at_once(problem)) is not None:
        natural = natural_residual(problem, quick.lam)
        if natural <= accuracy:
            return quick, natural
    found = solver.attempt(problem, guess)
    return found, natural_residual(problem, found.lam)


def _insist(
    problem: ContactProblem, solver: ContactSolver, guess: Array | None, accuracy: float
) -> tuple[SolverResult, float]:
    """Return the first attempt that the natural residual accepts, or the best of all."""
    return _best_of_fallbacks(
        problem, solver, *_first_attempt(problem, solver, guess, accuracy), accuracy
    )


def _best_of_fallbacks(
    problem: ContactProblem,
    solver: ContactSolver,
    best: SolverResult,
    least: float,
    accuracy: float,
) -> tuple[SolverResult, float]:
    """Return the best of a first attempt, with residual `least`, and of the alternatives."""
    found, stopped = best, False
    if least <= accuracy or _closes_unmoved(problem, accuracy):
        return best, least
    for found in solver.alternatives(problem, best):
        error = natural_residual(problem, found.lam)
        if error < least or isnan(least):
            best, least = found, error
        stopped = found.cost >= solver.budget
        if error <= accuracy or stopped:
            break
    # all that was tried had its part, whichever was the best
    return best._replace(iterations=found.iterations, cost=found.cost, stopped=stopped), least


def _closes_unmoved(problem: ContactProblem, accuracy: float) -> bool:
    """True if a contact closes that no impulse can move: its row of G is zero."""
    stiffness = problem.stiffness
    if all(stiffness):
        return False
    slowest, g = -accuracy * problem.scale[1], problem.g.tolist()
    return any(g[n] < slowest and stiffness[n] == 0.0 for n in problem.sets.normals.tolist())


# The verb `solve_contact`, and the judge that every answer goes through.


_DEFAULT: Final = ADMM()


def solve_contact(
    problem: ContactProblem,
    solver: ContactSolver | None = None,
    *,
    guess: ArrayLike | None = None,
    accuracy: float = tolerances.CONTACT_SOLVED,
    throw: bool = True,
) -> ContactSolution:
    """Return impulses that keep bodies apart and obey Coulomb's law, with their residuals.

    K contains lam,  K* contains d,  lam . d = 0,  sigma = G lam + g + R lam

    Parameters
    ----------
    problem : ContactProblem
        The contact problem.
    solver : ContactSolver, optional
        `ADMM()` by default.
    guess : (m,) array_like, optional
        Impulses to begin with [N s].
    accuracy : float
        Natural residual that is good enough: what the status is judged by. A solver that has other
        methods to fall back on goes on until it is met.
    throw : bool
        Raise if the status is not ok. With False the same ContactSolution comes back, whatever its
        status.

    Returns
    -------
    ContactSolution

    Raises
    ------
    InvalidArgument
        If the solver does not know the law of the problem, or an argument is no number.
    UnsupportedBackend
        If `PGS` is asked for dry friction of joints with Pinocchio 3.
    SolveFailed
        If the status is not ok; its `solution` has everything that was computed.

    Notes
    -----
    Independent groups of contacts are solved separately: iterations are counted over all groups,
    and the path names each method once. Cost: that of the solver, and some twenty passes over the
    rows.

    References
    ----------
    Le Lidec, Jallet, Montaut, Laptev, Schmid, Carpentier. Contact models in robotics: a comparative
    analysis. IEEE Transactions on Robotics 40, 2024; each solver names its own.
    """
    if not isinstance(problem, ContactProblem):
        raise InvalidArgument(
            f"problem = {text_of(problem)}: a ContactProblem is needed; contact_problem(scene, q, "
            "v, dt=...) makes that of a step"
        )
    chosen = _DEFAULT if solver is None else solver
    check_type("solver", chosen, ContactSolver, "a contact solver is needed, such as ADMM()")
    if problem.law not in chosen.laws:
        raise InvalidArgument(
            f"{chosen!r} solves {' and '.join(chosen.laws)}, and the problem is a {problem.law}: "
            "take ADMM() or SemismoothNewton()"
        )
    check_accuracy_of_a(accuracy)
    begin = None if guess is None else finite("guess", guess, (problem.rows,))
    start = perf_counter()
    with np.errstate(all="ignore"):  # the status says it
        found, natural = attempt_contact(problem, chosen, begin, accuracy)
        spent = perf_counter() - start
        solution = verified(problem, found, natural, accuracy, spent)
    if throw and not solution.status.ok:
        accuracies = tolerances.ADVISED_ACCURACIES
        enough = next((x for x in accuracies if solution.natural <= x), None)
        more = f"accuracy={enough:g} would pass" if enough else ""
        text = solution.status.text(type(chosen).__name__, more)
        said = "; ".join((text, *solution.notices))
        raise SolveFailed(
            f"{chosen!r} on {problem!r}: {said} (natural residual {solution.natural:.1e})",
            solution,
        )
    return solution


def verified(
    problem: ContactProblem, found: SolverResult, natural: float, accuracy: float, solve_time: float
) -> ContactSolution:
    """Return an attempt with its status, judged by its natural residual."""
    unmet: tuple[str, ...] = ()
    if natural <= accuracy:
        status = ContactStatus.OK
    elif unmet := infeasible_contacts(problem):
        status = ContactStatus.INFEASIBLE
    elif np.isfinite(found.lam).all() and isfinite(natural):
        status = ContactStatus.OUT_OF_BUDGET if found.stopped else ContactStatus.INACCURATE
    else:
        status = ContactStatus.NOT_FINITE
    lam, sigma = read_only((found.lam, problem.velocities(found.lam)))
    return ContactSolution(
        lam=lam, sigma=sigma, natural=natural, status=status, iterations=found.iterations,
        path=found.path, solve_time=solve_time, problem=problem, unmet=unmet,
        several=found.several,
    )  # fmt: skip


# Redundant contacts with prescribed velocities that no rigid body can have.
#
# Where impulses z do nothing, G z = 0, they see nothing either: z . sigma = z . g, whatever lam is.
# A scheme that closes the gaps of two points of one body in the same step makes them approach
# each other by gap^2 / (L dt), which a rigid body does not. They would have to slide by that, under
# inner forces that grow up to friction; no solver finds them where it is 1e-8 of the other
# velocities.


# What is left out of g, relative to |g|, at most: a creep of a micrometre where a metre is moved.
_SMALL: Final = 1e-6

# What is left in, relative to |g|: no residual feels it.
_FELT: Final = 0.01 * tolerances.CONTACT_SOLVED


def drop_inconsistent_rows(problem: ContactProblem, lam: Array) -> ContactProblem | None:
    """Return the problem without the part of g that no motion of what touches has."""
    #     g_A - Z Z^T g_A,    Z an orthonormal basis of G_AA z = 0
    # with A the rows along which nothing moves: the normals of contacts that press at the best
    # impulses lam (m,) that were found, and all of those that stick. None if there is no such part,
    # or it is not small beside g.
    stiff, speed = problem.scale
    sigma, cones = problem.velocities(lam), 3 * len(problem.friction)
    L, S = lam[:cones].reshape(-1, 3), sigma[:cones].reshape(-1, 3)
    presses = L[:, 2] * stiff > np.abs(S[:, 2])
    sticks = presses & (np.hypot(S[:, 0], S[:, 1]) <= _SMALL * speed)
    A = np.flatnonzero(np.column_stack((sticks, sticks, presses)))
    if problem.R is not None or not len(A):
        return None
    values, vectors = np.linalg.eigh(problem.G[np.ix_(A, A)])
    Z = vectors[:, values <= tolerances.CONTACT_RANK * values[-1]]
    out = Z.dot(Z.T.dot(problem.g[A]))
    if not _FELT * speed < np.abs(out).max() <= _SMALL * speed:
        return None
    g = problem.g.copy()
    g[A] -= out
    return problem.replaced(g=g)
