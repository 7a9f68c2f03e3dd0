"""SemismoothNewton: the natural map to rounding."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from math import isfinite
from typing import ClassVar, Final, NamedTuple

import numpy as np
from scipy.linalg.lapack import dgelsy, dgelsy_lwork, dposv, dpotrs

from condyn_pin._core import _pin, tolerances
from condyn_pin._core.arguments import check_count, check_iterations
from condyn_pin._core.arrays import Array, read_only
from condyn_pin.contact.problem import ContactProblem, island_of, normalised
from condyn_pin.contact.residuals import infeasible_contacts, natural_residual
from condyn_pin.contact.solvers.contact_solver import (
    BUDGET,
    EVALUATIONS,
    FACTORISATION,
    FIRST_ORDER,
    PIVOTS,
    ContactSolver,
    SolverResult,
)
from condyn_pin.contact.solvers.lemke import Lemke, refine_polygons
from condyn_pin.contact.solvers.pgs import PGS, directions, factor_of

# Compliance of the first proximal problem, in units of G, what it shrinks by, and its end; how many
# problems there are at most.
_SOFTEST, _HARDER, _HARDEST, _PROXIMAL = 1.0, 0.1, 1e-10, 40

# Polygons that are tried, with so many sides, and how many sides of all contacts come first: pivots
# cost the square of that, and where there are more they are the last resort. Fans of corners that
# follow the slips, one after the other [rad].
_SIDES, _LARGEST = (8, 16), 400
_FANS = (0.4, 0.2, 0.05)

# Rows from which ADMM is the cheaper start, and fewer contacts are tried; what it is asked for, and
# Newton's steps from there: if so few do not end, they stall.
MANY, _NEAR, _STEPS, BRIEF = 60, 1e-8, 4000, 8

# Iterations of ADMM where all else stalls, times rows squared: 200 000 for eight contacts, and how
# many at most. Soles whose corners contradict each other by 1e-6 have taken 75 000, and 0.5 s.
_LONG = 1.2e8
_LONGEST = 1_000_000

# Contacts that contradict each other by more than this, relative, are not tried any longer.
_HOPELESS = 1e-3


@dataclass(frozen=True)
class SemismoothNewton(ContactSolver):
    """Newton's method on the natural map, globalised: the reference among contact solvers.

    F(lam) = lam - P_K(lam - rho d(lam)) = 0,    rho = 1 of the normalised problem

    F is piecewise smooth, and any of its one-sided derivatives makes a step; where contacts are
    redundant, the smallest one. Steps are halved until |F| falls.

    Parameters
    ----------
    max_iterations : int
        Newton steps from each starting point. Solo12 on four feet takes two to five, a stack of
        boxes with fifty contacts forty.
    budget : int
        What other starts may cost together, in ordinary solves: 70 evaluations of F, of which a
        derivative with its factorisation counts as six, or 500 iterations of first order, each.
        Without an answer by then the status is `out_of_budget`.

    Raises
    ------
    InvalidArgument
        If `max_iterations` or `budget` is not positive.

    Notes
    -----
    Cost O(m^3) a step, a singular value decomposition. Where it stalls, as with large friction or
    friction that locks bodies (Painlevé), it starts again. In an ncp: from the answer of Lemke's
    method for polygons, with more corners along the sliding directions each time, and from what
    `PGS` finds, contact by contact. In a ccp: by the proximal point method, with a penalty on the
    distance from the answer before that falls tenfold each time, and rises tenfold where Newton's
    method stalls.

    References
    ----------
    Qi, Sun. A nonsmooth version of Newton's method. Mathematical Programming 58, 1993.
    Alart, Curnier. A mixed formulation for frictional contact problems prone to Newton like
    solution methods. Computer Methods in Applied Mechanics and Engineering 92, 1991.
    Rockafellar. Monotone operators and the proximal point algorithm. SIAM Journal on Control and
    Optimization 14, 1976.
    """

    title: ClassVar[str] = "Newton"
    cost: ClassVar[str] = "O(m^3) a step"
    use: ClassVar[str] = "the reference: to rounding; derivatives, which need the modes exactly"

    max_iterations: int = 50
    budget: int = BUDGET

    def __post_init__(self) -> None:
        check_iterations(self.max_iterations)
        check_count("budget", self.budget)

    def attempt(self, problem: ContactProblem, guess: Array | None = None) -> SolverResult:
        """Return the end of Newton's method from `guess`, from ADMM, or from no impulses."""
        near = None
        if guess is None and problem.rows >= MANY:
            near = directions(problem, None, tolerance=_NEAR, max_iterations=_STEPS, anderson=4)
        if near is None:
            return refine(problem, guess, self.max_iterations)
        steps = min(self.max_iterations, BRIEF)
        return refine(problem, near[0], steps).after(of_first_order(*near, "ADMM"))

    def alternatives(self, problem: ContactProblem, found: SolverResult) -> Iterator[SolverResult]:
        """Yield the ends from other starts."""
        for found in fewer(problem, found, self.max_iterations, self.budget):  # noqa: B020
            yield found
        yield from restarts(problem, found, self.max_iterations, self.budget)


def refine(problem: ContactProblem, start: Array | None, max_iterations: int) -> SolverResult:
    """Return the end of Newton's method from a start that is finite, or from no impulses."""
    small, unit = normalised(problem)
    begin = np.zeros(problem.rows)
    if start is not None and np.isfinite(start).all():
        begin = np.asarray(start / unit)
    end = newton(small, begin, max_iterations)
    return end._replace(lam=end.lam * unit)


def of_first_order(lam: Array, iterations: int, title: str) -> SolverResult:
    """Return impulses found by iterations of first order."""
    return SolverResult(lam, iterations, (title,), cost=iterations / FIRST_ORDER)


def fewer(
    problem: ContactProblem, found: SolverResult, max_iterations: int, budget: float
) -> Iterator[SolverResult]:
    """Impulses of some of many contacts, and of those that their motion closes."""

    def solve(part: ContactProblem, guess: Array) -> SolverResult:
        end, left = refine(part, guess, max_iterations), budget - found.cost
        for other in restarts(part, end, max_iterations, left):
            if natural_residual(part, end.lam) <= tolerances.FINEST or end.cost >= left:
                break
            end = other
        return end

    for end in solve_active_subset(problem, solve):
        found = end._replace(path=("fewer contacts",)).after(found)
        yield found


def restarts(
    problem: ContactProblem, found: SolverResult, max_iterations: int, budget: float
) -> Iterator[SolverResult]:
    """Yield the ends of Newton's method from other starts, the cheapest first."""
    # None of them begins, or goes on, where all together have cost the budget.
    small, unit = normalised(problem)
    if not np.isfinite(np.concatenate((small.G.ravel(), small.g, small.friction))).all():
        yield SolverResult(np.zeros(problem.rows), 0, ()).after(found)  # nobody answers that
        return
    cheap = len(problem.friction) * _SIDES[0] <= _LARGEST
    if problem.law == "ncp":
        if cheap:
            for found in _polygons(problem, found, max_iterations, budget):  # noqa: B020
                yield found
    else:
        for end in _proximal(small, max_iterations):
            found = end._replace(lam=end.lam * unit, path=("proximal point",)).after(found)
            yield found
        found = refine(problem, found.lam, max_iterations).after(found)
        yield found
    if infeasible_contacts(problem, _HOPELESS):
        return
    for method in (_gauss_seidel, _long_directions):
        first = method(problem, budget - found.cost)
        if first is None:
            continue
        found = first.after(found)
        yield found
        found = refine(problem, found.lam, max_iterations).after(found)
        yield found
    if problem.law == "ncp" and not cheap:
        yield from _polygons(problem, found, max_iterations, budget)


def _gauss_seidel(problem: ContactProblem, left: float) -> SolverResult | None:
    """Return the impulses of `PGS`, or None where Pinocchio has none."""
    if problem.law != "ncp" or not _pin.solves_contacts(True, len(problem.limits)):
        return None
    found = PGS(max_iterations=_at_most(FIRST_ORDER * left, PGS.max_iterations)).attempt(problem)
    return of_first_order(found.lam, found.iterations, PGS.title)


def _long_directions(problem: ContactProblem, left: float) -> SolverResult | None:
    """Return the impulses of ADMM after many iterations, or None where Pinocchio has none."""
    if not _pin.solves_contacts(problem.law == "ncp", len(problem.limits)):
        return None
    most = _at_most(FIRST_ORDER * left, min(int(_LONG / problem.rows**2), _LONGEST))
    long = directions(problem, None, tolerance=_NEAR, max_iterations=most, anderson=0)
    return None if long is None else of_first_order(*long, "ADMM for longer")


def _at_most(affordable: float, most: int) -> int:
    """Return a number of iterations: one at least, what is affordable, and no more than `most`."""
    return max(int(min(affordable, most)), 1)


def _polygons(
    problem: ContactProblem, found: SolverResult, max_iterations: int, budget: float
) -> Iterator[SolverResult]:
    """Yield the ends of Newton's method from the answers of polygons, regular and turned."""
    for sides in _SIDES:
        most = _at_most(PIVOTS * (budget - found.cost), Lemke.max_iterations)
        polygon = Lemke(sides, most).attempt(problem)
        found = refine(problem, polygon.lam, max_iterations).after(polygon.after(found))
        yield found
        for width in _FANS if polygon.answered and len(problem.friction) else ():
            polygon = refine_polygons(problem, polygon.lam, width, sides)
            found = refine(problem, polygon.lam, max_iterations).after(polygon.after(found))
            yield found


def _proximal(problem: ContactProblem, max_iterations: int) -> Iterator[SolverResult]:
    """Yield answers of a normalised ccp that cost R / 2 |lam - the one before|^2 more."""
    lam, R, one = np.zeros(problem.rows), _SOFTEST, np.eye(problem.rows)
    for _ in range(_PROXIMAL):
        softer = problem.replaced(G=problem.G + R * one, g=problem.g - R * lam)
        reached = newton(softer, lam, max_iterations)
        solved = natural_residual(softer, reached.lam) <= tolerances.CONTACT_SOLVED
        R = max(R * _HARDER, _HARDEST) if solved else R / _HARDER
        lam = reached.lam if solved else lam
        yield reached._replace(lam=lam)


# Newton's method on the natural map of a normalised contact problem.
#
# F(lam) = lam - P_K(lam - d(lam)) = 0,    F' = 1 - P_K' (1 - d' G)
#
# F is piecewise smooth, and any of its one-sided derivatives makes a step. Where contacts are
# redundant, F' is singular, and the smallest step is taken; it is halved until |F| falls.
#
# Where it does not, redundant contacts may stick that are asked for velocities which no motion has,
# as the two ends of a tilted foot are by gaps that both are to close. What they carry among
# themselves then grows, without a change of F, until one of them slides: that far it is taken at
# once.


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


def newton(problem: ContactProblem, lam: Array, max_iterations: int) -> SolverResult:
    """Impulses, steps and cost at the end of Newton's method on a normalised problem."""
    steps, slips, point = 0, 0, _natural_map(problem, lam)
    best, least, work = lam, point.size, 1  # [evaluations]
    while steps < max_iterations and isfinite(point.size):
        largest, size = (float(np.abs(each).max(initial=0.0)) for each in (point.F, lam))
        if largest <= _ROUNDING * max(1.0, size):
            break
        D = _derivative(problem, point)
        step = _smallest_step(D, point.F)
        if step is None:
            break
        steps += 1
        moved, tried = _descend(problem, lam, step, point)
        work += FACTORISATION + tried
        if moved is None and slips < _SLIPS:
            slips, work = slips + 1, work + FACTORISATION
            moved = _until_one_changes(problem, lam, point, D)
        if moved is None:
            break
        lam, point = moved
        if point.size < least:
            best, least = lam, point.size
    return SolverResult(best, steps, (SemismoothNewton.title,), cost=work / EVALUATIONS)


class _Point(NamedTuple):
    F: Array  # (m,)
    x: Array  # (m,) lam - d, which is projected
    sigma: Array  # (m,)
    size: float  # |F|


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
) -> tuple[tuple[Array, _Point] | None, int]:
    """Return the first of lam + step, + step/2, ... with a smaller residual, and its number."""
    share = 1.0
    for tried in range(1, _HALVINGS + 1):
        there = lam + share * step
        reached = _natural_map(problem, there)
        if reached.size < (1 - 1e-4 * share) * point.size:
            return (there, reached), tried
        share /= 2
    return None, _HALVINGS


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
    """Return the distance along y (m,) to the first cone that x enters or leaves, K or its polar.

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


# Contact problems of some contacts, and of those that go through the answer of these.
#
# Of hundreds of points below a plate that is not quite flat, few carry it. Where lam_i = 0 and
# sigma_n >= 0 the law is met: an answer for some contacts is one for all if the others part by
# themselves, and if not, those that do not are added. What does not press is left out again, once
# for each contact, so that it ends.


# Share of a problem's contacts from which fewer are no fewer.
_MOST: Final = 0.9

# Rank of G, as a share of its rows, of contacts that few bodies have among them.
_FEW: Final = 0.1

Solve = Callable[[ContactProblem, Array], SolverResult]


def solve_active_subset(problem: ContactProblem, solve: Solve) -> Iterator[SolverResult]:
    """Yield impulses (m,) of some contacts alone, by `solve`; none if bodies are many."""
    normals, (_, speed) = problem.sets.normals, problem.scale
    count, lam = len(normals), np.zeros(problem.rows)
    asked = np.arange(len(problem.names)) >= count  # dry friction always
    X = factor_of(problem)
    if X is None or len(X) > _FEW * problem.rows:
        return
    at_once = max(len(X) // 6, 1)  # one of each body
    dropped = np.zeros(count, dtype=bool)
    while True:
        sigma = np.where(asked[:count], 0.0, problem.velocities(lam)[normals])
        through = np.argsort(sigma, kind="stable")[:at_once]
        through = through[sigma[through] < -tolerances.FINEST * speed]
        asked[through] = True
        if not len(through) or asked.sum() > _MOST * len(asked):
            return
        island = island_of(problem.sets, problem.names, np.flatnonzero(asked))
        part = island.problem(problem)
        found = solve(part, lam[island.rows])
        lam = np.zeros(problem.rows)
        lam[island.rows] = found.lam
        yield found._replace(lam=lam)
        if not natural_residual(part, found.lam) <= tolerances.CONTACT_SOLVED:
            return
        idle = asked[:count] & (lam[normals] <= 0) & ~dropped
        dropped |= idle
        asked[:count] &= ~idle


# Sticking: impulses of contacts that stick where they would close, and open where they would not.
#
#     G_AA lam_A = -g_A,    lam = 0 elsewhere,    A: contacts with g_n < 0, and all dry friction
#
# A robot on its feet slides in few of its steps. In the others one linear system has the answer to
# rounding, for a quarter of the time of an iterative solver; the natural residual says which they
# are. Redundant contacts share what they carry: the smallest impulses, rows weighted by the
# diagonal.


# What G gets more on its diagonal, relative: far above rounding, far below its eigenvalues where
# contacts are not redundant, 1e-5. One correction leaves the square of their ratio.
_MORE: Final = 1e-9

# Share of the largest pivot of Cholesky, below which a row counts as a combination of others: its
# square, 1e-6, is far above what G gets more.
_APART: Final = 1e-3


def sticking(problem: ContactProblem) -> Array | None:
    """Return the impulses (m,) if no contact slides, not proved: a contact may pull, or slide."""
    # O(m^3), a Cholesky factorisation; 6 us for four contacts.
    g, (_, lines, _) = problem.g.tolist(), problem.sets.parts
    closing = [speed < 0 for speed in g[2 : lines.start : 3] + g[lines]]
    closing += len(problem.limits) * [True]
    if not any(closing):
        return np.zeros(problem.rows)
    G = problem.G if problem.R is None else problem.G + np.diag(problem.R)
    if all(closing):
        return _solved(G, problem.g)
    rows = np.flatnonzero(np.array(closing)[problem.sets.blocks])
    found = _solved(G[rows[:, None], rows], problem.g[rows])
    if found is None:
        return None
    lam = np.zeros(problem.rows)
    lam[rows] = found
    return lam


def _solved(G: Array, g: Array) -> Array | None:
    """Return the smallest solution of G lam = -g, None where a row moves nothing."""
    factor, lam, info = dposv(G, -g, overwrite_b=1)
    if not info:
        pivots = factor.diagonal().tolist()
        if min(pivots) > _APART * max(pivots):
            return np.asarray(lam)
    more = G * _heavier(len(g))
    factor, lam, info = dposv(more.T, -g, overwrite_a=1, overwrite_b=1)  # more.T: no copy
    if info:
        return None
    return np.asarray(lam - dpotrs(factor, G.dot(lam) + g)[0])


@lru_cache(maxsize=16)
def _heavier(m: int) -> Array:
    """Return the factors (m, m) that enlarge the diagonal of a matrix, entry by entry."""
    return read_only(1.0 + _MORE * np.eye(m))
