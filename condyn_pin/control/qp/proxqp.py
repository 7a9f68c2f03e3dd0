"""ProxQP: the proximal augmented Lagrangian of ProxSuite, on dense matrices."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar

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

_NO_BOUND = 1e20  # what ProxSuite takes for infinite
_ROUGHER = 100.0


@dataclass(frozen=True)
class ProxQP(QPSolver):
    """Proximal augmented Lagrangian with a warm start; it copes with dependent rows.

    Parameters
    ----------
    tolerance : float
        Absolute, of equations, inequalities and gradient [m/s^2]. 1e-6 finds the active set, and
        the polish the digits; at 1e-9 programs of Cassie that have an answer are called infeasible.
    max_iterations, max_inner : int
        Outer and inner iterations. With ProxSuite's own limits a single program ran for 100 s.
    budget : int
        What it, and those that are tried where it fails, may take together for a program, in
        ordinary programs of fifty iterations each.

    Raises
    ------
    InvalidArgument
        If the tolerance is negative, or a limit is not positive.

    Notes
    -----
    A call starts from the multipliers of the last call, but with the initial penalty: with the
    penalty of the last call ProxSuite reports feasible programs as infeasible.

    References
    ----------
    Bambade, El-Kazdadi, Taylor, Carpentier. PROX-QP: yet another quadratic programming solver for
    robotics and beyond. RSS 2022.
    """

    title: ClassVar[str] = "ProxQP, dense"
    use: ClassVar[str] = "weighted tasks: the default"
    module: ClassVar[str] = "proxsuite"

    tolerance: float = 1e-6
    max_iterations: int = 200
    max_inner: int = 100

    def __post_init__(self) -> None:
        check_accuracy("tolerance", self.tolerance)
        check_iterations(self.max_iterations)
        check_iterations(self.max_inner)

    @property
    def rougher(self) -> ProxQP:
        """The solver with a tolerance a hundred times as large."""
        # to 15 digits: the product is 9.999999999999999e-05, and shown in every path
        return replace(self, tolerance=float(f"{_ROUGHER * self.tolerance:.15g}"))

    def _start(self) -> BoundQP:
        """Return the bound solver: one object of ProxSuite for each size of program."""
        proxqp = package(self.module).proxqp
        made: dict[tuple[int, int, int], Any] = {}

        def solve(program: QuadraticProgram) -> QPResult:
            size = program.sizes
            lower = np.maximum(program.lower, -_NO_BOUND)
            upper = np.minimum(program.upper, _NO_BOUND)
            data = (program.H, program.g, program.A, program.b, program.C, lower, upper)
            if size in made:
                qp = made[size]
                qp.update(*data, update_preconditioner=False)
            else:
                qp = made[size] = self._make(proxqp, size)
                qp.init(*data)
            qp.solve()
            found = qp.results
            if found.info.status == proxqp.PROXQP_SOLVED:
                verdict: Verdict = "solved"
            else:
                infeasible = found.info.status == proxqp.PROXQP_PRIMAL_INFEASIBLE
                verdict = "infeasible" if infeasible else "failed"
                del made[size]  # its penalties are not to be started from
            return QPResult(np.array(found.x), np.array(found.z), verdict, int(found.info.iter))

        return solve

    def _make(self, proxqp: Any, size: tuple[int, int, int]) -> Any:
        """Return a new object of ProxSuite."""
        qp = proxqp.dense.QP(*size)
        qp.settings.eps_abs, qp.settings.eps_rel = self.tolerance, 0.0
        qp.settings.max_iter, qp.settings.max_iter_in = self.max_iterations, self.max_inner
        qp.settings.initial_guess = proxqp.InitialGuess.COLD_START_WITH_PREVIOUS_RESULT
        return qp
