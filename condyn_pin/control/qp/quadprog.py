"""Quadprog: the dual active-set method of Goldfarb and Idnani."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from condyn_pin.control.qp.qp_solver import BoundQP, QPResult, QPSolver, QuadraticProgram, package


@dataclass(frozen=True)
class Quadprog(QPSolver):
    """The dual active-set method of Goldfarb and Idnani.

    Parameters
    ----------
    budget : int
        What it, and those that are tried where it fails, may take together for a program, in
        ordinary programs of fifty iterations each.

    References
    ----------
    Goldfarb, Idnani. A numerically stable dual method for solving strictly convex quadratic
    programs. Mathematical Programming, 1983.
    """

    title: ClassVar[str] = "quadprog"
    use: ClassVar[str] = "where DAQP is not there"
    module: ClassVar[str] = "quadprog"

    def _start(self) -> BoundQP:
        """Return the bound solver; it keeps nothing from call to call."""
        solve_qp = package(self.module).solve_qp

        def solve(program: QuadraticProgram) -> QPResult:
            p, z = len(program.b), np.zeros(len(program.lower))
            above, below = np.isfinite(program.upper), np.isfinite(program.lower)
            rows = np.vstack((program.A, -program.C[above], program.C[below]))
            least = np.concatenate((program.b, -program.upper[above], program.lower[below]))
            if not len(rows):  # which quadprog does not take
                x = np.asarray(np.linalg.solve(program.H, -program.g), dtype=float)
                return QPResult(x, z, "solved", 0)
            try:
                x, _, _, iterations, multipliers, _ = solve_qp(
                    np.array(program.H), -program.g, np.ascontiguousarray(rows.T), least, p
                )
            except ValueError as error:
                inconsistent = "inconsistent" in str(error)
                return QPResult(
                    np.zeros(len(program.g)), z, "infeasible" if inconsistent else "failed", 0
                )
            last = p + int(above.sum())
            z[above] += multipliers[p:last]
            z[below] -= multipliers[last:]
            return QPResult(x, z, "solved", int(iterations[0]))

        return solve
