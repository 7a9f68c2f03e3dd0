"""Sticking: impulses of contacts that stick where they would close, and open where they would not.

    G_AA lam_A = -g_A,    lam = 0 elsewhere,    A: contacts with g_n < 0, and all dry friction

A robot on its feet slides in few of its steps. In the others one linear system has the answer to
rounding, for a quarter of the time of an iterative solver; the natural residual says which they
are. Redundant contacts share what they carry: the smallest impulses, rows weighted by the diagonal.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Final

import numpy as np
from scipy.linalg.lapack import dposv, dpotrs

from condyn_pin._core.arrays import Array, read_only
from condyn_pin.contact.problem import ContactProblem

# What G gets more on its diagonal, relative: far above rounding, far below its eigenvalues where
# contacts are not redundant, 1e-5. One correction leaves the square of their ratio.
_MORE: Final = 1e-9

# Share of the largest pivot of Cholesky, below which a row counts as a combination of others: its
# square, 1e-6, is far above what G gets more.
_APART: Final = 1e-3


def sticking(problem: ContactProblem) -> Array | None:
    """Return the impulses (m,) if no contact slides; None where there are none.

    They are not proved: a contact may pull, or slide.

    Notes
    -----
    Cost O(m^3), a Cholesky factorisation; 6 us for four contacts.
    """
    closing = _closing(problem)
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


def _closing(problem: ContactProblem) -> list[bool]:
    """Return for each contact whether it closes without impulses; dry friction counts as one."""
    g, (_, lines, _) = problem.g.tolist(), problem.sets.parts
    closing = [speed < 0 for speed in g[2 : lines.start : 3] + g[lines]]
    return closing + len(problem.limits) * [True]


def _solved(G: Array, g: Array) -> Array | None:
    """Return the smallest solution of G lam = -g, None where a row moves nothing."""
    factor, lam, info = dposv(G, -g, overwrite_b=1)
    if not info and not _is_redundant(factor):
        return np.asarray(lam)
    more = G * _heavier(len(g))
    factor, lam, info = dposv(more.T, -g, overwrite_a=1, overwrite_b=1)  # more.T: no copy
    if info:
        return None
    return np.asarray(lam - dpotrs(factor, G.dot(lam) + g)[0])


def _is_redundant(factor: Array) -> bool:
    """Return whether rows of G, factorised, are combinations of others but for a small share."""
    pivots = factor.diagonal().tolist()
    return not min(pivots) > _APART * max(pivots)


@lru_cache(maxsize=16)
def _heavier(m: int) -> Array:
    """Return what makes the diagonal of a matrix (m, m) larger, entry by entry."""
    return read_only(1.0 + _MORE * np.eye(m))
