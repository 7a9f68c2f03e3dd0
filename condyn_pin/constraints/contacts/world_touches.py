"""Contact points over planes of the world: what a step with contacts evaluates most often.

The normal n and the axes d stand still, so that the gap and the moments of the axes about the
origin are linear in the middle p of a contact point:

    gap = n . p - (n . o + radius),    (p - radius n) x d
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.constraints.contacts.bound import Touch
from condyn_pin.constraints.contacts.touches import Touches


class WorldTouches(Touches):
    """Contact points over planes of the world, together; not to be shared between threads."""

    def __init__(self, model: Any, touches: Sequence[Touch]) -> None:
        super().__init__(model, touches)
        k = self.size
        axes = np.reshape([t.plane.rotation.T for t in touches], (k, 3, 3))  # t1, t2, n as rows
        normals = axes[:, 2]
        crosses = np.cross(axes[:, :, None], -np.eye(3)).transpose(0, 1, 3, 2)  # p -> p x d
        moments = crosses.reshape(k, 9, 3)
        self._middles = self._local[:, :k]
        gaps = self._middles[:, None, :] * normals.T  # (size, 3, k)
        self._gap_of = gaps.reshape(3 * len(self._middles), k)
        heights = [np.dot(t.plane.translation, n) for t, n in zip(touches, normals, strict=True)]
        self._lowest = np.reshape(heights, k) + self._radius
        at_surface = moments @ (self._radius[:, None] * normals)[:, :, None]
        self._moment_of = np.concatenate([moments, -at_surface], axis=2)  # of p and 1
        # memory for p and 1, and for the rows d and p x d, with views into it
        points, twists = np.ones((4, k)), np.concatenate([axes, np.zeros((k, 3, 3))], axis=2)
        self._p, self._points, self._p_and_1 = points[:3], points.T, points.T[:, :, None]
        # points of one radius over parallel planes, as feet on a floor: one product for all
        are_same = k and (self._moment_of == self._moment_of[0]).all()
        self._same = self._moment_of[0].T if are_same else None
        self._rows, self._moments = twists.reshape(-1, 6), twists[:, :, 3:]
        self._data: Any = None

    def gaps(self, data: Any) -> Array:
        """Return the signed distances (k,) [m]; reads data.oMi."""
        now = self._placements.read(data)  # (3, size)
        return now.ravel("K").dot(self._gap_of) - self._lowest  # type: ignore[no-any-return]

    def evaluate(self, data: Any) -> tuple[Array, Array]:
        """Return gaps (k,) and the rows t1, t2, n of each point (3 k, nv); reads data.J too."""
        return self.gaps(data), self.rows(data)

    def rows(self, data: Any) -> Array:
        """Return the rows t1, t2, n of each point (3 k, nv); reads data.oMi and data.J."""
        if self._data is not data:  # a view into the memory of data: to fetch it costs more
            self._data, self._J = data, data.J.reshape(6, -1)
        np.dot(self._placements.read(data), self._middles, out=self._p)
        if self._same is None:
            self._moments[:] = (self._moment_of @ self._p_and_1).reshape(-1, 3, 3)
        else:
            self._moments[:] = self._points.dot(self._same).reshape(-1, 3, 3)
        return np.asarray(self._rows.dot(self._J) * self._moves)
