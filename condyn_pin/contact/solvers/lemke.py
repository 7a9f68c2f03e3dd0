"""Lemke: Stewart and Trinkle's linear complementarity problem, with polygons for cones."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import ClassVar, Final

import numpy as np

from condyn_pin._core.arguments import Grid, check_count, check_iterations
from condyn_pin._core.arrays import Array, Indices
from condyn_pin.contact.problem import ContactProblem, Law, normalised
from condyn_pin.contact.solvers.contact_solver import PIVOTS, ContactSolver, SolverResult
from condyn_pin.errors import InvalidArgument

# Slips below this share of what friction would move things by are none.
_STILL = 1e-9


@dataclass(frozen=True)
class Lemke(ContactSolver):
    """Lemke's pivoting method, with polygons inscribed in the round cones.

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
        Pivots of each of at most three paths; half the number of directions is usual.

    Raises
    ------
    InvalidArgument
        If `sides` is odd or below 4, or `max_iterations` is not positive.

    Notes
    -----
    It solves a different problem from the other solvers: for sliding contacts it is off by the
    difference between polygon and circle, and the status is inaccurate. It provides a starting
    point where other methods fail. If the polygonal problem has no solution, the nearest point is
    returned, and the attempt is not `answered`. Cost O((m sides)^2) per pivot.

    References
    ----------
    Stewart, Trinkle. An implicit time-stepping scheme for rigid body dynamics with inelastic
    collisions and Coulomb friction. Int. J. Numerical Methods in Engineering 39, 1996.
    Anitescu, Potra. Formulating dynamic multi-rigid-body contact problems with friction as solvable
    linear complementarity problems. Nonlinear Dynamics 14, 1997.
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

    def attempt(self, problem: ContactProblem, guess: Array | None = None) -> SolverResult:
        """Return the polygon's answer, or the nearest to one; the guess is not used."""
        return _pivoted(problem, _regular(problem, self.sides), self.max_iterations)


def refine_polygons(problem: ContactProblem, lam: Array, width: float, sides: int) -> SolverResult:
    """Return the answer of polygons with more corners where contacts slide at impulses `lam`."""
    # Along such a corner a polygon has the friction of the circle. Where friction locks bodies or
    # is large, regular polygons are off by more than what they slide by. Five corners are a fan of
    # a `width` round the direction of slip [rad], beside a regular polygon of so many `sides`.
    cones = problem.sets.parts[0]
    L, S = (each[cones].reshape(-1, 3) for each in (lam, problem.velocities(lam)))
    # friction points against the slip, and where nothing slides it points anywhere
    moved = np.hypot(L[:, 0], L[:, 1]) * problem.scale[0]
    slides = np.hypot(S[:, 0], S[:, 1]) > moved * _STILL
    t = np.where(slides[:, None], -S[:, :2], L[:, :2])
    first = np.arctan2(t[:, 1], t[:, 0])[:, None]
    fan = width * np.linspace(-0.5, 0.5, 5)
    angles = np.hstack((_regular(problem, sides) + first, fan[fan != 0] + first))
    return _pivoted(problem, angles, Lemke.max_iterations)


def _regular(problem: ContactProblem, sides: int) -> Array:
    """Return the directions of the corners of regular polygons (k, sides) [rad]."""
    return np.tile(2 * np.pi * np.arange(sides) / sides, (len(problem.friction), 1))


def _pivoted(problem: ContactProblem, angles: Array, max_iterations: int) -> SolverResult:
    """Return the answer of the polygons with corners at `angles` (k, sides)."""
    small, unit = normalised(problem)
    B, A, b = _linear(small, angles)
    z, pivots, answered = lemke(A, b, max_iterations)
    lam = np.asarray(B @ z[: B.shape[1]]) * unit
    return SolverResult(lam, pivots, (Lemke.title,), answered, cost=pivots / PIVOTS)


def _linear(problem: ContactProblem, angles: Array) -> tuple[Array, Array, Array]:
    """Return B, A and b: lam = B z and w = A z + b, z >= 0 with one slip of each thing that slides.

    Dry friction of a joint is a polygon with two sides, and a load that does not depend on l_n.
    """
    intervals = problem.sets.parts[2]
    (k, sides), n, m = angles.shape, problem.half_lines, len(problem.g)
    directions = np.array([np.cos(angles), np.sin(angles)])
    dry = len(problem.limits)
    B = np.zeros((m, k + n + sides * k + 2 * dry))
    B[problem.sets.normals, np.arange(k + n)] = 1.0
    E = np.zeros((sides * k + 2 * dry, k + dry))  # which slip a direction belongs to
    for i in range(k):
        corners = slice(k + n + sides * i, k + n + sides * (i + 1))
        B[3 * i : 3 * i + 2, corners] = directions[:, i]
        E[sides * i : sides * (i + 1), i] = 1.0
    for j in range(dry):
        first = sides * k + 2 * j
        B[intervals.start + j, k + n + first : k + n + first + 2] = 1.0, -1.0
        E[first : first + 2, k + j] = 1.0
    U = np.zeros((k + dry, B.shape[1]))
    U[np.arange(k), np.arange(k)] = problem.friction
    U[:, k + n :] = -E.T
    above = np.vstack([np.zeros((k + n, k + dry)), E])
    A = np.block([[B.T @ problem.G @ B, above], [U, np.zeros((k + dry, k + dry))]])
    b = np.concatenate([B.T @ problem.g, np.zeros(k), problem.limits])
    return B, A, b


# Linear complementarity by Lemke's pivots, where ties and redundant rows are not left to rounding.
#
#     w = A z + b + s d >= 0,    z >= 0,    w . z = 0,    s from large to 0
#
# The path goes from one basis to the next, and s is out of the basis at its end. Where rows are
# redundant many of them could leave with the same ratio, and which one does decides whether a basis
# comes twice. So b has e p more, with p > 0 and e > 0 below all numbers: ratios of b that are equal
# to rounding are compared by those of p, which are of no special position and far apart. As p > 0,
# it takes no answer away: each z with A z >= 0 and z . A z = 0 that b . z >= 0 allows has more of
# it.
#
# References
# ----------
# Cottle, Pang, Stone. The linear complementarity problem, sections 4.4 and 4.9. SIAM, 2009.


# An entry of the entering column, relative to its largest, that is rounding and not a pivot.
_NO_PIVOT: Final = 1e-9

# Ratios of b, relative to |b|, that differ by less are tied; what is below is zero.
_TIED: Final = 1e-11

# What s is at the end of a path, relative to |b|. What rows ask for that no z can do is left of it,
# and pivots that go on are rounding.
_ENDED: Final = 1e-9

# What |min(z, w)| of an answer is at most, relative to |z| or |b|.
_ANSWERED: Final = 1e-8

# Steps between the entries of p, modulo one: each is another path, tried if the last went astray.
_PATHS: Final = tuple(np.sqrt((1.25, 2.0, 3.0)) % 1)


def lemke(A: Array, b: Array, max_pivots: int) -> tuple[Array, int, bool]:
    """Return z >= 0 with w = A z + b >= 0, w . z = 0, or the nearest; pivots; if z is one."""
    # A path without an answer ends on a ray; there are three, each of `max_pivots`. O(n^2 + k^3) a
    # pivot with k of z in the basis: each basis is factorised by itself, since a tableau that is
    # carried on rounds until what is tied no longer is.
    best, least, pivots = np.zeros(len(b)), _complementarity_error(A, b, np.zeros(len(b))), 0
    for step in _PATHS:
        if least <= _ANSWERED or not np.isfinite(least):
            break
        z, taken = _path(A, b, 1 + step * np.arange(1, len(b) + 1) % 1, max_pivots)
        missed = _complementarity_error(A, b, z)
        pivots += taken
        if missed < least:
            best, least = z, missed
    return best, pivots, least <= _ANSWERED


def _complementarity_error(A: Array, b: Array, z: Array) -> float:
    """Return |min(z, A z + b)|_inf, relative to |b|: a z made large by rounding is no solution."""
    size = float(np.abs(b).max(initial=0.0))
    return float(np.abs(np.minimum(z, A @ z + b)).max(initial=0.0)) / (size or 1.0)


def _path(A: Array, b: Array, p: Array, max_pivots: int) -> tuple[Array, int]:
    """Return z at the end of a path, and its pivots."""
    n, size = len(b), float(np.abs(b).max())
    artificial = 2 * n
    # of w, z, s, b and p
    columns = np.hstack([np.eye(n), -A, -np.ones((n, 1)), (b / size)[:, None], p[:, None]])
    basis, enter = np.arange(n), artificial
    nearest, least = basis.copy(), inf
    row = int(np.lexsort((p, np.where(np.abs(b) > _TIED * size, b, 0.0)))[0])
    pivots = 0
    while pivots < max_pivots:
        pivots += 1
        leave = int(basis[row])
        basis[row] = enter
        if leave == artificial:
            nearest = basis
            break
        enter = leave + n if leave < n else leave - n  # what is complementary to the one that left
        T = _in_basis(columns, basis, np.array([enter, artificial + 1, artificial + 2]))
        is_s = basis == artificial
        s = float(np.abs(T[is_s, 1]).max())
        if s < least:
            nearest, least = basis.copy(), s
        if s <= _ENDED:
            break
        row = _leaving(T, is_s)
        if row < 0:
            break
    return size * _values(columns, nearest), pivots


def _in_basis(columns: Array, basis: Indices, others: Indices) -> Array:
    """Return columns in terms of a basis; NaN, which ends a path, where rounding took its rank."""
    # The columns of w are those of the identity: what is left of the basis is solved in the rows
    # that have none of them.
    n = len(basis)
    is_w = basis < n
    own, left = basis[is_w], np.ones(n, dtype=bool)
    left[own] = False
    B, b = columns[:, basis[~is_w]], columns[:, others]
    found = np.empty((n, len(others)))
    try:
        x = np.linalg.solve(B[left], b[left])
    except np.linalg.LinAlgError:
        return np.full((n, len(others)), np.nan)
    found[~is_w] = x
    found[is_w] = b[own] - B[own].dot(x)
    return found


def _leaving(T: Array, artificial: Array) -> int:
    """Return the row with the smallest ratio of b, and among those that are tied of p; or -1."""
    # T has the entering column, b and p in terms of the basis.
    column, b, p = T.T
    rows = np.flatnonzero(column > _NO_PIVOT * np.abs(column).max())
    if not len(rows):
        return -1
    ratios = np.where(b[rows] > _TIED, b[rows], 0.0) / column[rows]
    tied = rows[ratios <= ratios.min() + _TIED]
    if artificial[tied].any():
        return int(tied[artificial[tied]][0])
    return int(tied[np.argmin(p[tied] / column[tied])])


def _values(columns: Array, basis: Indices) -> Array:
    """Return z >= 0 of a basis."""
    n = len(basis)
    values = np.zeros(2 * n + 1)
    values[basis] = _in_basis(columns, basis, np.array([2 * n + 1]))[:, 0]
    return np.maximum(values[n : 2 * n], 0.0)
