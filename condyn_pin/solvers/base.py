"""The contract of a solver, and how to write one.

1. Add one file to this folder with one frozen dataclass that inherits from `Solver`. Its fields
   are its knobs, each with a default, a unit, and in the docstring the reason of the default.
2. Set `title` (what tables show), `cost` and `takes_redundant`. The class registers itself under
   its lower-case name in `SOLVERS`; tests, benchmarks and the command line find it there.
3. Write `start(workspace)`. It runs once per workspace, may take hundreds of microseconds, and
   returns a `Method`: three callables closed over what they need.
4. `acceleration(q, v, tau)` is the hot loop. It returns an array that nobody else will write to,
   reads nothing that an earlier call left behind, and does not write to its arguments. It raises
   `Singular` rather than return numbers that mean nothing; NaN may come out, the workspace
   catches it.
5. `lam()` returns an owned array: the forces of the last call, in Pinocchio's LOCAL frame with the
   moving joint first. The workspace turns the sign of rows where the user named the world first.
6. A solver sees rows, not kinds: `workspace.equations` has M, h, J and gamma of whatever the scene
   contains; `workspace.constraint_models` has the same rows as Pinocchio's objects.
7. Sources: cite the paper in the docstring.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from condyn_pin.arrays import Vector

if TYPE_CHECKING:
    from condyn_pin.workspace import Workspace

SOLVERS: dict[str, type[Solver]] = {}


class Singular(ArithmeticError):
    """Raised by a method whose matrix is singular; the workspace turns it into a status."""


@dataclass(frozen=True)
class Method:
    """A solver at work in one workspace."""

    acceleration: Callable[[Vector, Vector, Vector], Vector]
    lam: Callable[[], Vector]
    iterations: Callable[[], int]


class Solver(ABC):
    """A way to solve the two equations; a frozen value."""

    title: ClassVar[str]
    cost: ClassVar[str]
    takes_redundant: ClassVar[bool]  # whether redundant rows are no trouble

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        SOLVERS[cls.__name__.lower()] = cls

    @abstractmethod
    def start(self, workspace: Workspace) -> Method:
        """Return this solver at work in `workspace`."""
