"""SAP: the convex problem with compliance, without a constraint."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import inf
from typing import ClassVar

import numpy as np

from condyn_pin._core.arguments import check_iterations
from condyn_pin._core.arrays import Array
from condyn_pin.contact.problem import ContactProblem, ContactSets, Law
from condyn_pin.contact.solvers.contact_solver import (
    EVALUATIONS,
    FACTORISATION,
    ContactSolver,
    SolverResult,
)
from condyn_pin.errors import InvalidArgument

_EPS = float(np.finfo(np.float64).eps)

# A slope along a step that counts as level, relative to that at its start.
_LEVEL = 1e-8

# Compliances of a continuation, in units of the diagonal of G.
_SOFTER = 0.1 ** np.arange(8)

# Newton's steps along one of the steps.
_SEARCH = 60


@dataclass(frozen=True)
class SAP(ContactSolver):
    """The semi-analytic primal solver: Newton's method on a convex function, with exact steps.

    min over x  x^T G x / 2 + |P(y)|_R^2 / 2,    y = -R^-1 (G x + g),    lam = P(y)

    P is the projection on K in the metric of R, which has a closed form, and X x is the change of
    the velocity of the robot, G = X^T X. At the minimum G x = G lam. The function is convex and
    once differentiable, so that every start leads to the same answer.

    Parameters
    ----------
    max_iterations : int
        Newton steps from each starting point. Ten are plenty where R is a hundredth of the diagonal
        of G, as in MuJoCo and Drake; where it is a millionth, a hundred may be too few.

    Raises
    ------
    InvalidArgument
        If `max_iterations` is not positive.

    Notes
    -----
    Only for a ccp, with R > 0 in every row and the same along t1 and t2. Cost O(m^3) a step, one
    linear system. Where steps run out, it begins again with problems of more compliance, each ten
    times harder than the one before.

    References
    ----------
    Castro, Permenter, Han. An unconstrained convex formulation of compliant contact. IEEE
    Transactions on Robotics 39, 2023.
    """

    title: ClassVar[str] = "SAP"
    cost: ClassVar[str] = "O(m^3) a step"
    use: ClassVar[str] = "compliant contacts, as MuJoCo's and Drake's: always an answer"
    laws: ClassVar[tuple[Law, ...]] = ("ccp",)

    max_iterations: int = 100

    def __post_init__(self) -> None:
        check_iterations(self.max_iterations)

    def attempt(self, problem: ContactProblem, guess: Array | None = None) -> SolverResult:
        """Return the minimum, from `guess` or from no impulses."""
        function, work = _Function(problem), 1  # [evaluations]
        x = np.zeros(problem.rows) if guess is None else np.array(guess)
        for steps in range(self.max_iterations + 1):
            lam = function.impulses(x)
            if function.is_least(x, lam) or steps == self.max_iterations:
                break
            # G (1 + W G) dx = -G (x - lam), with the G in front of both left out
            slope = np.eye(len(x)) + function.curvature(x) @ problem.G
            work += FACTORISATION
            try:
                dx = np.asarray(np.linalg.solve(slope, lam - x))
            except np.linalg.LinAlgError:  # R is below the rounding of G: 1 + W G is W G
                break
            share, tried = function.exact_step(x, dx)
            x, work = x + share * dx, work + FACTORISATION * tried
        return SolverResult(lam, steps, (self.title,), cost=work / EVALUATIONS)

    def alternatives(self, problem: ContactProblem, found: SolverResult) -> Iterator[SolverResult]:
        """Yield the minimum by way of softer problems."""
        stiff, _ = problem.scale
        R, start = _Function(problem).R, None
        for softer in stiff * _SOFTER:
            result = self.attempt(problem.replaced(R=np.maximum(R, softer)), start)
            found, start = result.after(found), result.lam
        yield self.attempt(problem, start).after(found)


class _Function:
    """The function that is minimised, with its slope and its curvature."""

    def __init__(self, problem: ContactProblem) -> None:
        R = problem.R
        if R is None or not (R > 0).all():
            raise InvalidArgument("R: SAP needs a compliance > 0 in every row; ADMM() does not")
        cones, _, intervals = problem.sets.parts
        t1, t2, n = R[cones].reshape(-1, 3).T
        if not np.allclose(t1, t2, rtol=_EPS, atol=0.0):
            raise InvalidArgument("R: it differs along t1 and t2 of a cone; ADMM() can solve that")
        self.G, self.g, self.R, self.root = problem.G, problem.g, R, np.sqrt(R)
        # the same sets where the metric is the usual one
        self.sets = ContactSets(
            problem.friction * np.sqrt(t1 / n),
            problem.half_lines,
            problem.limits * self.root[intervals],
        )

    def impulses(self, x: Array) -> Array:
        """Return P(y) (m,)."""
        return self.sets.project(self._whitened(x)) / self.root

    def curvature(self, x: Array) -> Array:
        """Return W = P'(y) R^-1 (m, m)."""
        P, free = self.sets.slopes(self._whitened(x))
        W, k = np.zeros_like(self.G), len(P)
        own = np.arange(3 * k).reshape(k, 3)
        W[own[:, :, None], own[:, None, :]] = P
        others = np.arange(3 * k, len(W))
        W[others, others] = free
        return W / np.multiply.outer(self.root, self.root)

    def is_least(self, x: Array, lam: Array) -> bool:
        """True if the slope G (x - lam) is rounding, most of it that of y."""
        G = np.abs(self.G)
        y = (G @ np.abs(x) + np.abs(self.g)) / self.root**2
        rounding = _EPS * float((G @ (np.abs(lam) + y)).max(initial=0.0))
        return float(np.abs(self.G @ (x - lam)).max(initial=0.0)) <= rounding

    def exact_step(self, x: Array, dx: Array) -> tuple[float, int]:
        """Share of dx that goes down the most, by Newton's method in bounds, and tried shares."""
        G_dx, low, high, share = self.G @ dx, 0.0, inf, 1.0
        first = abs(float(G_dx @ (x - self.impulses(x))))
        for tried in range(1, _SEARCH + 1):  # noqa: B007
            there = x + share * dx
            lam = self.impulses(there)
            slope = float(G_dx @ (there - lam))
            rounding = _EPS * float(np.abs(G_dx) @ (np.abs(there) + np.abs(lam)))
            if abs(slope) <= max(_LEVEL * first, rounding):
                break
            low, high = (low, share) if slope > 0 else (share, high)
            bend = float(G_dx @ dx + G_dx @ self.curvature(there) @ G_dx)
            share = share - slope / bend if bend > 0 else inf
            if not low < share < high:
                share = 2 * low if high == inf else (low + high) / 2
        return share, tried

    def _whitened(self, x: Array) -> Array:
        return np.asarray(-(self.G @ x + self.g) / self.root)
