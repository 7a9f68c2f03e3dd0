"""Saddle: where a program has its optimum if some rows hold with equality, G x = d.

    [H    G^T    ] [x]   [-g]
    [G  -delta I ] [y] = [ d]

delta lets rows depend on each other. What it changes is taken out again by repetition, each from
what is left of the equations with delta = 0. Where rows depend on each other, multipliers stay near
those that it starts from.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from condyn_pin._core.arrays import Array, diagonal_of
from condyn_pin.control.qp.quadratic_program import QuadraticProgram, peak

# delta, where the largest entry of H is 1: rows of size 1 that depend on each other are told from
# those that do not at its square root, and each repetition takes a factor of 1e-5 or more off.
_DELTA = 1e-11
_REPETITIONS = 4
_SETTLED = 1e-13  # of what is wanted: a step that changes the last digits alone


class Saddle:
    """The matrix and its factors, in memory that is kept from program to program of one size."""

    _sizes = -1, -1

    def factorise(self, program: QuadraticProgram, G: Array, d: Array) -> None:
        """Take a program with rows G (m, n) that are equal to d (m,)."""
        n, m = G.shape[1], len(d)
        if self._sizes != (n, m):
            self._make(n, m)
        self._H[:], self._G[:], self._GT[:] = program.H, G, G.T
        np.negative(program.g, out=self._wanted[:n])
        self._wanted[n:] = d
        self._corner[:] = -_DELTA / peak(program.H.diagonal())  # the largest entry of H
        # symmetric, and LAPACK reads columns
        self._factor, self._pivots, _ = _lapack()[0](self._K.T)
        self._corner[:] = 0.0

    def improve(self, xy: Array) -> None:
        """Make x and its multipliers (n + m,) exact, in place."""
        dgetrs, wanted = _lapack()[1], self._wanted
        settled = _SETTLED**2 * wanted.dot(wanted)
        for _ in range(_REPETITIONS):
            left = wanted - self._K.dot(xy)
            xy += dgetrs(self._factor, self._pivots, left)[0]
            if left.dot(left) <= settled:
                break

    def _make(self, n: int, m: int) -> None:
        self._sizes = n, m
        self._K, self._wanted = np.zeros((n + m, n + m)), np.zeros(n + m)
        self._H, self._G, self._GT = self._K[:n, :n], self._K[n:, :n], self._K[:n, n:]
        self._corner = diagonal_of(self._K)[n:]


@cache
def _lapack() -> tuple[Any, Any]:
    # imported here: scipy.linalg takes as long to import as Pinocchio
    from scipy.linalg.lapack import dgetrf, dgetrs

    return dgetrf, dgetrs
