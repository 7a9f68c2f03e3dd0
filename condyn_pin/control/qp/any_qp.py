"""AnyQP: any solver that the package qpsolvers knows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from condyn_pin._core.arguments import check_type
from condyn_pin.control.qp.qp_solver import BoundQP, QPResult, QPSolver, QuadraticProgram, package
from condyn_pin.errors import unknown_name


@dataclass(frozen=True)
class AnyQP(QPSolver):
    """Any solver of the package qpsolvers, by its name there; for comparison.

    Parameters
    ----------
    solver : str
        Such as "clarabel" or "piqp"; its own package has to be there too.
    budget : int
        What it, and those that are tried where it fails, may take together for a program, in
        ordinary programs of fifty iterations each.

    Raises
    ------
    InvalidArgument
        If `solver` is no name.
    """

    title: ClassVar[str] = "qpsolvers"
    use: ClassVar[str] = "to compare solvers"
    module: ClassVar[str] = "qpsolvers"

    solver: str = "daqp"

    def __post_init__(self) -> None:
        check_type("solver", self.solver, str, "the name of a solver is needed")

    def _start(self) -> BoundQP:
        """Return the bound solver; it keeps nothing from call to call."""
        qpsolvers = package(self.module)
        if self.solver not in qpsolvers.available_solvers:
            raise unknown_name("QP solver installed", self.solver, qpsolvers.available_solvers)

        def solve(program: QuadraticProgram) -> QPResult:
            above, below = np.isfinite(program.upper), np.isfinite(program.lower)
            G = np.vstack((program.C[above], -program.C[below]))
            most = np.concatenate((program.upper[above], -program.lower[below]))
            z = np.zeros(len(program.lower))
            problem = qpsolvers.Problem(program.H, program.g, G, most, program.A, program.b)
            found = qpsolvers.solve_problem(problem, solver=self.solver)
            if not found.found or found.z is None:  # they do not say why
                return QPResult(np.zeros(len(program.g)), z, "failed", 0)
            count = int(above.sum())
            z[above] += found.z[:count]
            z[below] -= found.z[count:]
            return QPResult(found.x, z, "solved", 0)

        return solve
