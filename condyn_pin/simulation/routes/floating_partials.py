"""How what `Manifold` does to floating bodies changes with what it is given; tangent columns.

    p+ = p + R x, R+ = R exp(y):    dp+ = E^T (dp - x x dtheta + dx),   dtheta+ = E^T dtheta + Jr dy
    u+ = exp(-dt w) u:              du+ = E^T du + dt u+ x Jr dw,    y = dt w

with x and y the two halves of a move, E the rotation that belongs to it, and positions in the axes
of the body.
"""

from __future__ import annotations

from math import cos, sin
from typing import Any

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array

_SKEW = np.array([[0.0, -1.0], [1.0, 0.0]])  # S x is x turned by a quarter


class FloatingPartials:
    """The partials of the `Manifold` of one model."""

    def __init__(self, model: Any) -> None:
        self._model, self._one = model, np.eye(model.nv)
        joints = [(j.shortname(), j.idx_v) for j in list(model.joints)[1:]]
        self._bodies = [i for name, i in joints if name == "JointModelFreeFlyer"]
        self._planar = [i for name, i in joints if name == "JointModelPlanar"]

    def integrate(self, q: Array, dq: Array) -> tuple[Array, Array]:
        """Return the end of a move by its start, and by the move (nv, nv) each."""
        by_q, by_move = pin.dIntegrate(self._model, q, dq)
        for i in self._bodies:
            lin, ang = slice(i, i + 3), slice(i + 3, i + 6)
            by_move[lin, lin] = turn = by_q[lin, lin]
            by_q[lin, ang], by_move[lin, ang] = turn.dot(pin.skew(dq[lin]).T), 0.0
        for i in self._planar:
            x, angle = dq[i : i + 2], float(dq[i + 2])
            turn = _turn(angle).T
            by_q[i : i + 2, i : i + 3] = np.column_stack([turn, turn @ _SKEW @ x])
            by_move[i : i + 2, i : i + 3] = np.column_stack([turn, np.zeros(2)])
        return by_q, by_move

    def turned(self, v: Array, dt: float, by_move: Array) -> Array:
        """Return v in the axes after dt by v (nv, nv); `by_move` is that of `integrate` by dt v."""
        by_v = self._one.copy()
        for i in self._bodies:
            lin, ang = slice(i, i + 3), slice(i + 3, i + 6)
            turn = by_move[lin, lin]
            by_v[lin, lin] = turn
            by_v[lin, ang] = pin.skew(dt * turn.dot(v[lin])).dot(by_move[ang, ang])
        for i in self._planar:
            turn = by_move[i : i + 2, i : i + 2]
            by_v[i : i + 2, i : i + 2] = turn
            by_v[i : i + 2, i + 2] = -dt * _SKEW @ turn @ v[i : i + 2]
        return by_v


def _turn(angle: float) -> Array:
    c, s = cos(angle), sin(angle)
    return np.array([[c, -s], [s, c]])
