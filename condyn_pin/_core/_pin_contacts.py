"""Contact solvers of Pinocchio: with `_pin`, the only place that knows which one is installed.

| what                 | 3.9                               | 4.x                                   |
|----------------------|-----------------------------------|---------------------------------------|
| solvers              | `ADMMContactSolver`, ...          | `ADMMConstraintSolver`, ...           |
| sets                 | round cones, as a list            | of constraint models, intervals too   |
| laws of ADMM         | ncp                               | ncp and ccp                           |
| Anderson             | missing                           | `anderson_capacity`                   |
| what a solver keeps  | the last answer, and begins there | nothing; ADMM damps the operator      |
| no friction anywhere | PGS stops after one round         | as it should                          |
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import lru_cache
from typing import Any, Final, NamedTuple

import numpy as np

from condyn_pin._core._pin import VERSION, pin
from condyn_pin._core.arrays import Array

_IS_4: Final = VERSION >= (4, 0)
HAS_ANDERSON: Final = _IS_4
_NO_RELATIVE: Final = 1e-14  # tolerance, which solvers add to the absolute one


class Conic(NamedTuple):
    """What Pinocchio answers to a contact problem, whether it believes it or not."""

    lam: Array  # (m,)
    iterations: int


def solves_contacts(ncp: bool, intervals: int) -> bool:
    """Return whether `admm` and `pgs` take the law, and rows with dry friction."""
    return _IS_4 or (ncp and not intervals)


def admm(
    G: Array,
    g: Array,
    friction: Array,
    limits: Array,
    *,
    ncp: bool,
    tolerance: float,
    max_iterations: int,
    anderson: int,
    guess: Array | None,
) -> Conic:
    """Return what Pinocchio's ADMM answers: rows of cones (t1, t2, n), then of intervals.

    Pinocchio 3 has no Anderson acceleration.
    """
    if not _IS_4:
        solver = pin.ADMMContactSolver(len(g))
        _set_precision(solver, tolerance, max_iterations)
        start = () if guess is None else (guess,)
        operator = pin.DelassusOperatorDense(G)
        solver.solve(operator, g, _cones(friction), np.zeros(len(g)), *start)
        return Conic(np.ravel(solver.getPrimalSolution()), solver.getIterationCount())
    settings = _admm_settings(ncp, tolerance, max_iterations, anderson)
    result = pin.ADMMSolverResult()
    return _conic(pin.ADMMConstraintSolver, result, settings, G, g, friction, limits, guess)


def pgs(
    G: Array,
    g: Array,
    friction: Array,
    limits: Array,
    *,
    tolerance: float,
    max_iterations: int,
    over_relaxation: float,
    guess: Array | None,
) -> Conic:
    """Return what Pinocchio's projected Gauss-Seidel answers, rows as in `admm`; always an ncp."""
    if not _IS_4:
        solver = pin.PGSContactSolver(len(g))
        _set_precision(solver, tolerance, max_iterations)
        lam = np.zeros(len(g)) if guess is None else guess.copy()
        solver.solve(G, g, _cones(friction), lam, over_relaxation)
        return Conic(lam, solver.getIterationCount())
    settings = _conic_settings(pin.PGSSolverSettings(), tolerance, max_iterations)
    settings.over_relaxation = over_relaxation
    return _conic(
        pin.PGSConstraintSolver, pin.PGSSolverResult(), settings, G, g, friction, limits, guess
    )


def _set_precision(solver: Any, tolerance: float, max_iterations: int) -> None:
    solver.setAbsolutePrecision(tolerance)
    solver.setRelativePrecision(_NO_RELATIVE)
    solver.setMaxIterations(max_iterations)


def _cones(friction: Array) -> Any:
    cones = pin.StdVec_CoulombFrictionCone()
    for mu in friction.tolist():
        cones.append(pin.CoulombFrictionCone(mu))
    return cones


@lru_cache(maxsize=64)  # to fill one takes as long as three iterations; solvers only read it
def _admm_settings(ncp: bool, tolerance: float, max_iterations: int, anderson: int) -> Any:
    settings = _conic_settings(pin.ADMMSolverSettings(), tolerance, max_iterations)
    settings.solve_ncp, settings.anderson_capacity = ncp, anderson
    return settings


def _conic_settings(settings: Any, tolerance: float, max_iterations: int) -> Any:
    settings.absolute_feasibility_tol = settings.absolute_complementarity_tol = tolerance
    settings.relative_feasibility_tol = settings.relative_complementarity_tol = _NO_RELATIVE
    settings.max_iterations = max_iterations
    return settings


def _conic(
    kind: Any, result: Any, settings: Any,
    G: Array, g: Array,
    friction: Array, limits: Array,
    guess: Array | None,
) -> Conic:  # fmt: skip
    """Return what a solver of Pinocchio 4 answers; memory and sets are kept, nothing else."""
    models, datas = _sets(friction, limits)
    if guess is not None:
        result.setConstraintImpulseGuess(guess)
    # a new operator: ADMM leaves its damping in it, which PGS takes for a part of G
    operator = pin.DelassusOperatorDense(G)
    _solver(kind, len(g)).solve(operator, g, models, datas, settings, result)
    return Conic(result.retrieveConstraintImpulses(), result.iterations)


class _Memory(threading.local):
    """What a thread keeps for its next problems, by what it is for."""

    def __init__(self) -> None:
        self._kept: dict[Any, Any] = {}

    def of(self, key: Any, make: Callable[[], Any]) -> Any:
        """Return what was made for a key, or make it."""
        made = self._kept.get(key)
        if made is None:
            if len(self._kept) >= _MOST_KEPT:
                self._kept.clear()
            made = self._kept[key] = make()
        return made


_MOST_KEPT: Final = 64
_memory = _Memory()


def _solver(kind: Any, size: int) -> Any:
    """Return a solver of Pinocchio 4: memory for problems of a size, and nothing of their answers.

    To make one takes as long as three iterations.
    """
    return _memory.of((kind, size), lambda: kind(size))


def _sets(friction: Array, limits: Array) -> tuple[Any, Any]:
    """Return models and datas of a mechanism that does not matter, for the sizes and sets in them.

    Solvers read nothing else of them, and write nothing: the next problem often has the same sets.
    """
    key = friction.tobytes(), limits.tobytes()
    return _memory.of(key, lambda: _new_sets(friction, limits))  # type: ignore[no-any-return]


def _new_sets(friction: Array, limits: Array) -> tuple[Any, Any]:
    model, here = pin.Model(), pin.SE3.Identity()
    for i in range(max(len(limits), 1)):
        model.addJoint(i, pin.JointModelRZ(), here, f"joint {i}")
    models, datas = pin.StdVec_ConstraintModel(), pin.StdVec_ConstraintData()
    for mu in friction.tolist():
        point = pin.PointContactConstraintModel(model, 0, here, 1, here)
        point.setFriction(mu)
        models.append(pin.ConstraintModel(point))
    if len(limits):
        dry = pin.JointFrictionConstraintModel(model)
        dry.setFrictionLowerLimit(-limits)
        dry.setFrictionUpperLimit(limits)
        dry.setTimeStep(1.0)  # limits are impulses already
        models.append(pin.ConstraintModel(dry))
    for each in models:
        datas.append(each.createData())
    return models, datas
