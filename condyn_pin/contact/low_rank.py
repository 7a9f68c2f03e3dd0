"""Alternating directions on many contacts of few bodies: by products with X, G = X^T X, not with G.

    x <- argmin  x^T G x / 2 + (g + s) . x + rho |x - y - z / rho|^2 / 2
    y <- P_K(x - z / rho),    z <- z - rho (x - y),    s = (0, 0, mu |z_t|) in an ncp

at whose end x = y is the impulse and z what is dual to it. With r the rank of G,

    (rho + X^T X)^-1 = (1 - X^T (rho + X X^T)^-1 X) / rho

needs r x r factors, where G has m x m: five hundred points below one plate have r = 6.

References
----------
Boyd, Parikh, Chu, Peleato, Eckstein. Distributed optimization and statistical learning via the
alternating direction method of multipliers. Foundations and Trends in Machine Learning 3, 2011.
Carpentier, Le Lidec, Montaut. From compliant to rigid contact simulation: a unified and efficient
approach. RSS, 2024.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.linalg.lapack import dpstrf

from condyn_pin._core.arrays import Array
from condyn_pin.contact.problem import ContactProblem

# Rows from which X is looked for, and its rank as a share of them that makes it worth while.
_MANY: Final = 150
_FEW: Final = 0.5

# What X^T X leaves of G, relative to its largest entry.
_RANK: Final = 1e-13

# rho of the beginning, in units of the normalised problem; iterations after which it is looked at,
# and what it changes by where its two residuals differ by the square of that: new factors.
_RHO: Final = 0.1
_LOOK: Final = 10
_CHANGE: Final = 2.0

# Over-relaxation.
_BEYOND: Final = 1.8

_TINY: Final = float(np.finfo(np.float64).tiny)


def factor_of(problem: ContactProblem) -> Array | None:
    """Return X (r, m) with X^T X = G, or None where contacts are few, or nearly independent."""
    G, m = problem.G, problem.rows
    if m < _MANY or not np.isfinite(G).all():
        return None
    U, order, rank, _ = dpstrf(G, tol=_RANK * float(G.diagonal().max()))
    if rank > _FEW * m:
        return None
    X = np.empty((rank, m))
    X[:, order - 1] = np.triu(U)[:rank]
    return X


def alternate(
    problem: ContactProblem, X: Array, start: Array, tolerance: float, max_iterations: int
) -> tuple[Array, int]:
    """Return impulses (m,) of a normalised problem, and the iterations that they took.

    Parameters
    ----------
    problem : ContactProblem
        The contact problem.
    X : (r, m) array
        X^T X = G.
    start : (m,) array
        Impulses to begin with.
    tolerance : float
        Natural residual on which it ends.
    max_iterations : int

    Notes
    -----
    Cost O(r m) an iteration, and O(r^2 m + r^3) for each rho.
    """
    best, least, rho = start, _missed(problem, X, start), _RHO
    y, z, solve = start, problem.dual(problem.velocities(start)), _inverse(X, rho)
    for k in range(1, max_iterations + 1):
        x = solve(rho * y + z - _slipping(problem, z))
        beyond = _BEYOND * x + (1 - _BEYOND) * y
        before, y = y, problem.sets.project(beyond - z / rho)
        z = z - rho * (beyond - y)
        if k % _LOOK and k < max_iterations:
            continue
        missed = _missed(problem, X, y)
        if missed < least:
            best, least = y, missed
        if not missed > tolerance:
            break
        primal, dual = _size(x - y) / _size(y), rho * _size(y - before) / _size(z)
        if max(primal, dual) > _CHANGE**2 * min(primal, dual):
            rho *= _CHANGE if primal > dual else 1 / _CHANGE
            solve = _inverse(X, rho)
    return best, k


def _inverse(X: Array, rho: float) -> Callable[[Array], Array]:
    """Return b -> (rho + X^T X)^-1 b."""
    factors = cho_factor(rho * np.eye(len(X)) + X @ X.T)
    return lambda b: (b - cho_solve(factors, X @ b) @ X) / rho


def _missed(problem: ContactProblem, X: Array, lam: Array) -> float:
    """Return the natural residual, which in a normalised problem is up to twice this."""
    x = lam - problem.dual(problem.g + (X @ lam) @ X)
    return float(np.abs(lam - problem.sets.project(x)).max())


def _slipping(problem: ContactProblem, z: Array) -> Array:
    """Return g + s."""
    return problem.g + (problem.dual(z) - z)


def _size(x: Array) -> float:
    return max(float(np.abs(x).max()), _TINY)
