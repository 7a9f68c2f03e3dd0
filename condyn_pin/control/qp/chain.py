"""The chain: a quadratic program is answered, or it is proved that nothing answers it.

1. The active set of the last program, polished: from one control tick to the next it is the same.
2. The solver, then the same rougher, then others that are there; each answer is polished.
3. The elastic program, which says whether rows contradict each other, and which.

The first two end where they have taken the `budget` of the solver, and the last one has what is
left of it.

An answer counts if its KKT residual does, whatever the solver said of it: "infeasible" is what
ProxQP also says of programs that have an answer. One whose active set has not settled counts only
if no other is found.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array, ignore_float_errors
from condyn_pin.control.qp.qp_solver import (
    ORDINARY,
    BoundQP,
    Elastic,
    PolishedAnswer,
    QPResult,
    QPSolver,
    QuadraticProgram,
    Saddle,
    elastic,
    polish,
    start_from_active_set,
)
from condyn_pin.control.qp.solvers import DAQP, ProxQP, Quadprog

# Violations of rows below this are rounding [m/s^2]. What counts is tolerances.KKT.
_AIM = 1e-12

# Changes of the active set that the last one is worth; more cost as much as the solver.
_FROM_LAST = 2
_FROM_SOLVER = 10
_FROM_ELASTIC = 50


@dataclass(frozen=True, eq=False)
class ChainAnswer:
    """Answer of a program, or the least relaxation of its rows."""

    answer: PolishedAnswer | None  # the best that was found, if any
    elastic: Elastic | None  # what rows have to give, where nothing answers the program
    path: tuple[str, ...]  # the solvers that were tried, in order
    iterations: int  # of the solvers
    stopped: bool = False  # whether the budget ended the search

    @property
    def solved(self) -> bool:
        """True if its optimality holds."""
        return self.answer is not None and self.answer.residual <= tolerances.KKT


class SolverLadder:
    """The solvers of one program that changes from call to call, and its last active set."""

    def __init__(self, qp: QPSolver) -> None:
        self._solver, self._most = qp, ORDINARY * qp.budget
        self._bound: dict[QPSolver, BoundQP] = {qp: qp.start()}  # a missing package is said now
        self._last: PolishedAnswer | None = None
        self._saddle = Saddle()
        self._quietly = ignore_float_errors(
            self._solve
        )  # numbers of no answer may overflow; residuals say it

    def solve(
        self, program: QuadraticProgram, costs: Callable[[], tuple[Array, Array]]
    ) -> ChainAnswer:
        """Return the answer of a program, or the least relaxation of its rows."""
        return self._quietly(program, costs)

    def _solve(
        self, program: QuadraticProgram, costs: Callable[[], tuple[Array, Array]]
    ) -> ChainAnswer:
        path: list[str] = []
        iterations, best = 0, None
        for name, steps, found in self._answers(program):
            path.append(name)
            iterations += steps
            if found and (best is None or found.residual < best.residual):
                best = found
            if found and found.settled and found.residual <= tolerances.KKT:
                return self._counts(found, path, iterations)
            if iterations >= self._most:
                break
        if best and best.residual <= tolerances.KKT:
            return self._counts(best, path, iterations)
        self._last = None
        if iterations >= self._most:
            return ChainAnswer(best, None, tuple(path), iterations, stopped=True)
        path.append("elastic program")
        return self._contradiction(program, costs, best, path, iterations)

    def _counts(self, found: PolishedAnswer, path: list[str], iterations: int) -> ChainAnswer:
        """Return the answer that was found, and keep its active set for the next program."""
        self._last = found
        return ChainAnswer(found, None, tuple(path), iterations)

    def _answers(
        self, program: QuadraticProgram
    ) -> Iterator[tuple[str, int, PolishedAnswer | None]]:
        """Yield the solver, its iterations, and the polished answer of each attempt."""
        if not len(program.g):
            nothing = start_from_active_set(program, np.zeros(0), np.zeros(len(program.lower)))
            residual = program.kkt_residual(nothing.x, nothing.y, nothing.z)
            yield "no unknowns", 0, nothing._replace(residual=residual)
            return
        last = self._last
        if last and (len(last.x), len(last.z)) == (len(program.g), len(program.lower)):
            # equations that depend on each other are no trouble to the polish
            begin = start_from_active_set(program, last.x, last.z, last)
            yield "last active set", 0, polish(program, begin, _AIM, _FROM_LAST, self._saddle)
        asked = _independent(_with_equations(program))
        if asked is None or not program.has_room:
            return
        for qp in self._solvers():
            result = self._ask(qp, asked)
            found = None
            if np.isfinite(result.x).all() and np.isfinite(result.z).all():
                z = np.zeros(len(program.lower))
                z[~program.pinned] = result.z
                begin = start_from_active_set(program, result.x, z)
                found = polish(program, begin, _AIM, _FROM_SOLVER, self._saddle)
            yield repr(qp), result.iterations, found

    def _solvers(self) -> Iterator[QPSolver]:
        yield self._solver
        if self._solver.rougher:
            yield self._solver.rougher
        for other in (DAQP(), ProxQP(), Quadprog()):
            if type(other) is not type(self._solver) and other.installed:
                yield other

    def _ask(self, qp: QPSolver, program: QuadraticProgram) -> QPResult:
        if qp not in self._bound:
            self._bound[qp] = qp.start()
        return self._bound[qp](program)

    def _contradiction(
        self,
        program: QuadraticProgram,
        costs: Callable[[], tuple[Array, Array]],
        best: PolishedAnswer | None,
        path: list[str],
        iterations: int,
    ) -> ChainAnswer:
        """Return the least relaxation of the rows; if none is needed, a feasible point's answer."""
        found = elastic(program, *costs(), most=self._most - iterations)
        if found is None:
            return ChainAnswer(best, None, tuple(path), iterations)
        given = max(found.of_equations.max(initial=0.0), found.of_inequalities.max(initial=0.0))
        if given > tolerances.GIVES:
            return ChainAnswer(None, found, tuple(path), iterations)
        begin = start_from_active_set(program, found.x, np.zeros(len(program.lower)))
        last = polish(program, begin, _AIM, _FROM_ELASTIC, self._saddle)
        if best is None or last.residual < best.residual:
            best = last
        return ChainAnswer(best, None, tuple(path), iterations)


def _with_equations(program: QuadraticProgram) -> QuadraticProgram:
    """Return the program with inequalities that are equations among the equations."""
    pinned = program.pinned
    if not pinned.any():
        return program
    A, b = np.vstack((program.A, program.C[pinned])), np.append(program.b, program.lower[pinned])
    C, lower, upper = (rows[~pinned] for rows in (program.C, program.lower, program.upper))
    return QuadraticProgram(program.H, program.g, A, b, C, lower, upper)


def _independent(program: QuadraticProgram) -> QuadraticProgram | None:
    """Return the program with independent equations; None if they contradict each other."""
    # Each equation is divided by its size: that of a rod that spins is 1e-6 of that of a force, and
    # as independent of the others.
    from scipy.linalg import lstsq, qr
    from scipy.linalg.lapack import dpotrf

    if not len(program.b):
        return program
    sizes = np.linalg.norm(program.A, axis=1)
    sizes[sizes == 0.0] = 1.0
    A, b = program.A / sizes[:, None], program.b / sizes
    shares = sizes / sizes.max()
    factor, info = dpotrf(A @ A.T, lower=1)
    left = np.diagonal(factor)
    independent = (left > tolerances.INDEPENDENT) & (left * shares > tolerances.REFERENCE_RANK)
    if not info and independent.all():
        return replace(program, A=A, b=b)
    R, pivots = qr(A.T, mode="r", pivoting=True)
    pivot_sizes = np.abs(np.diagonal(R))
    counts = pivot_sizes > tolerances.RANK * pivot_sizes[0]
    # of a small row what rounding of larger ones leaves may look independent
    counts &= pivot_sizes * shares[pivots[: len(counts)]] > tolerances.REFERENCE_RANK
    rank = len(counts) if counts.all() else int(np.argmin(counts))
    x = lstsq(A[pivots[:rank]], b[pivots[:rank]])[0] if rank else np.zeros(A.shape[1])
    off = np.abs(program.A @ x - program.b).max()
    if off > tolerances.GIVES * (1.0 + np.abs(program.b).max()):
        return None
    kept = np.sort(pivots[:rank])
    return replace(program, A=A[kept], b=b[kept])
