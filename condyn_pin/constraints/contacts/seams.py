"""Seams: which contacts of a piece lie where another piece of the same body covers it.

Boxes side by side make a floor, and nothing meets the faces and edges between them. A contact at x
of a piece, with the outward normal n, is one of all pieces together if the ball that touches at x
from outside touches no other,

    height of x + eps n over another piece  >=  eps,

or if all of the other is behind the plane n . y = n . x, or if the piece goes on past the surface
of the other, as a wall does above its floor: then it is there behind x, where x is lifted along the
normal m of that surface,

    x + (eps - height of x along m) m - eps n / 2    in the piece.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core.arrays import Array
from condyn_pin.constraints.contacts.shapes import Core

# Width of a seam, and height of a step, below which pieces count as flush [m]; and the same as a
# share of the size of a piece that is small.
WIDTH: Final = 1e-4
_SHARE: Final = 1e-2

# Rounding of a height, and how far off another piece a point counts as on it, as shares of that.
_ROUNDING: Final = 1e-9
_ON: Final = 1e-3

# Cosines between normals of faces that look at each other, and of faces side by side.
_FACING: Final = -0.5
_LEVEL: Final = 0.99

Solid = tuple[Array, Array, Array]  # normals (f, 3), heights (f,), corners (k, 3) [m]


def is_hidden(x: Array, n: Array, eps: float, own: Solid | None, other: Solid) -> NDArray[np.bool_]:
    """Flag of each point x (k, 3) of a piece, with outward normals n: covered by another.

    Of a piece that is not convex, its own faces are None: it goes on wherever it may.
    """
    normals, heights, corners = other
    at = x.dot(normals.T) - heights  # (k, faces)
    cosines = n.dot(normals.T)
    off = at + eps * cosines
    touched = off.max(axis=1) < (1.0 - _ROUNDING) * eps
    if not touched.any():
        return np.asarray(touched)
    if len(corners):
        behind = n.dot(corners.T).max(axis=1) - (n * x).sum(axis=1)
        touched &= behind > _ROUNDING * (1.0 + np.abs(x).max(axis=1))
    off[cosines < _FACING] = -np.inf
    face = (np.arange(len(x)), off.argmax(axis=1))
    goes_on = np.ones(len(x), dtype=bool)
    if own is not None:
        lifted = x + (eps - at[face])[:, None] * normals[face[1]] - 0.5 * eps * n
        goes_on = (lifted.dot(own[0].T) < own[1]).all(axis=1)
    is_level = cosines[face] > _LEVEL
    free = np.where(is_level, at.max(axis=1) > _ON * eps, goes_on)
    free &= np.isfinite(off[face])  # all of it looks this way
    return np.asarray(touched & ~free)


class Piece:
    """A solid of a body, and its neighbours on this body, in the axes of its joint.

    Parameters
    ----------
    core : Core
    others : sequence of Core
        Solids of the same joint.
    """

    def __init__(self, core: Core, others: Sequence[Core]) -> None:
        self._core, self._width = core, min(WIDTH, _SHARE * core.size)
        self._beside = [other for other in others if _is_beside(core, other, self._width)]

    @property
    def has_seams(self) -> bool:
        """True if the piece has a neighbour."""
        return bool(self._beside)

    def hides(self, x: Array, n: Array) -> NDArray[np.bool_]:
        """Flag of each point x (k, 3), with outward normals n: covered by a neighbour."""
        hidden, own = np.zeros(len(x), dtype=bool), _solid(self._core)
        for other in self._beside:
            hidden |= is_hidden(x, n, self._width, own, _solid(other))
        return hidden


def _solid(core: Core) -> Solid:
    return core.normals, core.heights, core.vertices


def _is_beside(core: Core, other: Core, width: float) -> bool:
    """True if the axis-aligned boxes round two different solids touch within a width."""
    if not (core.is_solid and other.is_solid) or np.array_equal(core.vertices, other.vertices):
        return False
    (low, high), (lowest, highest) = (
        (c.vertices.min(axis=0), c.vertices.max(axis=0)) for c in (core, other)
    )
    return bool((low <= highest + 2 * width).all() and (lowest <= high + 2 * width).all())
