"""ADMM: Pinocchio's alternating directions, and what to try where they fail."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

from condyn_pin._core import _pin_contacts
from condyn_pin._core.arrays import Array
from condyn_pin._core.parameters import Grid, check_accuracy, check_count, check_iterations
from condyn_pin.contact.padded import padded
from condyn_pin.contact.problem import ContactProblem
from condyn_pin.contact.scaling import normalised
from condyn_pin.contact.solvers.base import Attempt, ContactSolver
from condyn_pin.contact.solvers.newton import refine, restarts
from condyn_pin.contact.sticking import sticking

# Newton's steps from an answer that is nearly right, and where nothing is known of it.
_POLISH, _RESCUE = 3, 50

# What Pinocchio is asked for, as a share of the tolerance.
_SHARE = 0.25


@dataclass(frozen=True)
class ADMM(ContactSolver):
    """One linear system where no contact slides, else Pinocchio's ADMM, normalised; then others.

    Parameters
    ----------
    tolerance : float
        What the natural residual is to be [1]. Pinocchio is asked for a quarter: its own measure
        is up to three times smaller.
    max_iterations : int
        Of each run. The answer of a robot on its feet takes 10 to 50.
    anderson : int
        Steps that the acceleration remembers. 4 takes a third of the iterations of 0 on robots; 10
        saves nothing more, and fails more often. Pinocchio 3 has none.
    polish : bool
        End with Newton's method, which takes the residual to 1e-16: for derivatives, where what
        sticks and what slides has to be known. Else it is what is tried first where ADMM fails.

    Notes
    -----
    Cost O(m^3), the factorisation, and O(m^2) an iteration. Without a guess contacts that would
    close are first taken to stick, and the others to open (`condyn_pin.contact.sticking`): most
    steps of a robot on its feet have that answer, to rounding, for a quarter of the time. What is
    tried, and named in the path, where the natural residual is too large: Newton from there; ADMM
    without acceleration; Newton from the other starts of `SemismoothNewton`. Pinocchio 3 has
    neither ccp nor dry friction of joints, and Newton takes the place of ADMM there.

    References
    ----------
    Carpentier, Le Lidec, Montaut. From compliant to rigid contact simulation: a unified and
    efficient approach. RSS, 2024.
    """

    title: ClassVar[str] = "ADMM"
    cost: ClassVar[str] = "O(m^3 + m^2 an iteration)"
    use: ClassVar[str] = "the default: redundant contacts, wide masses; falls back by itself"
    sweeps: ClassVar[tuple[Grid, ...]] = (
        {"tolerance": (1e-4, 1e-6, 1e-8, 1e-10), "anderson": (0, 4, 10)},
        {"polish": (True,)},
    )

    tolerance: float = 1e-8
    max_iterations: int = 1000
    anderson: int = 4
    polish: bool = False

    def __post_init__(self) -> None:
        check_accuracy("tolerance", self.tolerance)
        check_iterations(self.max_iterations)
        check_count("anderson", self.anderson, least=0)

    def at_once(self, problem: ContactProblem) -> Attempt | None:
        """Return the answer if no contact slides."""
        lam = None if self.polish else sticking(problem)
        return None if lam is None else Attempt(lam, 1, ("sticking",))

    def attempt(self, problem: ContactProblem, guess: Array | None = None) -> Attempt:
        """Return what Pinocchio's ADMM answers, polished if that is asked for."""
        if not _taken(problem):
            return refine(problem, guess, _RESCUE)
        found = self._run(problem, guess, self.anderson)
        return refine(problem, found.lam, _POLISH).after(found) if self.polish else found

    def alternatives(self, problem: ContactProblem, found: Attempt) -> Iterator[Attempt]:
        """Yield what Newton and ADMM without acceleration find, and Newton from other starts."""
        if _taken(problem):
            found = refine(problem, found.lam, _RESCUE).after(found)
            yield found
            if self.anderson and _pin_contacts.HAS_ANDERSON:
                again = self._run(problem, None, 0)
                found = again._replace(path=("ADMM without Anderson",)).after(found)
                yield found
        yield from restarts(problem, found, _RESCUE)

    def _run(self, problem: ContactProblem, guess: Array | None, anderson: int) -> Attempt:
        small, unit = normalised(problem)
        rows = padded(small)
        found = _pin_contacts.admm(
            rows.G, rows.g, rows.friction, rows.limits,
            ncp=problem.law == "ncp", tolerance=_SHARE * self.tolerance,
            max_iterations=self.max_iterations, anderson=anderson,
            guess=rows.spread(None if guess is None else guess / unit),
        )  # fmt: skip
        return Attempt(found.lam[rows.kept] * unit, found.iterations, (self.title,))


def _taken(problem: ContactProblem) -> bool:
    """Whether the installed Pinocchio takes the law and the sets of the problem."""
    return _pin_contacts.solves_contacts(problem.law == "ncp", len(problem.limits))
