"""The contract of a solver of quadratic programs, and how to write one.

1. Add one file to this folder with one frozen dataclass that inherits from `QPSolver`. Its fields
   are its parameters, each with a default, and in the docstring the reason of the default.
2. Set `title` and `use`. The class registers itself under its lower-case name in `QPS`, and the
   tests find it there.
3. Write `_start()`. It imports the package, with `package` for the error of one that is missing,
   and returns a function of a `QuadraticProgram` that returns a `QPResult`. The function may keep
   memory and a start from one call to the next, where the sizes are the same.
4. It is called by `start()`, which lets through programs whose bounds leave a value to each row.
   Bounds that do not exist are infinite. z has the signs of `QuadraticProgram`. Rows of A are
   independent when a chain asks.
5. Nothing is believed: an answer is polished on its active set and judged by its KKT residual, and
   "infeasible" is asked again elsewhere (`condyn_pin.control.qp.chain`). Rough answers are welcome.
6. A solver that can answer more roughly, where it says "infeasible" by mistake, returns itself with
   another tolerance as its `rougher`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from importlib import import_module
from importlib.util import find_spec
from typing import Any, ClassVar, Final

import numpy as np

from condyn_pin._core.arguments import check_count, enter
from condyn_pin.control.qp.quadratic_program import QPResult, QuadraticProgram, Verdict
from condyn_pin.errors import MissingExtra

QPS: dict[str, type[QPSolver]] = {}

# Iterations that an ordinary program is counted as; a tick of a robot on its feet takes 5 to 40.
ORDINARY: Final = 50

BoundQP = Callable[[QuadraticProgram], QPResult]


@dataclass(frozen=True)
class QPSolver(ABC):
    """A way to solve quadratic programs; a frozen value.

    Parameters
    ----------
    budget : int
        What this solver, and those that are tried where it fails, may take together for a program,
        in ordinary programs: fifty iterations each. Without an answer by then the status of a
        control tick is `out_of_budget`.
    """

    title: ClassVar[str]
    use: ClassVar[str]  # when to take it
    module: ClassVar[str]  # of the package that solves

    budget: int = field(default=100, kw_only=True, repr=False)

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        if getattr(cls._start, "__isabstractmethod__", False):
            return
        enter(QPS, cls.__name__.lower(), cls, f"a QP solver named {cls.__name__}")

    def start(self) -> BoundQP:
        """Return this solver at work, with memory of its own.

        What it returns says "infeasible" of rows whose bounds leave no value, such as a lower one
        above its upper one, and "failed" where numbers of the program or of the answer are NaN or
        infinite: solvers call some of these solved.
        """
        check_count("budget", self.budget)
        work = self._start()

        def solve(program: QuadraticProgram) -> QPResult:
            if not program.has_room:
                verdict: Verdict = "failed" if program.has_nan_bounds else "infeasible"
                n, _, r = program.sizes
                return QPResult(np.zeros(n), np.zeros(r), verdict, 0)
            found = work(program)
            if found.verdict == "solved" and not np.isfinite(found.x).all():
                return found._replace(verdict="failed")
            return found

        return solve

    @abstractmethod
    def _start(self) -> BoundQP:
        """Return the solver at work."""

    @property
    def rougher(self) -> QPSolver | None:
        """The same with a tolerance that finds no false infeasibility; None if it has none."""
        return None

    @property
    def installed(self) -> bool:
        """Whether its package is there."""
        return find_spec(self.module) is not None


def package(name: str) -> Any:
    """Return a package that solves quadratic programs, or raise MissingExtra."""
    try:
        return import_module(name)
    except ImportError as error:
        raise MissingExtra(
            f'{name} is missing: python -m pip install "condyn_pin[control]"'
        ) from error
