"""ADMM: Pinocchio's alternating directions, and what to try where they fail."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import ClassVar

from condyn_pin._core.arguments import Grid, check_accuracy, check_count, check_iterations
from condyn_pin._core.arrays import Array
from condyn_pin.contact.problem import ContactProblem
from condyn_pin.contact.solvers.contact_solver import BUDGET, ContactSolver, SolverResult
from condyn_pin.contact.solvers.newton import fewer, of_first_order, refine, restarts, sticking
from condyn_pin.contact.solvers.pgs import accelerated, directions

# Newton's steps from an answer that is nearly right, and where nothing is known of it.
POLISH, RESCUE = 3, 50

# Iterations of the second run, in those of the first.
_LONGER = 4


@dataclass(frozen=True)
class ADMM(ContactSolver):
    """Pinocchio's ADMM, normalised; one linear system if no contact slides; fallbacks if it fails.

    Parameters
    ----------
    tolerance : float
        The natural residual to reach [1]. Pinocchio is asked for a quarter: its own measure
        is up to three times smaller.
    max_iterations : int
        Of each run. The answer of a robot on its feet takes 10 to 50.
    anderson : int
        Memory of Anderson's acceleration, in steps. 4 takes a third of the iterations of 0 on
        robots; 10 saves nothing more, and fails more often: Pinocchio 4.1 counts steps back modulo
        2^64, which finds the right ones in its memory only if this is a power of two. Pinocchio 3
        has none.
    polish : bool
        End with Newton's method, which takes the residual to 1e-16: for derivatives, where what
        sticks and what slides has to be known. Without it, Newton's method is the first fallback
        where ADMM fails.
    budget : int
        What fallbacks may cost together, in ordinary solves: 70 evaluations of the natural map, of
        which a derivative with its factorisation counts as six, or 500 iterations of first order,
        each. Without an answer by then the status is `out_of_budget`.

    Raises
    ------
    InvalidArgument
        If the tolerance is negative, `max_iterations` or `budget` is not positive, or `anderson` is
        no count.

    Notes
    -----
    Cost O(m^3), the factorisation, and O(m^2) an iteration; where contacts are many and bodies few,
    O(m r) with r the rank of G, by a method of ours (`condyn_pin.contact.solvers.pgs`). Without a
    guess contacts that would close are first taken to stick, and the others to open
    (`condyn_pin.contact.solvers.newton`): most steps of a robot on its feet have that answer, to
    rounding, for a quarter of the time. If the natural residual is too large, these are tried, and
    named in the path: a subset of the contacts, if few bodies have many; Newton from there; ADMM
    without acceleration, or for longer; Newton from the other starts of `SemismoothNewton`. On
    Pinocchio 3, whose ADMM has neither ccp nor dry friction of joints, Newton takes its place.

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
    budget: int = BUDGET

    def __post_init__(self) -> None:
        check_accuracy("tolerance", self.tolerance)
        check_iterations(self.max_iterations)
        check_count("anderson", self.anderson, least=0)
        check_count("budget", self.budget)

    def at_once(self, problem: ContactProblem) -> SolverResult | None:
        """Return the answer if no contact slides."""
        lam = None if self.polish else sticking(problem)
        return None if lam is None else SolverResult(lam, 1, ("sticking",))

    def attempt(self, problem: ContactProblem, guess: Array | None = None) -> SolverResult:
        """Return the impulses of alternating directions, polished by Newton if `polish` is set."""
        found = self._run(problem, guess, self.anderson)
        if found is None:
            return refine(problem, guess, RESCUE)
        return refine(problem, found.lam, POLISH).after(found) if self.polish else found

    def alternatives(self, problem: ContactProblem, found: SolverResult) -> Iterator[SolverResult]:
        """Ends of Newton, of another run of ADMM, and of Newton from other starts."""
        if self.title in found.path:
            lam = found.lam
            for found in fewer(problem, found, RESCUE, self.budget):  # noqa: B020
                yield found
            found = refine(problem, lam, RESCUE).after(found)
            yield found
            again = self._again(problem, lam)
            if again is not None:
                found = again.after(found)
                yield found
        yield from restarts(problem, found, RESCUE, self.budget)

    def _again(self, problem: ContactProblem, lam: Array) -> SolverResult | None:
        """Return a run without acceleration, or where there was none a longer one from lam."""
        if not accelerated(problem):
            longer = replace(self, max_iterations=_LONGER * self.max_iterations)
            return longer._run(problem, lam, 0)
        again = self._run(problem, None, 0) if self.anderson else None
        return again and again._replace(path=("ADMM without Anderson",))

    def _run(
        self, problem: ContactProblem, guess: Array | None, anderson: int
    ) -> SolverResult | None:
        found = directions(
            problem, guess,
            tolerance=self.tolerance, max_iterations=self.max_iterations, anderson=anderson,
        )  # fmt: skip
        return None if found is None else of_first_order(*found, self.title)
