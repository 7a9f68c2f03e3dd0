"""Newton's method on the natural map of a normalised contact problem.

F(lam) = lam - P_K(lam - d(lam)) = 0,    F' = 1 - P_K' (1 - d' G)

F is piecewise smooth, and any of its one-sided derivatives makes a step. Where contacts are
redundant, F' is singular, and the smallest step is taken; it is halved until |F| falls.

Where it does not, redundant contacts may stick that are asked for velocities which no motion has,
as the two ends of a tilted foot are by gaps that both are to close. What they carry among
themselves then grows, without a change of F, until one of them slides: that far it is taken at
once.
"""

from __future__ import annotations

from math import isfinite
from typing import Final, NamedTuple

import numpy as np
from scipy.linalg.lapack import dgelsy, dgelsy_lwork

from condyn_pin._core.arrays import Array
from condyn_pin.contact.problem import ContactProblem

# A residual that is rounding, relative to the impulses of the normalised problem.
_ROUNDING: Final = 4 * float(np.finfo(np.float64).eps)

# Halvings of a step before a point counts as a minimum of |F|^2 that is no root.
_HALVINGS: Final = 20

# Singular values of F' that redundant contacts leave, and steps ignore.
_REDUNDANT: Final = 1e-12

# How often redundant contacts are taken to where one slides.
_SLIPS: Final = 8

# Share of a residual along what moves nothing, for which it is the reason, and how far behind the
# place where a contact slides a step begins, so that it does slide there.
_ALONG: Final = 0.5
_BEHIND: Final = 1e-3


class End(NamedTuple):
    """Where Newton's method ended."""

    lam: Array
    iterations: int


def newton(problem: ContactProblem, lam: Array, max_iterations: int) -> End:
    """Return the end of Newton's method on a normalised problem."""
    steps, slips, point = 0, 0, _natural_map(problem, lam)
    best, least = lam, point.size
    while steps < max_iterations and isfinite(point.size):
        if point.largest <= _ROUNDING * max(1.0, float(np.abs(lam).max(initial=0.0))):
            break
        D = _derivative(problem, point)
        step = _smallest_step(D, point.F)
        if step is None:
            break
        steps += 1
        moved = _descend(problem, lam, step, point)
        if moved is None and slips < _SLIPS:
            slips += 1
            moved = _until_one_changes(problem, lam, point, D)
        if moved is None:
            break
        lam, point = moved
        if point.size < least:
            best, least = lam, point.size
    return End(best, steps)


class _Point(NamedTuple):
    F: Array  # (m,)
    x: Array  # (m,) lam - d, which is projected
    sigma: Array  # (m,)
    size: float  # |F|

    @property
    def largest(self) -> float:
        return float(np.abs(self.F).max(initial=0.0))


def _smallest_step(D: Array, F: Array) -> Array | None:
    """Return the smallest step with D step = -F, by a complete orthogonal factorisation."""
    n = len(F)
    if not np.isfinite(D).all():
        return None
    pivots, (work, _) = np.zeros((n, 1), dtype=np.int32), dgelsy_lwork(n, n, 1, _REDUNDANT)
    _, step, _, _, wrong = dgelsy(D, -F[:, None], pivots, _REDUNDANT, int(work))
    return None if wrong else np.asarray(step[:, 0])


def _descend(
    problem: ContactProblem, lam: Array, step: Array, point: _Point
) -> tuple[Array, _Point] | None:
    """Return the first of lam + step, + step/2, ... with a smaller residual."""
    share = 1.0
    for _ in range(_HALVINGS):
        there = lam + share * step
        reached = _natural_map(problem, there)
        if reached.size < (1 - 1e-4 * share) * point.size:
            return there, reached
        share /= 2
    return None


def _until_one_changes(
    problem: ContactProblem, lam: Array, point: _Point, D: Array
) -> tuple[Array, _Point] | None:
    """Return lam with as much of what changes no F as makes a contact stick, slide or open."""
    within = _smallest_step(D, -D.dot(point.F))  # the part of F that D sees
    if within is None:
        return None
    y = within - point.F
    length = float(np.sqrt(y @ y))
    if not length > _ALONG * point.size:
        return None
    y /= length
    far = _first_change(problem, point, y)
    if not isfinite(far):
        return None
    there = lam + (1 + _BEHIND) * far * y
    return there, _natural_map(problem, there)


def _first_change(problem: ContactProblem, point: _Point, y: Array) -> float:
    """Return how far along y (m,) the first cone is that x enters or leaves, K or its polar cone.

    |x_t + s w_t| = mu (x_n + s w_n),    mu |x_t + s w_t| = -(x_n + s w_n)
    """
    cones, mu2 = problem.sets.parts[0], problem.friction**2
    X, S, Y = (each[cones].reshape(-1, 3) for each in (point.x, point.sigma, problem.G.dot(y)))
    W = y[cones].reshape(-1, 3) - (_dual_derivative(problem, S) @ Y[:, :, None])[:, :, 0]
    one = np.ones_like(mu2)
    weights = np.concatenate((np.stack((one, one, -mu2), 1), np.stack((mu2, mu2, -one), 1)))
    X, W = np.concatenate((X, X)), np.concatenate((W, W))
    a, b, c = ((weights * each).sum(axis=1) for each in (W * W, X * W, X * X))
    with np.errstate(all="ignore"):  # no root: a cone that x never meets
        q = -(b + np.copysign(np.sqrt(b * b - a * c), b))
        roots = np.concatenate((q / a, c / q))
    return float(roots[roots > _ROUNDING].min(initial=np.inf))


def _natural_map(problem: ContactProblem, lam: Array) -> _Point:
    sigma = problem.velocities(lam)
    x = lam - problem.dual(sigma)
    F = lam - problem.sets.project(x)
    return _Point(F, x, sigma, float(np.sqrt(F @ F)))


def _derivative(problem: ContactProblem, point: _Point) -> Array:
    """Return I - P'(x) (I - d'(sigma) G), of any of the one-sided derivatives."""
    G, cones = problem.G, problem.sets.parts[0]
    P, free = problem.sets.slopes(point.x)
    D = np.empty_like(G)
    D[cones.stop :] = free[:, None] * G[cones.stop :]
    rows = np.arange(cones.stop, len(G))
    D[rows, rows] += 1 - free
    k = len(P)
    E = _dual_derivative(problem, point.sigma[cones].reshape(k, 3))
    D[cones] = (P @ E @ G[cones].reshape(k, 3, len(G))).reshape(3 * k, len(G))
    own = np.arange(3 * k).reshape(k, 3)
    D[own[:, :, None], own[:, None, :]] += np.eye(3) - P
    return D


def _dual_derivative(problem: ContactProblem, S: Array) -> Array:
    """Return d'(sigma) (k, 3, 3): 1, and mu sigma_t / |sigma_t| in the normal row of an ncp."""
    E = np.broadcast_to(np.eye(3), (len(S), 3, 3)).copy()
    if problem.law == "ncp":
        slip = np.hypot(S[:, 0], S[:, 1])
        E[:, 2, :2] = (problem.friction / np.where(slip > 0, slip, 1.0))[:, None] * S[:, :2]
    return E
