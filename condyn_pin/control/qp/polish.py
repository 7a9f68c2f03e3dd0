"""Polish: a rough answer of a quadratic program made exact on its active set.

The active rows are taken as equations, and the optimum that they leave is found exactly (`saddle`).
Rows that are then violated become active, and those whose multiplier has the wrong sign are let go:
the primal-dual active-set method, a semismooth Newton method on `QuadraticProgram.kkt_residual`.
Where rows depend on each other, multipliers stay near those that the rough answer has, and so do
their signs.

It has ended where the active set stays as it is. A small residual alone does not say so: what only
the regularisation decides is wrong by the residual over that, which is 1e-5 where tasks have 1e4.

References
----------
Hintermüller, Ito, Kunisch. The primal-dual active set strategy as a semismooth Newton method. SIAM
Journal on Optimization, 2002.
"""

from __future__ import annotations

from math import isfinite
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array, Indices
from condyn_pin.control.qp.quadratic_program import QuadraticProgram
from condyn_pin.control.qp.saddle import Saddle

Flags = NDArray[np.bool_]


class Polished(NamedTuple):
    """The answer of a program on an active set, and its KKT residual.

    Attributes
    ----------
    x, y, z : (n,), (p,), (r,) array
    at_lower, at_upper : (r,) bool array
        The active rows.
    active : (k,) int array
        Their numbers.
    residual : float
    settled : bool
        Whether no row would become active or be let go.
    """

    x: Array
    y: Array
    z: Array
    at_lower: Flags
    at_upper: Flags
    active: Indices
    residual: float
    settled: bool = False

    @classmethod
    def rough(cls, x: Array, y: Array, z: Array, at_lower: Flags, at_upper: Flags) -> Polished:
        """Return an answer that has not been judged yet."""
        return cls(x, y, z, at_lower, at_upper, (at_lower | at_upper).nonzero()[0], np.inf)


def start(
    program: QuadraticProgram, x: Array, z: Array, active: Polished | None = None
) -> Polished:
    """Return a rough answer with the rows that are active in it, or in another one."""
    y = np.zeros(len(program.b))
    if active:
        y = active.y if len(active.y) == len(y) else y
        return Polished(x, y, z, active.at_lower, active.at_upper, active.active, np.inf)
    moved = program.C @ x + z
    # where rows depend on each other a solver holds only some of them, and its choice has the signs
    at_lower, at_upper = (z < 0) & (moved < program.lower), (z > 0) & (moved > program.upper)
    return Polished.rough(x, y, z, at_lower & ~program.pinned, at_upper | program.pinned)


def polish(
    program: QuadraticProgram, rough: Polished, tolerance: float, rounds: int, saddle: Saddle
) -> Polished:
    """Return the answer that the active-set method ends at, or the best of some rounds.

    Parameters
    ----------
    program : QuadraticProgram
    rough : Polished
    tolerance : float
        Violations of rows below it are rounding [m/s^2].
    rounds : int
    saddle : Saddle
        Memory.
    """
    best = now = rough
    for _ in range(rounds):
        now = _on_active_rows(program, now, saddle)
        if not isfinite(now.residual):
            break
        if now.residual <= tolerance and _signs_hold(now):
            return now._replace(settled=True)
        other = _on_other_rows(program, now, tolerance)
        if _same_rows(now, other):  # another round takes off what rounding has left
            now = now._replace(settled=True)
        if _rank(now) < _rank(best):
            best = now
        if now.settled and now.residual <= tolerance:
            break
        now = other
    return best


def _rank(at: Polished) -> tuple[bool, float]:
    """Return what is less for a better answer: one that has settled and counts is first."""
    return not (at.settled and at.residual <= tolerances.KKT), at.residual


def _signs_hold(at: Polished) -> bool:
    """Return whether multipliers of active rows have the signs of their sides."""
    active = at.active
    return not len(active) or np.array_equal(at.z[active] > 0, at.at_upper[active])


def _same_rows(one: Polished, two: Polished) -> bool:
    lower, upper = one.at_lower, one.at_upper
    return np.array_equal(lower, two.at_lower) and np.array_equal(upper, two.at_upper)


def _on_other_rows(program: QuadraticProgram, now: Polished, tolerance: float) -> Polished:
    """Return an answer with the rows that it violates active, and without those of wrong sign."""
    Cx = program.C @ now.x
    inactive = ~(now.at_lower | now.at_upper)
    below, above = Cx < program.lower - tolerance, Cx > program.upper + tolerance
    at_lower = (now.at_lower & (now.z < 0)) | (inactive & below)
    at_upper = (now.at_upper & (now.z > 0)) | (inactive & above)
    at_lower &= ~program.pinned
    at_upper |= program.pinned
    return Polished.rough(now.x, now.y, now.z, at_lower, at_upper)


def _on_active_rows(program: QuadraticProgram, at: Polished, saddle: Saddle) -> Polished:
    """Return the answer with the active rows as equations."""
    n, p, active = len(program.g), len(program.b), at.active
    G, d = _held(program, active, at.at_upper)
    xy = np.concatenate((at.x, at.y, at.z[active]))
    saddle.factorise(program, G, d)
    saddle.improve(xy)
    x, y, z = xy[:n], xy[n : n + p], np.zeros(len(program.lower))
    z[active] = xy[n + p :]
    residual = program.kkt_residual(x, y, z)
    return Polished(x, y, z, at.at_lower, at.at_upper, active, residual)


def _held(program: QuadraticProgram, active: Indices, at_upper: Flags) -> tuple[Array, Array]:
    """Return the rows that hold with equality, and what they are equal to: G x = d."""
    if not len(active):  # as in most control ticks
        return program.A, program.b
    bound = np.where(at_upper[active], program.upper[active], program.lower[active])
    return np.concatenate((program.A, program.C[active])), np.concatenate((program.b, bound))
