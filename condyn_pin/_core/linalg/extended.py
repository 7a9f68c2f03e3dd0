"""Residuals of a linear system, summed exactly: extended precision on any machine.

A product of two doubles is the sum of two doubles, found by splitting each factor in halves
(Veltkamp, Dekker). `math.fsum` adds any number of doubles with one rounding at the end.

References
----------
Dekker. A floating-point technique for extending the available precision. Numer. Math. 18, 1971.
Ogita, Rump, Oishi. Accurate sum and dot product. SIAM J. Sci. Comput. 26, 2005.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from condyn_pin._core.arrays import Array

_SPLITTER = 2.0**27 + 1.0


def split(x: Array) -> tuple[Array, Array]:
    """Return two arrays of 26-bit numbers whose sum is x exactly."""
    c = _SPLITTER * x
    high = c - (c - x)
    return high, x - high


def exact_product(x: Array, y: Array) -> tuple[Array, Array]:
    """Return p and e with p + e = x y exactly, elementwise."""
    p = x * y
    (x1, x2), (y1, y2) = split(x), split(y)
    return p, x2 * y2 - (((p - x1 * y1) - x2 * y1) - x1 * y2)


def exact_residual(A: Array, b: Sequence[Array], x: tuple[Array, Array]) -> Array:
    """Return sum(b) - A (x[0] + x[1]), rounded once.

    Parameters
    ----------
    A : (k, k) array
    b : sequence of (k,) array
        The right-hand side as a sum, so that forming it costs no digits.
    x : pair of (k,) array
        The unknown as a sum of two doubles, the second the smaller.

    Returns
    -------
    (k,) array
        NaN in rows whose sum is not finite.
    """
    with np.errstate(over="ignore", invalid="ignore"):  # what overflows becomes NaN in its row
        p, e = exact_product(A, x[0])
        rows = np.column_stack([*b, -p, -e, -A * x[1]])
    return np.array([_sum(row) for row in rows.tolist()])  # a list is read three times as fast


def _sum(row: list[float]) -> float:
    try:
        return math.fsum(row)
    except (OverflowError, ValueError):
        return math.nan


def add(x: tuple[Array, Array], y: Array) -> tuple[Array, Array]:
    """Return x + y as a sum of two doubles (Knuth's two-sum, then renormalised)."""
    s = x[0] + y
    t = s - x[0]
    low = x[1] + ((x[0] - (s - t)) + (y - t))
    high = s + low
    return high, low - (high - s)
