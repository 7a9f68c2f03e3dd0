"""The contract of a contact solver, and how to write one.

1. Add one file to this folder with one frozen dataclass that inherits from `ContactSolver`. Its
   fields are its parameters, each with a default, a unit, and in the docstring its reason.
2. Set `title`, `cost`, `use` (when to take it), and `laws`, those that it solves. The class
   registers itself under its lower-case name in `CONTACT_SOLVERS`.
3. Write `attempt(problem, guess)`. It returns a `SolverResult`: impulses, iterations, and which
   methods had a part. It need not check whether it succeeded: `solve_contact` proves every answer,
   by the same formulas. What cannot be answered is returned as the best that was found. One that
   is not `exact` has `answered`, whether it solved its own problem: residuals cannot tell. NaN may
   come out, and becomes a status.
4. A method that sometimes fails yields from `alternatives` what else is to be tried, in this order.
   The next one is tried while the natural residual is too large and the `budget` lasts: each
   attempt adds its `cost` to that of those before. One that has a guess at most problems for next
   to nothing returns it from `at_once`, which comes first.
5. It is handed any scale: take the problem from `normalised` where tolerances are absolute.
6. It reads nothing that an earlier call left behind: the same problem and guess give the same bits.
7. Sources: cite the paper in the docstring.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from math import inf
from typing import TYPE_CHECKING, ClassVar, Final, NamedTuple

from condyn_pin._core.arguments import Grid, register
from condyn_pin._core.arrays import Array
from condyn_pin.contact.problem import ContactProblem, Law

if TYPE_CHECKING:
    from condyn_pin.contact.indeterminacy import Indeterminacy

CONTACT_SOLVERS: dict[str, type[ContactSolver]] = {}

# Work of an ordinary solve: so many evaluations of the natural map, iterations of first order (with
# 24 rows; fewer rows have cheaper ones), or pivots; and evaluations that a derivative with its
# factorisation is as long as, 4 to 7 with 3 to 24 rows.
EVALUATIONS, FIRST_ORDER, PIVOTS = 70, 500, 30
FACTORISATION: Final = 6

# Ordinary solves that other attempts may cost: a tenth of a second for a robot on its feet. The
# dearest problem with an answer, masses and friction wide apart on eight contacts, takes 125.
BUDGET: Final = 150


class SolverResult(NamedTuple):
    """Impulses of a contact solver, not yet verified.

    Attributes
    ----------
    lam : (m,) array
        Impulses [N s].
    iterations : int
    path : tuple of str
        Titles of the methods that had a part; the one that answered is last.
    answered : bool
        Whether a method that is not `exact` solved the problem that it puts in place of this one.
    several : tuple of Indeterminacy
        Contacts whose velocities Coulomb's law leaves open; no solver fills it in.
    cost : float
        Ordinary solves that it and those before it were as long as [1].
    stopped : bool
        Whether the budget ended the search.
    """

    lam: Array  # (m,) [N s]
    iterations: int
    path: tuple[str, ...]  # titles of the methods that had a part, the one that answered last
    answered: bool = True  # whether a method that is not `exact` solved what it puts in its place
    several: tuple[Indeterminacy, ...] = ()
    cost: float = 0.0  # [ordinary solves]
    stopped: bool = False  # whether the budget ended the search

    def after(self, before: SolverResult) -> SolverResult:
        """Return these impulses, with the iterations, methods and cost of what came `before`."""
        goes_on = before.path[-1:] == self.path[:1]
        path = (*before.path, *(self.path[1:] if goes_on else self.path))
        return self._replace(
            iterations=before.iterations + self.iterations, path=path, cost=before.cost + self.cost
        )


@dataclass(frozen=True)
class ContactSolver(ABC):
    """A way to answer a `ContactProblem`; a frozen value."""

    title: ClassVar[str]  # what tables show
    cost: ClassVar[str]
    use: ClassVar[str]  # when to take it
    laws: ClassVar[tuple[Law, ...]] = ("ncp", "ccp")
    exact: ClassVar[bool] = True  # whether it solves the law itself, and not a polygon of it
    sweeps: ClassVar[tuple[Grid, ...]] = ()  # values of parameters that are worth a look
    # of `alternatives` [ordinary solves]; a field of who has many, and so not annotated here
    budget = inf

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        if ABC not in cls.__bases__:
            name = cls.__name__.lower()
            register(CONTACT_SOLVERS, name, cls, f"a contact solver named {cls.__name__}")

    @abstractmethod
    def attempt(self, problem: ContactProblem, guess: Array | None = None) -> SolverResult:
        """Return impulses (m,) of a `problem`; `guess` is where to begin."""

    def at_once(self, problem: ContactProblem) -> SolverResult | None:
        """Return impulses of a `problem` that cost little and are often right; None without any."""
        return None

    def alternatives(self, problem: ContactProblem, found: SolverResult) -> Iterator[SolverResult]:
        """Yield other attempts at a `problem` than `found`.

        Each counts the iterations and names the methods of those before it.
        """
        yield from ()
