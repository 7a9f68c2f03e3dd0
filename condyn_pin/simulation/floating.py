"""Floating bodies: their velocities in axes that stand still while they turn.

Pinocchio has the linear velocity u of a free-flyer in the axes of its body, which turn with w.
Along a step they are left where they are: a step begins with u and ends with u', both in them, and

    R^T (R u)' = du/dt + w x u,    p+ = p + dt R u',    u+ = exp(-dt w) u'.

What is not pushed then flies straight, and a ball rolls as fast as it did. In axes that turn,
u+ = u - dt w x u is longer than u by (dt w)^2 / 2 of it in each step: a ball of 5 cm that rolls at
3 m/s would be twice as fast after 0.4 s in steps of 1 ms.
"""

from __future__ import annotations

from math import cos, hypot, isfinite, nan, sin
from typing import Any

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array


class Floating:
    """The free-flyers and planar joints of a model; other joints go through unchanged."""

    def __init__(self, model: Any) -> None:
        self._model = model
        joints = [(j.shortname(), j.idx_q, j.idx_v) for j in list(model.joints)[1:]]
        self._bodies = [(q, v) for name, q, v in joints if name == "JointModelFreeFlyer"]
        self._planar = [(q, v) for name, q, v in joints if name == "JointModelPlanar"]

    def turned(self, v: Array, dt: float) -> Array:
        """Return v (nv,) in the axes that bodies have after dt."""
        turned = v.copy()
        for _, i in self._bodies:
            x, y, z, a, b, c = v[i : i + 6].tolist()
            x, y, z = _rotated(*_quaternion(-dt * a, -dt * b, -dt * c), x, y, z)
            turned[i], turned[i + 1], turned[i + 2] = x, y, z
        for _, i in self._planar:
            x, y, w = v[i : i + 3].tolist()
            angle = _finite(dt * w)
            c, s = cos(angle), sin(angle)
            turned[i : i + 2] = c * x + s * y, c * y - s * x
        return turned

    def turning(self, v: Array) -> Array:
        """Return w x u of each body (nv,), zero elsewhere: how fast u changes by turning axes."""
        turning = np.zeros(len(v))
        for _, i in self._bodies:
            x, y, z, a, b, c = v[i : i + 6].tolist()
            turning[i], turning[i + 1], turning[i + 2] = b * z - c * y, c * x - a * z, a * y - b * x
        for _, i in self._planar:
            x, y, w = v[i : i + 3].tolist()
            turning[i : i + 2] = -w * y, w * x
        return turning

    def rows_before(self, J: Array, v: Array, dt: float) -> Array:
        """Return rows (m, nv) after dt, for velocities in the axes that bodies have before it."""
        if not self._bodies and not self._planar:
            return J
        J = J.copy()
        for _, i in self._bodies:
            turn = pin.exp3(-dt * v[i + 3 : i + 6])
            J[:, i : i + 3] = J[:, i : i + 3].dot(turn)
            J[:, i + 3 : i + 6] = J[:, i + 3 : i + 6].dot(turn)
        for _, i in self._planar:
            angle = _finite(dt * float(v[i + 2]))
            c, s = cos(angle), sin(angle)
            x, y = J[:, i].copy(), J[:, i + 1].copy()
            J[:, i], J[:, i + 1] = c * x - s * y, s * x + c * y
        return J

    def integrate(self, q: Array, dq: Array) -> Array:
        """Return q moved along dq (nv,), bodies on straight lines."""
        moved: Array = pin.integrate(self._model, q, dq)
        for k, i in self._bodies:
            x, y, z, *turn = q[k : k + 7].tolist()
            a, b, c = _rotated(*turn, *dq[i : i + 3].tolist())
            moved[k], moved[k + 1], moved[k + 2] = x + a, y + b, z + c
        for k, i in self._planar:
            (x, y), (c, s) = dq[i : i + 2].tolist(), q[k + 2 : k + 4].tolist()
            moved[k : k + 2] = q[k] + c * x - s * y, q[k + 1] + s * x + c * y
        return moved


# Numbers one by one: Pinocchio's take twice as long, to come into Python and to leave it.


def _rotated(
    qx: float, qy: float, qz: float, qw: float, x: float, y: float, z: float
) -> tuple[float, float, float]:
    """Return a vector turned by a unit quaternion: u + w t + r x t, with t = 2 r x u."""
    tx, ty, tz = 2 * (qy * z - qz * y), 2 * (qz * x - qx * z), 2 * (qx * y - qy * x)
    return (
        x + qw * tx + (qy * tz - qz * ty),
        y + qw * ty + (qz * tx - qx * tz),
        z + qw * tz + (qx * ty - qy * tx),
    )


def _quaternion(x: float, y: float, z: float) -> tuple[float, float, float, float]:
    """Return the unit quaternion of a rotation vector [rad]."""
    half = _finite(0.5 * hypot(x, y, z))
    share = 0.5 * sin(half) / half if half else 0.5
    return share * x, share * y, share * z, cos(half)


def _finite(angle: float) -> float:
    """Return an angle, NaN if it is infinite: Python raises for sin and cos of infinity."""
    return angle if isfinite(angle) else nan
