"""Alternating directions: Pinocchio's, or by products where contacts are many and bodies few."""

from __future__ import annotations

import numpy as np

from condyn_pin._core import _pin
from condyn_pin._core.arrays import Array
from condyn_pin.contact.low_rank import alternate, factor_of
from condyn_pin.contact.padded import padded
from condyn_pin.contact.problem import ContactProblem
from condyn_pin.contact.scaling import normalised

# What Pinocchio is asked for, as a share of the tolerance: its own measure is up to three times
# smaller than the natural residual, and that of ours up to twice.
_SHARE = 0.25


def directions(
    problem: ContactProblem,
    guess: Array | None,
    *,
    tolerance: float,
    max_iterations: int,
    anderson: int,
) -> tuple[Array, int] | None:
    """Return impulses (m,) and iterations, or None: Pinocchio 3 takes ncp of cones and stops alone.

    Parameters
    ----------
    problem : ContactProblem
        The contact problem.
    guess : (m,) array or None
        Impulses to begin with [N s].
    tolerance : float
        The natural residual to reach [1].
    max_iterations : int
    anderson : int
        Steps that Pinocchio's acceleration remembers; ours has none.
    """
    small, unit = normalised(problem)
    begin = None if guess is None else guess / unit
    X = factor_of(small)
    if X is not None:
        start = np.zeros(problem.rows) if begin is None else begin
        lam, taken = alternate(small, X, start, _SHARE * tolerance, max_iterations)
        return lam * unit, taken
    if not _pin.solves_contacts(problem.law == "ncp", len(problem.limits)):
        return None
    rows = padded(small)
    found = _pin.admm(
        rows.G, rows.g, rows.friction, rows.limits,
        ncp=problem.law == "ncp", tolerance=_SHARE * tolerance,
        max_iterations=max_iterations, anderson=anderson, guess=rows.spread(begin),
    )  # fmt: skip
    return found.lam[rows.kept] * unit, found.iterations


def accelerated(problem: ContactProblem) -> bool:
    """Whether `directions` has an acceleration for this problem."""
    return _pin.HAS_ANDERSON and factor_of(normalised(problem)[0]) is None
