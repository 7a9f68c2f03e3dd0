"""Tried: a step with an answer of its contact solver, and how it comes by one."""

from __future__ import annotations

from math import isfinite
from typing import Final, NamedTuple

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array
from condyn_pin.contact.attempts import attempt_contact, first_attempt, other_attempts
from condyn_pin.contact.solution import without_contradiction
from condyn_pin.contact.solvers.base import Attempt, ContactSolver
from condyn_pin.simulation.contact_work import ContactWork
from condyn_pin.simulation.integrators.posed import Posed
from condyn_pin.simulation.remarks import Note

# How deep a penetration is that is spoken of [m, rad].
_SEEN: Final = 1e-6

# Share of a push below which a penetration counts as not pushed out [1].
_HALF: Final = 0.5


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
    missed: tuple[str, float] | None = None  # a contact, and how far off it ends [m, rad]
    through: tuple[str, ...] = ()  # contacts that it has gone past, from one side to the other

    @property
    def notes(self) -> list[Note]:
        """What the step has to say, beside its contact problem."""
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
    if posed.strike is not None and not posed.strike.natural <= natural:
        natural = posed.strike.natural
    return Tried(posed, posed.velocity(found.lam), found, natural)
