"""PGS: Pinocchio's projected Gauss-Seidel."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, Final, NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.linalg.lapack import dpstrf

from condyn_pin._core import _pin
from condyn_pin._core.arguments import Grid, check_accuracy, check_iterations
from condyn_pin._core.arrays import Array, Indices, finite
from condyn_pin.contact.problem import ContactProblem, Law, normalised
from condyn_pin.contact.solvers.contact_solver import ContactSolver, SolverResult
from condyn_pin.errors import InvalidArgument, UnsupportedBackend

# Of the largest over-relaxation that a tangential block allows; at 1 it only just converges.
_SAFE = 0.6


@dataclass(frozen=True)
class PGS(ContactSolver):
    """Projected Gauss-Seidel: one contact after the other, in sweeps.

    lam_i <- P_K(lam_i - omega d_i / G_ii)

    Parameters
    ----------
    tolerance : float
        On which Pinocchio's iteration stops, in units of the problem [1]. A hundredth of the
        natural residual that is wanted, because it is compared with the change in the last sweep.
    max_iterations : int
        Sweeps.
    over_relaxation : float, optional
        omega [1]. The tangential step is by the smaller diagonal entry of a contact's block, so
        that omega has to be below 2 min(G_11, G_22) over the largest eigenvalue of that block, or
        it never ends. By default 1, or 0.6 of that bound where it is less.

    Raises
    ------
    InvalidArgument
        If the tolerance is negative, or `max_iterations` or `over_relaxation` is not positive.

    Notes
    -----
    Only for an ncp, as in Pinocchio. Cost O(m^2) per sweep. With large mass ratios or redundant
    contacts it takes thousands of sweeps. That of Pinocchio 3 stops after the first one if there is
    no friction at all.

    References
    ----------
    Jourdan, Alart, Jean. A Gauss-Seidel like algorithm to solve frictional contact problems.
    Computer Methods in Applied Mechanics and Engineering 155, 1998.
    """

    title: ClassVar[str] = "PGS"
    cost: ClassVar[str] = "O(m^2) a round"
    use: ClassVar[str] = "few contacts of light legs; what other simulators do"
    laws: ClassVar[tuple[Law, ...]] = ("ncp",)
    sweeps: ClassVar[tuple[Grid, ...]] = ({"tolerance": (1e-4, 1e-6, 1e-8, 1e-10)},)

    tolerance: float = 1e-10
    max_iterations: int = 5000
    over_relaxation: float | None = None

    def __post_init__(self) -> None:
        check_accuracy("tolerance", self.tolerance)
        check_iterations(self.max_iterations)
        if (
            self.over_relaxation is not None
            and not finite("over_relaxation", self.over_relaxation, ()) > 0
        ):
            raise InvalidArgument(f"over_relaxation = {self.over_relaxation!r}: a number > 0")

    def attempt(self, problem: ContactProblem, guess: Array | None = None) -> SolverResult:
        """Return the impulses after the last sweep, from `guess` or from none."""
        if not _pin.solves_contacts(True, len(problem.limits)):
            raise UnsupportedBackend(
                "dry friction of joints by PGS needs Pinocchio 4; take SemismoothNewton()"
            )
        small, unit = normalised(problem)
        rows = padded(small)
        relaxation = self._relaxation(rows.G, problem)
        if not relaxation > 0:  # nothing moves a contact along t1 or t2, by which it divides
            return SolverResult(np.zeros(problem.rows), 0, (self.title,))
        lam, iterations = _pin.pgs(
            rows.G, rows.g, rows.friction, rows.limits,
            tolerance=self.tolerance, max_iterations=self.max_iterations,
            over_relaxation=relaxation,
            guess=rows.spread(None if guess is None else guess / unit),
        )  # fmt: skip
        return SolverResult(lam[rows.kept] * unit, iterations, (self.title,))

    def _relaxation(self, G: Array, problem: ContactProblem) -> float:
        """Over-relaxation omega, below 2 min(G_11, G_22) / max eig G_tt of each contact."""
        t1 = 3 * np.arange(len(problem.friction))
        a, b, c = G[t1, t1], G[t1 + 1, t1 + 1], G[t1, t1 + 1]
        bounds = 4 * np.minimum(a, b) / (a + b + np.hypot(a - b, 2 * c))
        least = float(bounds.min(initial=2.0))
        if self.over_relaxation is None:
            return min(1.0, _SAFE * least)
        if self.over_relaxation >= least:
            name = problem.names[bounds.argmin()] if len(bounds) else "Gauss-Seidel"
            raise InvalidArgument(
                f"over_relaxation = {self.over_relaxation:g}: {name} needs less than {least:.3g}, "
                "by how its mass differs along t1 and t2"
            )
        return self.over_relaxation


# Contact problems as Pinocchio takes them: a stop is a cone without friction and two empty rows.
#
# Tangential rows that nothing moves along, of stops and in mechanisms that stay in a plane, get a
# number on the diagonal, so that Gauss-Seidel may divide by it: their impulse is zero then, which
# is one of the answers.


class PinocchioContactProblem(NamedTuple):
    """Rows of cones, stops among them, then of intervals."""

    G: Array
    g: Array
    friction: Array
    limits: Array
    kept: Indices | slice  # rows of the problem among them

    def spread(self, lam: Array | None) -> Array | None:
        """Return impulses of the problem in these rows."""
        if lam is None:
            return None
        whole = np.zeros(len(self.g))
        whole[self.kept] = lam
        return whole


def padded(problem: ContactProblem) -> PinocchioContactProblem:
    """Return the problem with three rows for each half-line; itself if no row has to be added."""
    h, mu = problem.half_lines, problem.friction
    if not h and np.count_nonzero(problem.G.diagonal()) == len(problem.g):
        return PinocchioContactProblem(problem.G, problem.g, mu, problem.limits, slice(None))
    cones, lines, _ = problem.sets.parts
    stops = cones.stop + 2 + 3 * np.arange(h)
    size = problem.rows + 2 * h
    kept = np.concatenate([np.arange(cones.stop), stops, np.arange(lines.stop + 2 * h, size)])
    G, g = np.zeros((size, size)), np.zeros(size)
    G[np.ix_(kept, kept)] = problem.G
    g[kept] = problem.g
    three = np.arange(cones.stop + 3 * h).reshape(-1, 3)
    diagonal = G[three, three]
    empty = (diagonal == 0) & (g[three] == 0)
    empty[:, 2] = False  # what nothing moves along the normal stays as it is
    largest = diagonal.max(axis=1, keepdims=True)
    G[three, three] = np.where(empty, np.where(largest > 0, largest, 1.0), diagonal)
    return PinocchioContactProblem(G, g, np.concatenate([mu, np.zeros(h)]), problem.limits, kept)


# Alternating directions: Pinocchio's, or by products where contacts are many and bodies few.


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
    """Return impulses (m,) and iterations; None of all but cones and stops in Pinocchio 3."""
    # `tolerance` is the natural residual to reach [1]; `anderson` are the steps that Pinocchio's
    # acceleration remembers; ours has none.
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
    lam, iterations = _pin.admm(
        rows.G, rows.g, rows.friction, rows.limits,
        ncp=problem.law == "ncp", tolerance=_SHARE * tolerance,
        max_iterations=max_iterations, anderson=anderson, guess=rows.spread(begin),
    )  # fmt: skip
    return lam[rows.kept] * unit, iterations


def accelerated(problem: ContactProblem) -> bool:
    """True if `directions` has an acceleration for this problem."""
    return _pin.HAS_ANDERSON and factor_of(normalised(problem)[0]) is None


# Alternating directions on many contacts of few bodies: by products with X, G = X^T X, not with G.
#
#     x <- argmin  x^T G x / 2 + (g + s) . x + rho |x - y - z / rho|^2 / 2
#     y <- P_K(x - z / rho),    z <- z - rho (x - y),    s = (0, 0, mu |z_t|) in an ncp
#
# at whose end x = y is the impulse and z what is dual to it. With r the rank of G,
#
#     (rho + X^T X)^-1 = (1 - X^T (rho + X X^T)^-1 X) / rho
#
# needs r x r factors, where G has m x m: five hundred points below one plate have r = 6.
#
# References
# ----------
# Boyd, Parikh, Chu, Peleato, Eckstein. Distributed optimization and statistical learning via the
# alternating direction method of multipliers. Foundations and Trends in Machine Learning 3, 2011.
# Carpentier, Le Lidec, Montaut. From compliant to rigid contact simulation: a unified and efficient
# approach. RSS, 2024.


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
    """Return impulses (m,) of a normalised problem, X^T X = G, and the iterations."""
    # It ends on a natural residual of `tolerance`. O(r m) an iteration, O(r^2 m + r^3) for each
    # rho.
    best, least, rho = start, _normalised_residual(problem, X, start), _RHO
    y, z, solve = start, problem.dual(problem.velocities(start)), _inverse(X, rho)
    for k in range(1, max_iterations + 1):
        x = solve(rho * y + z - (problem.g + (problem.dual(z) - z)))
        beyond = _BEYOND * x + (1 - _BEYOND) * y
        before, y = y, problem.sets.project(beyond - z / rho)
        z = z - rho * (beyond - y)
        if k % _LOOK and k < max_iterations:
            continue
        missed = _normalised_residual(problem, X, y)
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


def _normalised_residual(problem: ContactProblem, X: Array, lam: Array) -> float:
    """Return the natural residual, which in a normalised problem is up to twice this."""
    x = lam - problem.dual(problem.g + (X @ lam) @ X)
    return float(np.abs(lam - problem.sets.project(x)).max())


def _size(x: Array) -> float:
    return max(float(np.abs(x).max()), _TINY)
