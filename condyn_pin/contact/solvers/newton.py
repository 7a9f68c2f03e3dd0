"""SemismoothNewton: the natural map to rounding."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from condyn_pin._core import _pin_contacts, tolerances
from condyn_pin._core.arrays import Array
from condyn_pin._core.parameters import check_iterations
from condyn_pin.contact.cadoux import cadoux
from condyn_pin.contact.certificate import unmet_contacts
from condyn_pin.contact.directions import directions
from condyn_pin.contact.fewer import with_fewer
from condyn_pin.contact.natural_map import newton
from condyn_pin.contact.problem import ContactProblem
from condyn_pin.contact.residuals import natural_residual
from condyn_pin.contact.scaling import normalised
from condyn_pin.contact.solvers.base import Attempt, ContactSolver
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

    Raises
    ------
    InvalidArgument
        If `max_iterations` is not positive.

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

    def __post_init__(self) -> None:
        check_iterations(self.max_iterations)

    def attempt(self, problem: ContactProblem, guess: Array | None = None) -> Attempt:
        """Return the end of Newton's method from `guess`, from ADMM, or from no impulses."""
        near = None
        if guess is None and problem.rows >= MANY:
            near = directions(problem, None, tolerance=_NEAR, max_iterations=_STEPS, anderson=4)
        if near is None:
            return refine(problem, guess, self.max_iterations)
        steps = min(self.max_iterations, BRIEF)
        return refine(problem, near[0], steps).after(Attempt(*near, ("ADMM",)))

    def alternatives(self, problem: ContactProblem, found: Attempt) -> Iterator[Attempt]:
        """Yield the ends from other starts."""
        for found in fewer(problem, found, self.max_iterations):  # noqa: B020
            yield found
        yield from restarts(problem, found, self.max_iterations)


def refine(problem: ContactProblem, start: Array | None, max_iterations: int) -> Attempt:
    """Return the end of Newton's method from a start that is finite, or from no impulses."""
    small, unit = normalised(problem)
    begin = np.zeros(problem.rows)
    if start is not None and np.isfinite(start).all():
        begin = np.asarray(start / unit)
    end = newton(small, begin, max_iterations)
    return Attempt(end.lam * unit, end.iterations, (SemismoothNewton.title,))


def fewer(problem: ContactProblem, found: Attempt, max_iterations: int) -> Iterator[Attempt]:
    """Yield what some of many contacts answer, and those that go through their answer."""

    def solve(part: ContactProblem, guess: Array) -> tuple[Array, int]:
        end = refine(part, guess, max_iterations)
        for other in restarts(part, end, max_iterations):
            if natural_residual(part, end.lam) <= tolerances.FINEST:
                break
            end = other
        return end.lam, end.iterations

    for lam, iterations in with_fewer(problem, solve):
        found = Attempt(lam, iterations, ("fewer contacts",)).after(found)
        yield found


def restarts(problem: ContactProblem, found: Attempt, max_iterations: int) -> Iterator[Attempt]:
    """Yield the ends of Newton's method from other starts, the cheapest first."""
    small, unit = normalised(problem)
    if not np.isfinite(np.concatenate((small.G.ravel(), small.g, small.friction))).all():
        yield Attempt(np.zeros(problem.rows), 0, ()).after(found)  # nobody answers that
        return
    cheap = len(problem.friction) * _SIDES[0] <= _LARGEST
    if problem.law == "ncp":
        if cheap:
            for found in _polygons(problem, found, max_iterations):  # noqa: B020
                yield found
        lam, iterations = _fixed_point(small, max_iterations)
        found = Attempt(lam * unit, iterations, ("fixed point",)).after(found)
    else:
        for lam, iterations in _proximal(small, max_iterations):
            found = Attempt(lam * unit, iterations, ("proximal point",)).after(found)
            yield found
    found = refine(problem, found.lam, max_iterations).after(found)
    yield found
    if unmet_contacts(problem, _HOPELESS):
        return
    for first in _slow(problem):
        found = first.after(found)
        yield found
        found = refine(problem, found.lam, max_iterations).after(found)
        yield found
    if problem.law == "ncp" and not cheap:
        yield from _polygons(problem, found, max_iterations)


def _slow(problem: ContactProblem) -> Iterator[Attempt]:
    """Yield what methods of first order, and convex problems, come to in many iterations."""
    is_ncp = problem.law == "ncp"
    if _pin_contacts.solves_contacts(is_ncp, len(problem.limits)):
        if is_ncp:
            yield PGS().attempt(problem)
        most = min(int(_LONG / problem.rows**2), _LONGEST)
        long = directions(problem, None, tolerance=_NEAR, max_iterations=most, anderson=0)
        if long is not None:
            yield Attempt(*long, ("ADMM for longer",))
    if is_ncp:
        small, unit = normalised(problem)
        lam, steps = cadoux(small)
        yield Attempt(lam * unit, steps, ("convex problems",))


def _polygons(problem: ContactProblem, found: Attempt, max_iterations: int) -> Iterator[Attempt]:
    """Yield the ends of Newton's method from the answers of polygons, regular and turned."""
    for sides in _SIDES:
        polygon = Lemke(sides).attempt(problem)
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
