"""Verdicts on contact solvers: whether what is said to be ok is, in 50 digits.

With S = mean diag G and s = |g|_inf, an answer is right if

    |lam - P_K(lam - d / S)|_inf S / s <= 1e-8,    d = sigma + (0, 0, mu |sigma_t|)

or, of a contact that sticks, |sigma|_inf / s <= 1e-8: where K contains its lam, this is asked in
the place of the other if K contains lam - d / S as well, and else is enough. In both of them
sigma = G lam + g (+ R lam) and P_K are formed anew, contact by contact, in decimal numbers.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from decimal import Decimal, localcontext
from math import nan

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array
from condyn_pin.contact.attempts import solve_contact
from condyn_pin.contact.problem import ContactProblem
from condyn_pin.contact.solution import ContactStatus
from condyn_pin.contact.solvers.base import ContactSolver
from condyn_pin.lab.extremes.verdict import Verdict

_DIGITS = 50
_ZERO = Decimal(0)

# What rounding decides: the judge of the library has doubles.
_EDGE = 1 + 1e-3


def judge_contact(problem: ContactProblem, solver: ContactSolver) -> tuple[Verdict, float, str]:
    """Return the verdict on a contact solver.

    Parameters
    ----------
    problem : ContactProblem
        The contact problem.
    solver : ContactSolver

    Returns
    -------
    verdict : Verdict
    error : float
        The natural residual of its answer, in 50 digits [1].
    status : str

    Raises
    ------
    CondynError
        If the solver refuses the problem.
    """
    solution = solve_contact(problem, solver, throw=False)
    status, error = solution.status.name.lower(), long_residual(problem, solution.lam)
    if solution.status is not ContactStatus.OK:
        return Verdict.SAID_SO, error, status
    if not error <= _EDGE * tolerances.CONTACT_SOLVED:
        return Verdict.WRONG, error, status
    again = solve_contact(problem, solver, throw=False)
    if not np.array_equal(again.lam, solution.lam):
        return Verdict.WRONG, error, "another lam on the second call"
    return Verdict.OK, error, status


def long_residual(problem: ContactProblem, lam: Array) -> float:
    """Return the natural residual of impulses (m,) in 50 digits; NaN if one is no number."""
    if not np.isfinite(lam).all():
        return nan
    with localcontext() as context:
        context.prec = _DIGITS
        stiff, speed = map(Decimal, problem.scale)
        x = [Decimal(each) for each in lam.tolist()]
        sigma = list(_velocities(problem, x))
        missed = (abs(each) for each in _missed(problem, x, sigma, stiff))
        return float(max(missed, default=_ZERO) * stiff / speed)


def _velocities(problem: ContactProblem, lam: Sequence[Decimal]) -> Iterator[Decimal]:
    """Yield the entries of sigma = G lam + g + R lam."""
    R = np.zeros(problem.rows) if problem.R is None else problem.R
    for i, (row, g, r) in enumerate(zip(problem.G.tolist(), problem.g.tolist(), R.tolist(),
                                        strict=True)):  # fmt: skip
        products = (Decimal(entry) * x for entry, x in zip(row, lam, strict=True) if entry and x)
        yield sum(products, Decimal(g) + Decimal(r) * lam[i])


def _missed(
    problem: ContactProblem, lam: Sequence[Decimal], sigma: Sequence[Decimal], stiff: Decimal
) -> Iterator[Decimal]:
    """Yield what each contact misses, with either sign."""
    moved = [x - s / stiff for x, s in zip(lam, sigma, strict=True)]
    row = 0
    for friction in problem.friction.tolist():
        mu, (t1, t2, n) = Decimal(friction), moved[row : row + 3]
        if problem.law == "ncp":
            n -= mu * _hypot(*sigma[row : row + 2]) / stiff
        of_cone = _missed_by_a_cone(lam[row : row + 3], (t1, t2, n), mu)
        if _in_cone(lam[row : row + 3], mu):
            stuck = max(map(abs, sigma[row : row + 3])) / stiff
            of_cone = stuck if _in_cone((t1, t2, n), mu) else min(of_cone, stuck)
        yield of_cone
        row += 3
    for _ in range(problem.half_lines):
        yield lam[row] - max(moved[row], _ZERO)
        row += 1
    for limit in map(Decimal, problem.limits.tolist()):
        yield lam[row] - min(max(moved[row], -limit), limit)
        row += 1


def _missed_by_a_cone(lam: Sequence[Decimal], moved: Sequence[Decimal], mu: Decimal) -> Decimal:
    """Return how far impulses are from the nearest point of the cone to others."""
    nearest = _on_cone(moved, mu)
    return max(abs(x - there) for x, there in zip(lam, nearest, strict=True))


def _in_cone(x: Sequence[Decimal], mu: Decimal) -> bool:
    """Return whether |x_t| <= mu x_n."""
    t1, t2, n = x
    return n >= 0 and _hypot(t1, t2) <= mu * n


def _on_cone(x: Sequence[Decimal], mu: Decimal) -> tuple[Decimal, ...]:
    """Return the point of |x_t| <= mu x_n that is nearest to x."""
    t1, t2, n = x
    slip = _hypot(t1, t2)
    if mu * slip <= -n:
        return _ZERO, _ZERO, _ZERO
    if slip <= mu * n:
        return t1, t2, n
    height = (n + mu * slip) / (1 + mu * mu)
    share = mu * height / slip
    return share * t1, share * t2, height


def _hypot(x: Decimal, y: Decimal) -> Decimal:
    return (x * x + y * y).sqrt()
