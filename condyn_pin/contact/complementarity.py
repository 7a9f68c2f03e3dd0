"""Linear complementarity by Lemke's pivots, where ties and redundant rows are not left to rounding.

    w = A z + b + s d >= 0,    z >= 0,    w . z = 0,    s from large to 0

The path goes from one basis to the next, and s is out of the basis at its end. Where rows are
redundant many of them could leave with the same ratio, and which one does decides whether a basis
comes twice. So b has e p more, with p > 0 and e > 0 below all numbers: ratios of b that are equal
to rounding are compared by those of p, which are of no special position and far apart. As p > 0,
it takes no answer away: each z with A z >= 0 and z . A z = 0 that b . z >= 0 allows has more of it.

References
----------
Cottle, Pang, Stone. The linear complementarity problem, sections 4.4 and 4.9. SIAM, 2009.
"""

from __future__ import annotations

from math import inf
from typing import Final, NamedTuple

import numpy as np

from condyn_pin._core.arrays import Array, Indices

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


class Complementary(NamedTuple):
    """The end of the pivots."""

    z: Array  # (n,), >= 0 and finite where A and b are
    pivots: int
    answered: bool  # whether z is an answer


def lemke(A: Array, b: Array, max_pivots: int) -> Complementary:
    """Return z >= 0 with w = A z + b >= 0 and w . z = 0, or the nearest that was found.

    Parameters
    ----------
    A : (n, n) array
    b : (n,) array
    max_pivots : int
        Of each of three paths.

    Notes
    -----
    A path without an answer ends on a ray. Cost O(n^2 + k^3) a pivot with k of z in the basis: each
    basis is factorised by itself, since a tableau that is carried on rounds until what is tied no
    longer is.
    """
    best, least, pivots = np.zeros(len(b)), _missed(A, b, np.zeros(len(b))), 0
    for step in _PATHS:
        if least <= _ANSWERED or not np.isfinite(least):
            break
        z, taken = _path(A, b, 1 + step * np.arange(1, len(b) + 1) % 1, max_pivots)
        missed = _missed(A, b, z)
        pivots += taken
        if missed < least:
            best, least = z, missed
    return Complementary(best, pivots, least <= _ANSWERED)


def _missed(A: Array, b: Array, z: Array) -> float:
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
    """Return columns in terms of a basis; NaN, which ends a path, where rounding took its rank.

    The columns of w are those of the identity: what is left of the basis is solved in the rows that
    have none of them.
    """
    n = len(basis)
    is_w = basis < n
    own, left = basis[is_w], np.ones(n, dtype=bool)
    left[own] = False
    B, wanted = columns[:, basis[~is_w]], columns[:, others]
    found = np.empty((n, len(others)))
    try:
        x = np.linalg.solve(B[left], wanted[left])
    except np.linalg.LinAlgError:
        return np.full((n, len(others)), np.nan)
    found[~is_w] = x
    found[is_w] = wanted[own] - B[own].dot(x)
    return found


def _leaving(T: Array, artificial: Array) -> int:
    """Return the row with the smallest ratio of b, and among those that are tied of p; or -1.

    T has the entering column, b and p in terms of the basis.
    """
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
