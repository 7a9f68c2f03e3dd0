"""The verb `solve_contact`, and the judge that every answer goes through."""

from __future__ import annotations

from math import isfinite
from time import perf_counter
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core import tolerances
from condyn_pin._core.arguments import check_accuracy_of_a
from condyn_pin._core.arrays import finite, read_only, shown
from condyn_pin.contact.attempts import attempt_contact
from condyn_pin.contact.certificate import unmet_contacts
from condyn_pin.contact.problem import ContactProblem
from condyn_pin.contact.solution import ContactSolution, ContactStatus
from condyn_pin.contact.solvers.admm import ADMM
from condyn_pin.contact.solvers.base import Attempt, ContactSolver
from condyn_pin.errors import InvalidArgument, SolveFailed

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
            f"problem = {shown(problem)}: a ContactProblem is needed; contact_problem(scene, q, v, "
            "dt=...) makes that of a step"
        )
    chosen = _DEFAULT if solver is None else solver
    if not isinstance(chosen, ContactSolver):
        raise InvalidArgument(
            f"solver = {shown(solver)}: a contact solver is needed, such as ADMM()"
        )
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
        solution = judged(problem, found, natural, accuracy, spent)
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


def judged(
    problem: ContactProblem, found: Attempt, natural: float, accuracy: float, solve_time: float
) -> ContactSolution:
    """Return an attempt with its status, judged by its natural residual."""
    unmet: tuple[str, ...] = ()
    if natural <= accuracy:
        status = ContactStatus.OK
    elif unmet := unmet_contacts(problem):
        status = ContactStatus.INFEASIBLE
    elif np.isfinite(found.lam).all() and isfinite(natural):
        status = ContactStatus.OUT_OF_BUDGET if found.stopped else ContactStatus.INACCURATE
    else:
        status = ContactStatus.NOT_FINITE
    lam, sigma = read_only((found.lam, problem.velocities(found.lam)))
    return ContactSolution(
        lam, sigma, natural, status, found.iterations, found.path, solve_time, problem, unmet,
        found.several,
    )  # fmt: skip
