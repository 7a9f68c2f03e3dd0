"""Columns: what the end of a step is differentiated by, and where each part stands.

Within a step q stands for where its equations are taken, and v and tau are theirs (`Starts`).
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core.arrays import Array, Indices

# What the end of a step may depend on, beside its start and the torques.
PARAMETERS: Final = ("friction", "restitution", "solref", "inertias")


class Columns:
    """The columns of all derivatives of a step: q, v, tau, and each of `PARAMETERS`.

    Inertias have none, unless there are `inertias` of them that are asked for.
    """

    def __init__(self, nv: int, cones: int, inertias: int = 0) -> None:
        self.nv, self.cones = nv, cones
        self.q, self.v, self.tau = (slice(i * nv, (i + 1) * nv) for i in range(3))
        self.friction = slice(3 * nv, 3 * nv + cones)
        self.restitution = slice(3 * nv + cones, 3 * nv + 2 * cones)
        self.solref = slice(3 * nv + 2 * cones, 3 * nv + 2 * cones + 2)
        first = 3 * nv + 2 * cones + 2
        self.inertias, self.size = slice(first, first + inertias), first + inertias

    def of(self, parameter: str) -> slice:
        """Return the columns of one of `PARAMETERS`, or of tau."""
        found: slice = getattr(self, parameter)
        return found

    def of_cones(self, parameter: str, cones: NDArray[np.bool_] | slice) -> slice | Indices:
        """Return the columns of friction or restitution of some cones, by flags, or of all."""
        of_all = self.of(parameter)
        return of_all if isinstance(cones, slice) else np.arange(of_all.start, of_all.stop)[cones]

    def empty(self, rows: int | None = None) -> Array:
        """Return zeros (rows, columns), nv rows by default."""
        return np.zeros((self.nv if rows is None else rows, self.size))
