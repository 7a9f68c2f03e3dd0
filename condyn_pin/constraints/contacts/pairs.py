"""Pairs of bodies of a scene, each with a fixed number of places for the points where they meet.

A place without a point has an infinite gap, and the rows of the last one that has. Shapes that are
further apart than their own sizes are taken for the balls round them, whose gap is a bound from
below: features are looked for where it is worth while.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core.arrays import Array
from condyn_pin.constraints.contacts.bound import Pair
from condyn_pin.constraints.contacts.cores import lengths_of
from condyn_pin.constraints.contacts.meetings import Meetings, meetings
from condyn_pin.constraints.contacts.placements import Placements
from condyn_pin.constraints.contacts.touches import columns, relative_rows
from condyn_pin.constraints.with_world import plane


class Pairs:
    """Pairs of shapes of one model, evaluated together; not to be shared between threads.

    Attributes
    ----------
    size : int
        Number of places of all pairs, k.
    """

    def __init__(self, model: Any, pairs: Sequence[Pair]) -> None:
        self._pairs = tuple(pairs)
        self.size = sum(pair.points for pair in pairs)
        rows = [
            columns(model, pair.joint) - columns(model, pair.ground)
            for pair in pairs
            for _ in range(3 * pair.points)
        ]
        self._moves = np.reshape(rows, (3 * self.size, model.nv))
        self._placements = Placements(j for pair in pairs for j in (pair.joint, pair.ground))
        # columns: the middles of the shapes, two a pair
        self._middles = np.zeros((self._placements.size, 2 * len(pairs)))
        for i, pair in enumerate(pairs):
            for column, joint, at in (
                (2 * i, pair.joint, pair.placement),
                (2 * i + 1, pair.ground, pair.ground_placement),
            ):
                self._middles[self._placements.rows(joint), column] = (*at.translation, 1.0)
        self._reaches = np.array([pair.shape.reach + pair.ground_shape.reach for pair in pairs])
        self._at = np.full((3, self._placements.size), np.nan)
        self._found: tuple[Array, Array, Array] = np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3, 3))
        self._far = np.zeros(len(pairs), bool)

    def gaps(self, data: Any) -> Array:
        """Return the signed distances (k,) [m]; reads data.oMi."""
        return self._evaluated(data)[0]

    def points(self, data: Any) -> Array:
        """Return the contact points (k, 3) [m]."""
        return self._evaluated(data)[1]

    def axes(self, data: Any) -> Array:
        """Return t1, t2, n of each place as columns (k, 3, 3)."""
        return self._evaluated(data)[2]

    def are_balls(self, data: Any) -> NDArray[np.bool_]:
        """Return which pairs are so far apart that the balls round their shapes meet instead."""
        self._evaluated(data)
        return self._far

    def jacobian(self, data: Any) -> Array:
        """Return the rows t1, t2, n of each place (3 k, nv); reads data.oMi and data.J."""
        _, points, axes = self._evaluated(data)
        J = data.J.reshape(6, -1)  # a single column comes as a vector
        return relative_rows(points.T, axes.transpose(1, 0, 2).reshape(3, -1), J, self._moves)

    def _evaluated(self, data: Any) -> tuple[Array, Array, Array]:
        """Return gaps, points and axes; the last ones where no body has moved since."""
        now = self._placements.read(data)
        if not np.array_equal(now, self._at):
            middles = now.dot(self._middles).T.reshape(-1, 2, 3)
            apart, normals = lengths_of(middles[:, 0] - middles[:, 1])
            self._far = apart > 2.0 * self._reaches
            found = [
                _as_balls(pair, middle[0], normal, gap) if away else _closely(pair, data)
                for pair, middle, normal, gap, away in zip(
                    self._pairs, middles, normals, apart - self._reaches, self._far, strict=True
                )
            ]
            filled = map(_filled, found, (pair.points for pair in self._pairs))
            gaps, points, normals = (np.concatenate(parts) for parts in zip(*filled, strict=True))
            self._found = gaps, points, np.array([plane(n, 0.0).rotation for n in normals])
            self._at[:] = now
        return self._found


def _closely(pair: Pair, data: Any) -> Meetings:
    """Return where the features of two shapes meet."""
    return meetings(
        pair.shape.placed(data.oMi[pair.joint] * pair.placement),
        pair.ground_shape.placed(data.oMi[pair.ground] * pair.ground_placement),
    )


def _as_balls(pair: Pair, middle: Array, normal: Array, gap: float) -> Meetings:
    """Return where the balls round two shapes meet: none is nearer, and most pairs are far."""
    point = middle - pair.shape.reach * normal
    return Meetings(np.array([gap]), point[None], normal[None])


def _filled(found: Meetings, points: int) -> Meetings:
    """Return what was found, and places without a point behind it."""
    count = len(found.gaps)
    filled = found.taken(np.minimum(np.arange(points), count - 1))
    filled.gaps[count:] = np.inf
    return filled
