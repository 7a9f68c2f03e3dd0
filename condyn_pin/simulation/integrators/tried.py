"""Tried: a step with an answer of its contact solver, and how it comes by one."""

from __future__ import annotations

from math import isfinite
from typing import NamedTuple

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array
from condyn_pin.contact.attempts import attempt_contact, first_attempt, other_attempts
from condyn_pin.contact.consistent import without_contradiction
from condyn_pin.contact.solvers.base import Attempt, ContactSolver
from condyn_pin.simulation.contact_work import ContactWork
from condyn_pin.simulation.integrators.posed import Posed


class Tried(NamedTuple):
    """A step with an answer of its contact solver."""

    posed: Posed
    v: Array  # (nv,), the velocity after it, in the axes of `posed` [m/s, rad/s]
    attempt: Attempt
    natural: float  # residual of the contact problem

    def is_answer_of(self, solver: ContactSolver) -> bool:
        """Whether it is as good as the solver promises."""
        if solver.exact:
            return self.natural <= tolerances.CONTACT_SOLVED
        return self.attempt.answered and isfinite(self.natural)


class Taken(NamedTuple):
    """A step that was taken."""

    posed: Posed
    v: Array
    attempt: Attempt
    natural: float
    work: ContactWork
    tried: tuple[Tried, ...]  # what it came from, in turn, and itself


def answered(posed: Posed, solver: ContactSolver) -> Tried:
    """Return a step with impulses that meet its contact problem, or the best that were found.

    Redundant contacts are checked before the solver tries all else that it has, which may take a
    thousand times as long, and again where that has not helped.
    """
    problem, accuracy = posed.problem, tolerances.CONTACT_SOLVED
    if not solver.exact:
        return _with(posed, *attempt_contact(problem, solver, None, accuracy))
    found, natural = first_attempt(problem, solver, None, accuracy)
    for is_best in (False, True):
        if natural <= accuracy:
            break
        # what is not finite contradicts nothing
        consistent = without_contradiction(problem, found.lam) if isfinite(natural) else None
        if consistent is not None:
            problem, posed = consistent, posed._replace(problem=consistent)
            found, natural = attempt_contact(problem, solver, found.lam, accuracy)
        elif not is_best:
            found, natural = other_attempts(problem, solver, found, accuracy)
    return _with(posed, found, natural)


def _with(posed: Posed, found: Attempt, natural: float) -> Tried:
    return Tried(posed, posed.condensed.velocity(found.lam), found, natural)
