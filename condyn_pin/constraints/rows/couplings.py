"""Couplings: c = q_a - ratio q_b - offset, one row of J with two entries each, and no gamma."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.constraints.rows.bound import Coupled


class Couplings:
    """All couplings of one scene.

    Parameters
    ----------
    bounds : sequence of Coupled
    nv : int
    """

    def __init__(self, bounds: Sequence[Coupled], nv: int) -> None:
        self._rows = np.array([b.rows.start for b in bounds], dtype=np.int_)
        self._a, self._b = np.array([b.configuration for b in bounds], dtype=np.int_).T
        self._ratio = np.array([b.ratio for b in bounds])
        self._offset = np.array([b.offset for b in bounds])
        self._J = np.zeros((len(bounds), nv))
        for row, b in zip(self._J, bounds, strict=True):
            row[list(b.velocity)] = 1.0, -b.ratio

    def evaluate(self, q: Array, v: Array, a: Array, rows: tuple[Array, Array, Array]) -> None:
        """Write c, J v and J a into the three vectors of all rows."""
        c, velocity, acceleration = rows
        c[self._rows] = q[self._a] - self._ratio * q[self._b] - self._offset
        velocity[self._rows] = self._J.dot(v)
        acceleration[self._rows] = self._J.dot(a)

    def torque(self, lam: Array) -> Array:
        """Return J^T lam (nv,) of these rows."""
        return np.asarray(self._J.T.dot(lam[self._rows]))

    def jacobian(self, J: Array) -> None:
        """Write these rows into J (m, nv)."""
        J[self._rows] = self._J
