"""Polish: a rough answer of a quadratic program made exact on its active set.

With G the equations and the rows that are active, d their bounds, and y all their multipliers,

    [H    G^T    ] [dx]   [-(H x + g + G^T y)]
    [G  -delta I ] [dy] = [     d - G x      ],        x += dx,  y += dy,

repeated: delta lets rows depend on each other, and repeating leaves no trace of it. Where they do,
multipliers stay near those that the rough answer has, and so do their signs. Rows that are then
violated become active, and those whose multiplier has the wrong sign are let go: the primal-dual
active-set method, a semismooth Newton method on `QuadraticProgram.kkt_residual`.

References
----------
Hintermüller, Ito, Kunisch. The primal-dual active set strategy as a semismooth Newton method. SIAM
Journal on Optimization, 2002.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from math import isfinite
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core.arrays import Array, Indices
from condyn_pin.control.qp.quadratic_program import QuadraticProgram, peak

Flags = NDArray[np.bool_]

# delta, where the largest entry of H is 1: rows of size 1 that depend on each other are told from
# those that do not at its square root, and each repetition takes a factor of 1e-5 or more off.
_DELTA = 1e-11
_REPETITIONS = 4
_SETTLED = 1e-13  # of what is wanted: a step that changes the last digits alone


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
    """

    x: Array
    y: Array
    z: Array
    at_lower: Flags
    at_upper: Flags
    active: Indices
    residual: float

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
    return Polished.rough(x, y, z, at_lower, at_upper)


def polish(program: QuadraticProgram, rough: Polished, tolerance: float, rounds: int) -> Polished:
    """Return the best answer that some rounds of the active-set method find.

    It ends early at a KKT residual below `tolerance`.
    """
    best = now = rough
    for _ in range(rounds):
        now = _on_active_rows(program, now)
        if not now.residual >= best.residual:
            best = now
        if best.residual <= tolerance or not isfinite(now.residual):
            break
        now = _on_other_rows(program, now, tolerance)
    return best


def _on_other_rows(program: QuadraticProgram, now: Polished, tolerance: float) -> Polished:
    """Return an answer with the rows that it violates active, and without those of wrong sign."""
    Cx = program.C @ now.x
    inactive = ~(now.at_lower | now.at_upper)
    below, above = Cx < program.lower - tolerance, Cx > program.upper + tolerance
    at_lower = (now.at_lower & (now.z < 0)) | (inactive & below)
    at_upper = (now.at_upper & (now.z > 0)) | (inactive & above)
    at_upper |= program.lower == program.upper
    return Polished.rough(now.x, now.y, now.z, at_lower, at_upper)


def _on_active_rows(program: QuadraticProgram, at: Polished) -> Polished:
    """Return the answer with the active rows as equations."""
    n, p, active = len(program.g), len(program.b), at.active
    G, d = _held(program, active, at.at_upper)
    wanted = np.concatenate((-program.g, d))
    K = np.empty((len(wanted), len(wanted)))
    K[:n, :n], K[n:, :n], K[:n, n:], K[n:, n:] = program.H, G, G.T, 0.0
    solve = _factorised(K, n, _DELTA / peak(program.H.diagonal()))
    xy = np.concatenate((at.x, at.y, at.z[active]))
    settled = _SETTLED**2 * wanted.dot(wanted)
    for _ in range(_REPETITIONS):
        left = wanted - K.dot(xy)
        xy += solve(left)
        if left.dot(left) <= settled:
            break
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


def _factorised(K: Array, n: int, delta: float) -> Callable[[Array], Array]:
    """Return what solves with K, from its row n on with -delta on the diagonal."""
    dgetrf, dgetrs = _lapack()
    corner = K.ravel()[n * (len(K) + 1) :: len(K) + 1]
    corner[:] = -delta
    factor, pivots, _ = dgetrf(K.T)  # symmetric, and LAPACK reads columns
    corner[:] = 0.0
    return lambda left: dgetrs(factor, pivots, left)[0]


@cache
def _lapack() -> tuple[Any, Any]:
    # imported here: scipy.linalg takes as long to import as Pinocchio
    from scipy.linalg.lapack import dgetrf, dgetrs

    return dgetrf, dgetrs
