"""SemismoothNewton: the natural map to rounding."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from condyn_pin._core import _pin, tolerances
from condyn_pin._core.arguments import check_count, check_iterations
from condyn_pin._core.arrays import Array
from condyn_pin.contact.cadoux import cadoux
from condyn_pin.contact.certificate import unmet_contacts
from condyn_pin.contact.directions import directions
from condyn_pin.contact.fewer import with_fewer
from condyn_pin.contact.natural_map import newton
from condyn_pin.contact.problem import ContactProblem
from condyn_pin.contact.residuals import natural_residual
from condyn_pin.contact.scaling import normalised
from condyn_pin.contact.solvers.base import (
    BUDGET,
    FACTORISED,
    FIRST_ORDER,
    PIVOTS,
    Attempt,
    ContactSolver,
)
from condyn_pin.contact.solvers.lemke import Lemke, turned
from condyn_pin.contact.solvers.pgs import PGS

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

# Convex problems of the last method, and slips that no longer change [1].
_CONVEX, _SAME = 100, 1e-6


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
        What other starts may cost together, in ordinary solves: ten steps with a factorisation, or
        a thousand iterations of first order, each. Without an answer by then the status is
        `out_of_budget`.

    Raises
    ------
    InvalidArgument
        If `max_iterations` or `budget` is not positive.

    Notes
    -----
    Cost O(m^3) a step, a singular value decomposition. Where it stalls, as with large friction or
    friction that locks bodies (Painlevé), it starts again. In an ncp: from the answer of Lemke's
    method for polygons, with more corners along the sliding directions each time; from a fixed
    point of ccps, each with the sliding speeds |sigma_t| of the one before in its g; and from what
    `PGS` finds, contact by contact. In a ccp: by the proximal point method, with a penalty on the
    distance from the answer before that falls tenfold each time, and rises tenfold where Newton's
    method stalls.

    References
    ----------
    Qi, Sun. A nonsmooth version of Newton's method. Mathematical Programming 58, 1993.
    Alart, Curnier. A mixed formulation for frictional contact problems prone to Newton like
    solution methods. Computer Methods in Applied Mechanics and Engineering 92, 1991.
    Cadoux. An optimization-based algorithm for Coulomb's frictional contact. ESAIM: Proceedings
    27, 2009: the fixed point.
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

    def attempt(self, problem: ContactProblem, guess: Array | None = None) -> Attempt:
        """Return the end of Newton's method from `guess`, from ADMM, or from no impulses."""
        near = None
        if guess is None and problem.rows >= MANY:
            near = directions(problem, None, tolerance=_NEAR, max_iterations=_STEPS, anderson=4)
        if near is None:
            return refine(problem, guess, self.max_iterations)
        steps = min(self.max_iterations, BRIEF)
        return refine(problem, near[0], steps).after(of_first_order(*near, "ADMM"))

    def alternatives(self, problem: ContactProblem, found: Attempt) -> Iterator[Attempt]:
        """Yield the ends from other starts."""
        for found in fewer(problem, found, self.max_iterations, self.budget):  # noqa: B020
            yield found
        yield from restarts(problem, found, self.max_iterations, self.budget)


def refine(problem: ContactProblem, start: Array | None, max_iterations: int) -> Attempt:
    """Return the end of Newton's method from a start that is finite, or from no impulses."""
    small, unit = normalised(problem)
    begin = np.zeros(problem.rows)
    if start is not None and np.isfinite(start).all():
        begin = np.asarray(start / unit)
    end = newton(small, begin, max_iterations)
    return factorised(end.lam * unit, end.iterations, SemismoothNewton.title)


def factorised(lam: Array, steps: int, title: str) -> Attempt:
    """Return impulses found by steps with a factorisation each."""
    return Attempt(lam, steps, (title,), cost=steps / FACTORISED)


def of_first_order(lam: Array, iterations: int, title: str) -> Attempt:
    """Return impulses found by iterations of first order."""
    return Attempt(lam, iterations, (title,), cost=iterations / FIRST_ORDER)


def fewer(
    problem: ContactProblem, found: Attempt, max_iterations: int, budget: float
) -> Iterator[Attempt]:
    """Yield what some of many contacts answer, and those that go through their answer."""

    def solve(part: ContactProblem, guess: Array) -> Attempt:
        end, left = refine(part, guess, max_iterations), budget - found.cost
        for other in restarts(part, end, max_iterations, left):
            if natural_residual(part, end.lam) <= tolerances.FINEST or end.cost >= left:
                break
            end = other
        return end

    for end in with_fewer(problem, solve):
        found = end._replace(path=("fewer contacts",)).after(found)
        yield found


def restarts(
    problem: ContactProblem, found: Attempt, max_iterations: int, budget: float
) -> Iterator[Attempt]:
    """Yield the ends of Newton's method from other starts, the cheapest first.

    None of them begins, or goes on, where all together have cost the budget.
    """
    small, unit = normalised(problem)
    if not np.isfinite(np.concatenate((small.G.ravel(), small.g, small.friction))).all():
        yield Attempt(np.zeros(problem.rows), 0, ()).after(found)  # nobody answers that
        return
    cheap = len(problem.friction) * _SIDES[0] <= _LARGEST
    if problem.law == "ncp":
        if cheap:
            for found in _polygons(problem, found, max_iterations, budget):  # noqa: B020
                yield found
        most = int(FACTORISED * (budget - found.cost))
        lam, iterations = _fixed_point(small, max_iterations, most)
        found = factorised(lam * unit, iterations, "fixed point").after(found)
    else:
        for lam, iterations in _proximal(small, max_iterations):
            found = factorised(lam * unit, iterations, "proximal point").after(found)
            yield found
    found = refine(problem, found.lam, max_iterations).after(found)
    yield found
    if unmet_contacts(problem, _HOPELESS):
        return
    for method in (_gauss_seidel, _long_directions, _convex_problems):
        first = method(problem, budget - found.cost)
        if first is None:
            continue
        found = first.after(found)
        yield found
        found = refine(problem, found.lam, max_iterations).after(found)
        yield found
    if problem.law == "ncp" and not cheap:
        yield from _polygons(problem, found, max_iterations, budget)


def _gauss_seidel(problem: ContactProblem, left: float) -> Attempt | None:
    """Return what `PGS` comes to, or None where Pinocchio has none."""
    if problem.law != "ncp" or not _pin.solves_contacts(True, len(problem.limits)):
        return None
    found = PGS(max_iterations=_at_most(FIRST_ORDER * left, PGS.max_iterations)).attempt(problem)
    return of_first_order(found.lam, found.iterations, PGS.title)


def _long_directions(problem: ContactProblem, left: float) -> Attempt | None:
    """Return what ADMM comes to in many iterations, or None where Pinocchio has none."""
    if not _pin.solves_contacts(problem.law == "ncp", len(problem.limits)):
        return None
    most = _at_most(FIRST_ORDER * left, min(int(_LONG / problem.rows**2), _LONGEST))
    long = directions(problem, None, tolerance=_NEAR, max_iterations=most, anderson=0)
    return None if long is None else of_first_order(*long, "ADMM for longer")


def _convex_problems(problem: ContactProblem, left: float) -> Attempt | None:
    """Return what convex problems come to whose slips are known, by Cadoux' iteration."""
    if problem.law != "ncp":
        return None
    small, unit = normalised(problem)
    lam, steps = cadoux(small, _at_most(FACTORISED * left, _LONGEST))
    return factorised(lam * unit, steps, "convex problems")


def _at_most(affordable: float, most: int) -> int:
    """Return a number of iterations: one at least, what is affordable, and no more than `most`."""
    return max(int(min(affordable, most)), 1)


def _polygons(
    problem: ContactProblem, found: Attempt, max_iterations: int, budget: float
) -> Iterator[Attempt]:
    """Yield the ends of Newton's method from the answers of polygons, regular and turned."""
    for sides in _SIDES:
        most = _at_most(PIVOTS * (budget - found.cost), Lemke.max_iterations)
        polygon = Lemke(sides, most).attempt(problem)
        found = refine(problem, polygon.lam, max_iterations).after(polygon.after(found))
        yield found
        for width in _FANS if polygon.answered and len(problem.friction) else ():
            polygon = turned(problem, polygon.lam, width, sides)
            found = refine(problem, polygon.lam, max_iterations).after(polygon.after(found))
            yield found


def _proximal(problem: ContactProblem, max_iterations: int) -> Iterator[tuple[Array, int]]:
    """Yield answers of a normalised ccp that cost R / 2 |lam - the one before|^2 more."""
    lam, R, one = np.zeros(problem.rows), _SOFTEST, np.eye(problem.rows)
    for _ in range(_PROXIMAL):
        softer = problem.replaced(G=problem.G + R * one, g=problem.g - R * lam)
        end = newton(softer, lam, max_iterations)
        solved = natural_residual(softer, end.lam) <= tolerances.CONTACT_SOLVED
        R = max(R * _HARDER, _HARDEST) if solved else R / _HARDER
        lam = end.lam if solved else lam
        yield lam, end.iterations


def _fixed_point(problem: ContactProblem, max_iterations: int, most: int) -> tuple[Array, int]:
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
        if iterations >= most or not np.abs(slips - before).max(initial=0.0) > _SAME:
            break
    return lam, iterations
