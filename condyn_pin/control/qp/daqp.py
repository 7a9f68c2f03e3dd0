"""DAQP: a dual active-set method, for small dense programs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from condyn_pin._core.arguments import check_accuracy, check_iterations
from condyn_pin.control.qp.qp_solver import (
    BoundQP,
    QPResult,
    QPSolver,
    QuadraticProgram,
    Verdict,
    package,
)

_EQUATION = 5  # what DAQP calls a row that is always active
_NO_BOUND = 1e30
_INFEASIBLE = -1  # among the flags of DAQP


@dataclass(frozen=True)
class DAQP(QPSolver):
    """Dual active-set method with low-rank updates: exact, and used for hierarchies.

    Parameters
    ----------
    tolerance : float
        Absolute, of what rows may be violated by [m/s^2]. Its own default, 1e-6, leaves that much.
    max_iterations : int
        Changes of the active set; about as many as there are active rows are needed.
    budget : int
        What it, and those that are tried where it fails, may take together for a program, in
        ordinary programs of fifty iterations each.

    Raises
    ------
    InvalidArgument
        If the tolerance is negative, or `max_iterations` is not positive.

    References
    ----------
    Arnström, Bemporad, Axehill. A dual active-set solver for embedded quadratic programming using
    recursive LDL^T updates. IEEE Transactions on Automatic Control, 2022.
    """

    title: ClassVar[str] = "DAQP"
    use: ClassVar[str] = "strict hierarchies, and programs that are hard on the others"
    module: ClassVar[str] = "daqp"

    tolerance: float = 1e-9
    max_iterations: int = 1000

    def __post_init__(self) -> None:
        check_accuracy("tolerance", self.tolerance)
        check_iterations(self.max_iterations)

    def _start(self) -> BoundQP:
        """Return the bound solver; it keeps nothing from call to call."""
        daqp = package(self.module)

        def solve(program: QuadraticProgram) -> QPResult:
            p = len(program.b)
            rows = np.concatenate((program.A, program.C))
            lower = np.concatenate((program.b, program.lower))
            upper = np.concatenate((program.b, program.upper))
            np.maximum(lower, -_NO_BOUND, out=lower)
            np.minimum(upper, _NO_BOUND, out=upper)
            sense = np.zeros(len(rows), dtype=np.int32)
            sense[:p] = _EQUATION
            x, _, flag, info = daqp.solve(
                np.array(program.H, order="C"), np.array(program.g), rows, upper, lower, sense,
                primal_tol=self.tolerance, iter_limit=self.max_iterations,
            )  # fmt: skip
            verdict: Verdict = "solved" if flag > 0 else "failed"
            if flag == _INFEASIBLE:
                verdict = "infeasible"
            return QPResult(x, info["lam"][p:], verdict, int(info["iterations"]))

        return solve
