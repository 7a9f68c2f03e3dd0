"""SemismoothNewton: the natural map to rounding."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import isfinite
from typing import ClassVar, NamedTuple

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin._core.parameters import check_iterations
from condyn_pin.contact.problem import ContactProblem
from condyn_pin.contact.scaling import normalised
from condyn_pin.contact.solvers.base import Attempt, ContactSolver
from condyn_pin.contact.solvers.lemke import Lemke

_EPS = float(np.finfo(np.float64).eps)

# A residual that is rounding, relative to the impulses of the normalised problem.
_ROUNDING = 4 * _EPS

# Halvings of a step before a point counts as a minimum of |F|^2 that is no root.
_HALVINGS = 20

# Singular values of the generalised Jacobian that redundant contacts leave, and steps ignore.
_REDUNDANT = 1e-12

# Compliance of the first problem of a continuation, in units of G, what it shrinks by, and its end.
_SOFTEST, _HARDER, _HARDEST = 1.0, 0.1, 1e-10

# Polygons that are tried, with so many sides.
_SIDES = (8, 16)

# Convex problems of the last method, and slips that no longer change [1].
_CONVEX, _SAME = 100, 1e-6


@dataclass(frozen=True)
class SemismoothNewton(ContactSolver):
    """Newton's method on the natural map, globalised: the reference of this room.

    F(lam) = lam - P_K(lam - rho d(lam)) = 0,    rho = 1 of the normalised problem

    F is piecewise smooth, and any of its one-sided derivatives makes a step; where contacts are
    redundant, the smallest one. Steps are halved until |F| falls.

    Parameters
    ----------
    max_iterations : int
        Steps from each start. Solo12 on four feet takes two, and five at most; forty are what a
        stack of boxes with fifty contacts takes.

    Notes
    -----
    Cost O(m^3) a step, a singular value decomposition. Where it stalls, as it does where friction
    is large or locks bodies (Painleve), it starts again. In an ncp from polygons, by Lemke's
    method, and then from a fixed point: with the slips |sigma_t| of the problem before in its g, an
    ncp is a ccp. In a ccp from softer problems, each ten times harder than the one before.

    References
    ----------
    Qi, Sun. A nonsmooth version of Newton's method. Mathematical Programming 58, 1993.
    Alart, Curnier. A mixed formulation for frictional contact problems prone to Newton like
    solution methods. Computer Methods in Applied Mechanics and Engineering 92, 1991.
    Cadoux. An optimization-based algorithm for Coulomb's frictional contact. ESAIM: Proceedings
    27, 2009: the fixed point.
    """

    title: ClassVar[str] = "Newton"
    cost: ClassVar[str] = "O(m^3) a step"
    use: ClassVar[str] = "the reference: to rounding; derivatives, which need the modes exactly"

    max_iterations: int = 50

    def __post_init__(self) -> None:
        check_iterations(self.max_iterations)

    def attempt(self, problem: ContactProblem, guess: Array | None = None) -> Attempt:
        """Return the end of Newton's method from `guess`, or from no impulses."""
        return refine(problem, guess, self.max_iterations)

    def alternatives(self, problem: ContactProblem, found: Attempt) -> Iterator[Attempt]:
        """Yield the ends from other starts."""
        yield from restarts(problem, found, self.max_iterations)


def refine(problem: ContactProblem, start: Array | None, max_iterations: int) -> Attempt:
    """Return the end of Newton's method from a start that is finite, or from no impulses."""
    small, unit = normalised(problem)
    begin = np.zeros(problem.rows)
    if start is not None and np.isfinite(start).all():
        begin = np.asarray(start / unit)
    end = newton(small, begin, max_iterations)
    return Attempt(end.lam * unit, end.iterations, (SemismoothNewton.title,))


def restarts(problem: ContactProblem, found: Attempt, max_iterations: int) -> Iterator[Attempt]:
    """Yield the ends of Newton's method from other starts, the cheapest first."""
    if problem.law == "ncp":
        for sides in _SIDES:
            polygon = Lemke(sides).attempt(problem)
            end = refine(problem, polygon.lam, max_iterations)
            found = end.after(polygon.after(found))
            yield found
        find, title = _fixed_point, "fixed point"
    else:
        find, title = _harder_and_harder, "continuation"
    small, unit = normalised(problem)
    lam, iterations = find(small, max_iterations)
    start = Attempt(lam * unit, iterations, (title,))
    yield refine(problem, start.lam, max_iterations).after(start.after(found))


def _harder_and_harder(problem: ContactProblem, max_iterations: int) -> tuple[Array, int]:
    """Return the answer of a normalised problem with next to no compliance, by way of more."""
    lam, iterations, R = np.zeros(problem.rows), 0, _SOFTEST
    while R > _HARDEST:
        softer = problem.replaced(G=problem.G + R * np.eye(len(lam)))
        end = newton(softer, lam, max_iterations)
        lam, R, iterations = end.lam, R * _HARDER, iterations + end.iterations
    return lam, iterations


def _fixed_point(problem: ContactProblem, max_iterations: int) -> tuple[Array, int]:
    """Return the answer of a normalised ncp, as that of convex problems whose slips are known."""
    slips, lam, iterations = np.zeros(len(problem.friction)), np.zeros(problem.rows), 0
    cones = problem.sets.parts[0]
    for _ in range(_CONVEX):
        g = problem.g.copy()
        g[2 : cones.stop : 3] += problem.friction * slips
        convex = problem.replaced(g=g, law="ccp")
        end = newton(convex, lam, max_iterations)
        lam, iterations = end.lam, iterations + end.iterations
        S = problem.velocities(lam)[cones].reshape(-1, 3)
        before, slips = slips, np.hypot(S[:, 0], S[:, 1])
        if not np.abs(slips - before).max(initial=0.0) > _SAME:
            break
    return lam, iterations


class _End(NamedTuple):
    lam: Array
    iterations: int
    residual: float  # |F|_inf


def newton(problem: ContactProblem, lam: Array, max_iterations: int) -> _End:
    """Return the end of Newton's method on a normalised problem."""
    steps, point = 0, _natural_map(problem, lam)
    while steps < max_iterations and isfinite(point.size):
        if point.largest <= _ROUNDING * max(1.0, float(np.abs(lam).max(initial=0.0))):
            break
        D = _derivative(problem, point)
        try:
            step, *_ = np.linalg.lstsq(D, -point.F, rcond=_REDUNDANT)
        except np.linalg.LinAlgError:
            break
        steps += 1
        shrunk = _descend(problem, lam, np.asarray(step), point)
        if shrunk is None:
            break
        lam, point = shrunk
    return _End(lam, steps, point.largest)


class _Point(NamedTuple):
    F: Array  # (m,)
    x: Array  # (m,) lam - d, which is projected
    sigma: Array  # (m,)
    size: float  # |F|

    @property
    def largest(self) -> float:
        return float(np.abs(self.F).max(initial=0.0))


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
