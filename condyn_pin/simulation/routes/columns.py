"""Columns: what the end of a step is differentiated by, and where each part stands."""

from __future__ import annotations

import numpy as np

from condyn_pin._core.arrays import Array, Indices


class Columns:
    """The columns of all derivatives of a step: q, v, tau, friction, restitution and solref."""

    def __init__(self, nv: int, cones: int) -> None:
        self.nv, self.cones = nv, cones
        self.q, self.v, self.tau = (slice(i * nv, (i + 1) * nv) for i in range(3))
        self.friction: Indices = 3 * nv + np.arange(cones)
        self.restitution: Indices = self.friction + cones
        self.solref = slice(3 * nv + 2 * cones, 3 * nv + 2 * cones + 2)
        self.size = 3 * nv + 2 * cones + 2

    def empty(self, rows: int | None = None) -> Array:
        """Return zeros (rows, columns), nv rows by default."""
        return np.zeros((self.nv if rows is None else rows, self.size))
