"""Solvers of quadratic programs: ProxQP, DAQP, Quadprog, and any that qpsolvers knows."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from condyn_pin._core.arguments import check_accuracy, check_iterations, check_type
from condyn_pin.control.qp.qp_solver import (
    BoundQP,
    QPResult,
    QPSolver,
    QuadraticProgram,
    Verdict,
    package,
)
from condyn_pin.errors import unknown_name

_PROXQP_INFINITY = 1e20  # what ProxSuite takes for infinite
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
            lower = np.maximum(program.lower, -_PROXQP_INFINITY)
            upper = np.minimum(program.upper, _PROXQP_INFINITY)
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


_EQUATION = 5  # what DAQP calls a row that is always active
_DAQP_INFINITY = 1e30
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
            np.maximum(lower, -_DAQP_INFINITY, out=lower)
            np.minimum(upper, _DAQP_INFINITY, out=upper)
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
