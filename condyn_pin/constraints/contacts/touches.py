"""Contact points over planes, all of a scene at once.

    gap = n . (p - o) - radius,        contact point = p - radius n
    J   = E^T (J_v - [contact point] J_w),        d gap/dt = n . (J v)

p the middle of a point, o and E = (t1, t2, n) of its plane. J is that of the material point of the
body which is at the contact point, against that of the ground: both bodies count, and what carries
both of them does not.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.constraints.contacts.bound import Touch
from condyn_pin.constraints.contacts.placements import Placements

# The coordinates y, z, x and z, x, y.
_NEXT, _LAST = [1, 2, 0], [2, 0, 1]


class Touches:
    """Contact points over planes of one model, together; not to be shared between threads.

    Attributes
    ----------
    size : int
        Number of contact points, k.
    """

    def __init__(self, model: Any, touches: Sequence[Touch]) -> None:
        self.size = k = len(touches)
        self._placements = Placements(joint for t in touches for joint in (t.joint, t.ground))
        # columns: middles (k), axes (3 k), points of the planes (k)
        self._local = np.zeros((self._placements.size, 5 * k))
        for i, t in enumerate(touches):
            body, ground = self._placements.rows(t.joint), self._placements.rows(t.ground)
            self._local[body, i] = (*t.centre, 1.0)
            self._local[ground, k + 3 * i : k + 3 * i + 3] = t.plane.homogeneous[:, :3]
            self._local[ground, 4 * k + i] = (*t.plane.translation, 1.0)
        self._radius = np.array([t.radius for t in touches])
        self._joints = [t.joint for t in touches], [t.ground for t in touches]
        self._moves = np.repeat(
            [columns(model, t.joint) - columns(model, t.ground) for t in touches], 3, axis=0
        ).reshape(3 * k, model.nv)

    def gaps(self, data: Any) -> Array:
        """Return the signed distances (k,) [m]; reads data.oMi."""
        centres, axes, origins = self._world(data)
        return self._gaps(centres, axes[:, 2::3], origins)

    def points(self, data: Any) -> Array:
        """Return the contact points (k, 3) [m]."""
        centres, axes, _ = self._world(data)
        return (centres - self._radius * axes[:, 2::3]).T

    def axes(self, data: Any) -> Array:
        """Return t1, t2, n of each contact point as columns (k, 3, 3)."""
        return self._world(data)[1].reshape(3, self.size, 3).transpose(1, 0, 2)

    def evaluate(self, data: Any) -> tuple[Array, Array]:
        """Return gaps (k,) and the rows t1, t2, n of each point (3 k, nv); reads data.J too."""
        centres, axes, origins = self._world(data)
        normals = axes[:, 2::3]
        J = data.J.reshape(6, -1)  # a single column comes as a vector
        rows = relative_rows(centres - self._radius * normals, axes, J, self._moves)
        return self._gaps(centres, normals, origins), rows

    def rows(self, data: Any) -> Array:
        """Return the rows of `evaluate` alone (3 k, nv)."""
        return self.evaluate(data)[1]

    def drift(self, data: Any) -> Array:
        """Return Jdot v in the rows of `evaluate` (3 k,) [m/s^2].

        Reads what forward kinematics with a = 0 leaves in data. With the velocity field v_0 + w x p
        of each body, those of the ground marked g, and a place p that moves with the middle of the
        contact point, u = v_0 + w x p - v_0g - w_g x p is the slip, and

            d(E^T u)/dt = E^T (v_0' + w' x p + w x p' - the same of the ground - w_g x u).
        """
        centres, axes, _ = self._world(data)
        normals, r = axes[:, 2::3].T, self._radius[:, None]
        (v, w, dv, dw), (v_g, w_g, dv_g, dw_g) = (_fields(data, its) for its in self._joints)
        p = centres.T - r * normals
        rate = v + _cross(w, centres.T) - r * _cross(w_g, normals)
        slip = v - v_g + _cross(w - w_g, p)
        bias = dv - dv_g + _cross(dw - dw_g, p) + _cross(w - w_g, rate) - _cross(w_g, slip)
        return np.asarray(np.einsum("xka,kx->ka", axes.reshape(3, self.size, 3), bias).ravel())

    def _gaps(self, centres: Array, normals: Array, origins: Array) -> Array:
        above = (centres - origins) * normals
        return above[0] + above[1] + above[2] - self._radius  # type: ignore[no-any-return]

    def _world(self, data: Any) -> tuple[Array, Array, Array]:
        """Return middles (3, k), axes (3, 3 k) and points of the planes (3, k) in the world."""
        world, k = self._placements.read(data).dot(self._local), self.size
        return world[:, :k], world[:, k : 4 * k], world[:, 4 * k :]


def _cross(a: Array, b: Array) -> Array:
    """Return a x b, row by row (k, 3): numpy's own takes ten times as long for a few rows."""
    return np.asarray(a[:, _NEXT] * b[:, _LAST] - a[:, _LAST] * b[:, _NEXT])


def _fields(data: Any, joints: Sequence[int]) -> Array:
    """Return v_0, w and their rates without accelerations, of each joint (4, k, 3); world axes."""
    fields = {0: np.zeros(12)}  # the world stands still
    for j in set(joints) - {0}:
        at = data.oMi[j]
        fields[j] = np.concatenate((at.act(data.v[j]).vector, at.act(data.a[j]).vector))
    found = np.reshape([fields[j] for j in joints], (len(joints), 4, 3))
    return np.asarray(found.transpose(1, 0, 2))


def relative_rows(points: Array, axes: Array, J: Array, moves: Array) -> Array:
    """Return d . (velocity of the points of one body against another), a row for each axis d.

    Parameters
    ----------
    points : (3, k) array
        In the world [m].
    axes : (3, 3 k) array
        Three unit vectors a point, in the world.
    J : (6, nv) array
        Of all joints in the world's axes and at its origin: `data.J`.
    moves : (3 k, nv) array
        Which columns move the body (1), and which the other (-1).
    """
    x, y, z = points[:, :, None]
    dx, dy, dz = along = axes.reshape(3, -1, 3)
    twist = np.empty((6, *along.shape[1:]))
    twist[:3] = along
    twist[3] = y * dz - z * dy
    twist[4] = z * dx - x * dz
    twist[5] = x * dy - y * dx
    return np.asarray(twist.reshape(6, -1).T.dot(J) * moves)


def columns(model: Any, joint: int) -> Array:
    """Return 1 for each coordinate of v that moves a joint (nv,), and 0 for the others."""
    moves = np.zeros(model.nv)
    for j in list(model.supports[joint])[1:]:
        moves[model.idx_vs[j] : model.idx_vs[j] + model.nvs[j]] = 1.0
    return moves
