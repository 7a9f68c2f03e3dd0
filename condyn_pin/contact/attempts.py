"""Attempts of contact solvers, and the judge of what each answers.

Attempts at a contact problem: island by island, until a natural residual is accepted.

Where several motions obey Coulomb's law, the answer is that of `indeterminacy`, whatever the solver
found.
"""

from __future__ import annotations

from collections.abc import Callable
from math import isfinite, isnan, nan
from time import perf_counter
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core import tolerances
from condyn_pin._core.arguments import check_accuracy_of_a, check_type
from condyn_pin._core.arrays import Array, finite, read_only, text_of
from condyn_pin._core.blas_threads import one_blas_thread
from condyn_pin.contact.indeterminacy import Indeterminacy, by_rule
from condyn_pin.contact.problem import ContactProblem, islands
from condyn_pin.contact.residuals import infeasible_contacts, natural_residual
from condyn_pin.contact.solution import ContactSolution, ContactStatus
from condyn_pin.contact.solvers.admm import ADMM
from condyn_pin.contact.solvers.contact_solver import ContactSolver, SolverResult
from condyn_pin.errors import InvalidArgument, SolveFailed

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
