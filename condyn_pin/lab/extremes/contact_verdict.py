"""Verdicts on contact solvers: whether what is said to be ok is, in extended precision.

With S = mean diag G and s = |g|_inf, an answer is right if

    |lam - P_K(lam - d / S)|_inf S / s <= 1e-8,    d = sigma + (0, 0, mu |sigma_t|)

where sigma = G lam + g (+ R lam) and P_K are formed anew, contact by contact, in `longdouble`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array
from condyn_pin.contact.judge import solve_contact
from condyn_pin.contact.problem import ContactProblem
from condyn_pin.contact.solution import ContactStatus
from condyn_pin.contact.solvers.base import ContactSolver
from condyn_pin.lab.extremes.verdict import Verdict


def judge_contact(problem: ContactProblem, solver: ContactSolver) -> tuple[Verdict, float, str]:
    """Return the verdict on a solver, the natural residual of its answer, and its status.

    Raises
    ------
    CondynError
        If the solver refuses the problem.
    """
    solution = solve_contact(problem, solver, throw=False)
    status, error = solution.status.name.lower(), long_residual(problem, solution.lam)
    if solution.status is not ContactStatus.OK:
        return Verdict.SAID_SO, error, status
    if not error <= tolerances.CONTACT_SOLVED * (1 + 1e-3):  # what rounding decides
        return Verdict.WRONG, error, status
    again = solve_contact(problem, solver, throw=False)
    if not np.array_equal(again.lam, solution.lam):
        return Verdict.WRONG, error, "another lam on the second call"
    return Verdict.OK, error, status


def long_residual(problem: ContactProblem, lam: Array) -> float:
    """Return the natural residual of impulses (m,) in extended precision; NaN if there is one."""
    if not len(lam):
        return 0.0
    G, g, x = (np.asarray(each, dtype=np.longdouble) for each in (problem.G, problem.g, lam))
    with np.errstate(all="ignore"):
        sigma = G @ x + g + (0 if problem.R is None else problem.R * x)
        stiff, speed = (np.longdouble(size) for size in problem.scale)
        missed = [abs(each) for each in _missed(problem, x, sigma, stiff)]
        return float(np.max(missed) * stiff / speed)


def _missed(problem: ContactProblem, lam: Any, sigma: Any, stiff: Any) -> list[Any]:
    """Return lam - P_K(lam - d / S), entry by entry."""
    missed: list[Any] = []
    for i, mu in enumerate(np.asarray(problem.friction, dtype=np.longdouble)):
        own = slice(3 * i, 3 * i + 3)
        d = sigma[own].copy()
        if problem.law == "ncp":
            d[2] += mu * np.hypot(d[0], d[1])
        missed += list(lam[own] - _on_cone(lam[own] - d / stiff, mu))
    row = 3 * len(problem.friction)
    for _ in range(problem.half_lines):
        missed.append(lam[row] - max(lam[row] - sigma[row] / stiff, np.longdouble(0)))
        row += 1
    for limit in problem.limits:
        moved = lam[row] - sigma[row] / stiff
        missed.append(lam[row] - min(max(moved, -limit), limit))
        row += 1
    return missed


def _on_cone(x: Any, mu: Any) -> Any:
    """Return the point of |x_t| <= mu x_n that is nearest to x (3,)."""
    slip, n = np.hypot(x[0], x[1]), x[2]
    if mu * slip <= -n:
        return np.zeros(3, dtype=np.longdouble)
    if slip <= mu * n:
        return x
    height = (n + mu * slip) / (1 + mu * mu)
    scale = mu * height / slip
    return np.array([scale * x[0], scale * x[1], height])
