"""Lemke: Stewart and Trinkle's linear complementarity problem, with polygons for cones."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from condyn_pin._core.arrays import Array, Indices
from condyn_pin._core.parameters import Grid, check_count, check_iterations
from condyn_pin.contact.problem import ContactProblem, Law
from condyn_pin.contact.scaling import normalised
from condyn_pin.contact.solvers.base import Attempt, ContactSolver
from condyn_pin.errors import InvalidArgument

# An entry of the entering column, relative to its largest, that is rounding and not a pivot.
_NO_PIVOT = 1e-11

# Compliance, in units of G, with which redundant contacts are asked again where rounding has led to
# a ray: far above the pivots that are none, far below what a polygon is off the circle.
_SOFT = 1e-6

# A negative entry of an answer, relative to the largest, that is rounding.
_NEGATIVE = 1e-6

# Ratios that differ by less are tied, and the lexicographic rule decides.
_TIED = 1e-12


@dataclass(frozen=True)
class Lemke(ContactSolver):
    """Lemke's pivoting on a problem whose cones are polygons inside of the round ones.

    w = A z + b >= 0,  z >= 0,  w . z = 0,    z = (l_n, beta, slip)

    l_t = D beta with `sides` directions D in the ground, sum beta <= mu l_n, and `slip` the speed
    at which a contact slides. A is copositive: the method ends with an answer wherever there is one
    that bodies can have, also where friction locks them.

    Parameters
    ----------
    sides : int
        Of each polygon, even. Friction is right along its corners; between them it is less, by
        1 - cos(pi / sides) at most, and up to pi / sides off the direction of slip.
    max_iterations : int
        Pivots; about as many as there are directions.

    Notes
    -----
    It answers another problem than the other solvers: what slides is off by what the polygon is off
    the circle, and the status says inaccurate. It is where to begin, when nothing else helps. Ties
    are broken by the lexicographic rule, so that no basis comes twice. Cost O(m sides) numbers
    squared, a pivot.

    References
    ----------
    Stewart, Trinkle. An implicit time-stepping scheme for rigid body dynamics with inelastic
    collisions and Coulomb friction. Int. J. Numerical Methods in Engineering 39, 1996.
    Cottle, Pang, Stone. The linear complementarity problem, sections 4.4 and 4.9. SIAM, 2009.
    """

    title: ClassVar[str] = "Lemke"
    cost: ClassVar[str] = "O((m sides)^2) a pivot, about m sides of them"
    use: ClassVar[str] = "polygons; the start of Newton where friction locks"
    laws: ClassVar[tuple[Law, ...]] = ("ncp",)
    sweeps: ClassVar[tuple[Grid, ...]] = ({"sides": (4, 8, 16, 32)},)
    exact: ClassVar[bool] = False

    sides: int = 8
    max_iterations: int = 5000

    def __post_init__(self) -> None:
        check_count("sides", self.sides, least=4)
        if self.sides % 2:
            raise InvalidArgument(
                f"sides = {self.sides}: an even number; each side has an opposite"
            )
        check_iterations(self.max_iterations)

    def attempt(self, problem: ContactProblem, guess: Array | None = None) -> Attempt:
        """Return the polygon's answer, NaN if there is none; it has no use for a guess."""
        small, unit = normalised(problem)
        lam, pivots = self._answer(small)
        if not np.isfinite(lam).all():
            softer = small.replaced(G=small.G + _SOFT * np.eye(problem.rows))
            lam, more = self._answer(softer)
            pivots += more
        return Attempt(lam * unit, pivots, (self.title,))

    def _answer(self, problem: ContactProblem) -> tuple[Array, int]:
        B, A, b = _linear(problem, self.sides)
        z, pivots = lemke(A, b, self.max_iterations)
        return np.asarray(B @ z[: B.shape[1]]), pivots


def _linear(problem: ContactProblem, sides: int) -> tuple[Array, Array, Array]:
    """Return B, A and b: lam = B z and w = A z + b, z >= 0 with one slip of each thing that slides.

    Dry friction of a joint is a polygon with two sides, and a load that does not depend on l_n.
    """
    cones, lines, intervals = problem.sets.parts
    k, n, m = len(problem.friction), problem.half_lines, len(problem.g)
    angles = 2 * np.pi * np.arange(sides) / sides
    directions = np.array([np.cos(angles), np.sin(angles)])
    pushes = [*range(2, cones.stop, 3), *range(lines.start, lines.stop)]
    two = len(problem.limits)
    B = np.zeros((m, k + n + sides * k + 2 * two))
    B[pushes, np.arange(k + n)] = 1.0
    E = np.zeros((sides * k + 2 * two, k + two))  # which slip a direction belongs to
    for i in range(k):
        at = slice(k + n + sides * i, k + n + sides * (i + 1))
        B[3 * i : 3 * i + 2, at] = directions
        E[sides * i : sides * (i + 1), i] = 1.0
    for j in range(two):
        first = sides * k + 2 * j
        B[intervals.start + j, k + n + first : k + n + first + 2] = 1.0, -1.0
        E[first : first + 2, k + j] = 1.0
    U = np.zeros((k + two, B.shape[1]))
    U[np.arange(k), np.arange(k)] = problem.friction
    U[:, k + n :] = -E.T
    above = np.vstack([np.zeros((k + n, k + two)), E])
    A = np.block([[B.T @ problem.G @ B, above], [U, np.zeros((k + two, k + two))]])
    b = np.concatenate([B.T @ problem.g, np.zeros(k), problem.limits])
    return B, A, b


def lemke(A: Array, b: Array, max_pivots: int) -> tuple[Array, int]:
    """Return z >= 0 with w = A z + b >= 0 and w . z = 0, and pivots; NaN if it ends on a ray."""
    n = len(b)
    if not n or b.min() >= 0:
        return np.zeros(n), 0
    # columns: w, z, the artificial variable, what they are equal to
    T = np.hstack([np.eye(n), -A, -np.ones((n, 1)), b[:, None]])
    basis, artificial = np.arange(n), 2 * n
    row, enter = int(b.argmin()), artificial
    for pivot in range(1, max_pivots + 1):
        T[row] /= T[row, enter]
        column = T[:, enter].copy()
        column[row] = 0.0
        T -= np.multiply.outer(column, T[row])
        leave, basis[row] = int(basis[row]), enter
        if leave == artificial:
            return _solution(A, b, basis), pivot
        enter = leave + n if leave < n else leave - n  # what is complementary to it
        row = _leaving(T, enter, basis == artificial)
        if row < 0:
            break
    return np.full(n, np.nan), pivot


def _leaving(T: Array, enter: int, artificial: Array) -> int:
    """Return the row with the smallest ratio, lexicographically; -1 if there is none."""
    column = T[:, enter]
    rows = np.flatnonzero(column > _NO_PIVOT * np.abs(column).max())
    ratios = T[rows, -1] / column[rows]
    if not len(rows) or not np.isfinite(ratios).all():
        return -1
    tied = rows[ratios <= ratios.min() + _TIED]
    if len(tied) == 1:
        return int(tied[0])
    if artificial[tied].any():
        return int(tied[artificial[tied]][0])
    # the inverse of the basis, which the columns of w have become
    inverse = T[tied, : len(T)] / column[tied, None]
    return int(tied[np.lexsort(inverse.T[::-1])[0]])


def _solution(A: Array, b: Array, basis: Indices) -> Array:
    """Return z of a basis, solved for anew: what the pivots rounded is gone."""
    n = len(b)
    columns = np.hstack([np.eye(n), -A])[:, basis]
    try:
        values = np.linalg.solve(columns, b)
    except np.linalg.LinAlgError:
        return np.full(n, np.nan)
    if values.min() < -_NEGATIVE * np.abs(values).max():
        return np.full(n, np.nan)  # pivots that were rounding have led here
    z = np.zeros(2 * n)
    z[basis] = values
    return np.maximum(z[n:], 0.0)
