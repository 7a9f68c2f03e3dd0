"""Pairs of bodies of a scene, each with a fixed number of places for the points where they meet.

A place without a point has an infinite gap, and the normal of the first one.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.constraints.contacts.bound import Pair
from condyn_pin.constraints.contacts.meetings import Meeting, meetings
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
        self._at: bytes = b""
        self._found: tuple[Array, Array, Array] = np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3, 3))

    def gaps(self, data: Any) -> Array:
        """Return the signed distances (k,) [m]; reads data.oMi."""
        return self._evaluated(data)[0]

    def points(self, data: Any) -> Array:
        """Return the contact points (k, 3) [m]."""
        return self._evaluated(data)[1]

    def axes(self, data: Any) -> Array:
        """Return t1, t2, n of each place as columns (k, 3, 3)."""
        return self._evaluated(data)[2]

    def jacobian(self, data: Any) -> Array:
        """Return the rows t1, t2, n of each place (3 k, nv); reads data.oMi and data.J."""
        _, points, axes = self._evaluated(data)
        return relative_rows(points.T, axes.transpose(1, 0, 2).reshape(3, -1), data.J, self._moves)

    def _evaluated(self, data: Any) -> tuple[Array, Array, Array]:
        """Return gaps, points and axes; the last ones where no body has moved since."""
        placements = [
            data.oMi[joint] * at
            for pair in self._pairs
            for joint, at in ((pair.joint, pair.placement), (pair.ground, pair.ground_placement))
        ]
        now = b"".join(p.rotation.tobytes() + p.translation.tobytes() for p in placements)
        if now != self._at:
            places: list[Meeting] = []
            for pair, one, two in zip(self._pairs, placements[::2], placements[1::2], strict=True):
                places += _filled(pair, one, two)
            self._found = (
                np.array([each.gap for each in places]),
                np.array([each.point for each in places]),
                np.array([plane(tuple(each.normal), 0.0).rotation for each in places]),
            )
            self._at = now
        return self._found


def _filled(pair: Pair, one: Any, two: Any) -> list[Meeting]:
    """Return the points where a pair meets, and places without a point behind them."""
    apart = one.translation - two.translation
    far = float(np.sqrt(apart.dot(apart)))
    reach = pair.shape.reach + pair.ground_shape.reach
    if far > 2.0 * reach:  # as balls round them: what is nearer is looked at closely
        normal = apart / far
        found = [Meeting(far - reach, one.translation - pair.shape.reach * normal, normal)]
    else:
        found = meetings(pair.shape.placed(one), pair.ground_shape.placed(two))
    empty = found[0]._replace(gap=np.inf)
    return found + [empty] * (pair.points - len(found))
