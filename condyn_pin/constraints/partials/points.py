"""How the rows of all points change with q and v, at fixed accelerations.

A point of one moving body on a point of another, or on one of the world. In axes of the world.
`pin.computeRNEADerivatives` leaves a column a joint coordinate, linear part at the world's origin:
J, dV, dA and dA_v, the parts in the axes of the body of what q and v do to the velocity and the
acceleration of every body that moves with it. A point at p with the velocity p' has, of each of
them, lin + ang x p; and since its acceleration is the classical one,

    J         J_lin + J_ang x p
    v_q       dV_lin + dV_ang x p
    a_q       dA_lin + dA_ang x p + 2 dV_ang x p'
    a_v       dA_v_lin + dA_v_ang x p + 2 J_ang x p'

The rows are the difference of two points in the axes of c1. With Ja the angular part of J, body 1's
less body 2's,

    s_q = R1^T (a1_q - a2_q - a2 x Ja),         s_v = R1^T (a1_v - a2_v),
    v_q = R1^T (v1_q - v2_q - v2 x Ja),         c_q = R1^T (J1 - J2 - (p2 - p1) x Ja_1),

and the force F = R1 lam, fixed in c1, turns on body 2: J^T lam changes by J2^T F x Ja. One product
does for all points: [1, -p x, -p2'' x, -2 p' x, F x] of either end with the columns that each of
them meets, or [1, -p x, -p2' x] where v_q is asked for. On the world all of body 2 is zero.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.baumgarte import Baumgarte
from condyn_pin.constraints.rows.any_bound import AnyBound
from condyn_pin.constraints.rows.bound import Bound
from condyn_pin.constraints.rows.ends import Ends
from condyn_pin.constraints.rows.frames import rows_of
from condyn_pin.constraints.rows.loops import Balls
from condyn_pin.constraints.rows.rolling import skews


def _factors(*times: float) -> Array:
    """Return the map of 1, p, x, ... (3 a block) to [1, -p x, -times x x, ...], three rows each."""
    count = len(times)
    of = np.zeros((1 + 3 * count, 3, 3 + 3 * count))
    of[0, :, :3] = np.eye(3)
    for i, e in enumerate(np.eye(3)):
        for block, factor in enumerate(times):
            of[1 + 3 * block + i, :, 3 + 3 * block : 6 + 3 * block] = -factor * pin.skew(e)
    return of.reshape(len(of), -1)


_ACCELERATED: Final = _factors(1.0, 1.0, 2.0, -1.0)  # of 1, p, p2'', p' and F
_MOVED: Final = _factors(1.0, 1.0)  # of 1, p and p2'


class PointPartials:
    """The partials of all points in one scene.

    `data` holds what `pin.computeRNEADerivatives` leaves.

    Attributes
    ----------
    k, between : int
        How many points there are; of these, how many between two moving bodies.
    """

    def __init__(
        self, model: Any, data: Any, bounds: Sequence[AnyBound], drift: Baumgarte | None
    ) -> None:
        self._data, self._drift, self._n = data, drift, model.nv
        # views into data's own memory; of a single coordinate Pinocchio has vectors
        left = data.J, data.dJ, data.dAdq, data.dAdv
        self._left = tuple(part.reshape(6, model.nv) for part in left)
        points = [b for b in bounds if isinstance(b, Bound) and b.is_point]
        points.sort(key=lambda b: b.joint2 == 0)  # those between two bodies come first
        self.k, self.between = k, between = len(points), sum(b.joint2 > 0 for b in points)
        self._rows, self._ends = rows_of(points), Ends(data, points)
        rows = self._rows
        self._below = (
            slice(rows.start + model.nv, rows.stop + model.nv)
            if isinstance(rows, slice)
            else rows + model.nv
        )
        signs = np.array([b.sign for b in points]).reshape(k, 1, 1, 1)
        self._anchored = np.array([float(b.anchored) for b in points]).reshape(k, 1, 1)
        # which columns move the bodies of c1, and those of c2 where they move
        moves = _moved(model, points)
        moves = np.concatenate((moves[0], moves[1, :between]))
        self._moved = moves * np.concatenate((signs, signs[:between]))
        # s_q and s_v are asked for with the other sign, and F has the sign of lam
        self._chosen = np.concatenate((self._moved, -self._moved, -self._moved, moves), axis=2)
        # what 1, p x, p2'' x, 2 p' x and F x meet, for J, s_q, s_v and F x Ja each
        self._columns = columns = np.zeros((15, 4, model.nv))
        self._places = np.ones((k + between, 13))
        # views of columns, and what goes there
        J, dJ, A_q, A_v = self._left
        self._whole, self._sources = columns[:6, :3].reshape(6, -1), (J, A_q, A_v)
        self._turns = np.einsum("iji...->ij...", columns[6:].reshape(3, 3, 4, -1)[:, :, 1:])
        self._dV = A_v[3:], dJ[3:], columns[9:12, 1]
        # of p, p' and p'' of all ends c1 and then all c2: p and p' of each, p'' of its c2
        end, xyz = np.arange(k + between)[:, None], np.arange(3)
        self._taken = np.hstack([9 * end + xyz, 9 * (k + end % k) + 6 + xyz, 9 * end + 3 + xyz])

    def write(self, lam: Array, rhs: Array, J: Array, balls: Balls | None = None) -> None:
        """Write the rows into J (m, nv) and -[s_q, s_v], and add the turning of J^T lam to -r_q.

        `balls` are where the points are, if all of them were evaluated at this state already.
        """
        n, k, between = self._n, self.k, self.between
        axes, moving = (balls.axes, balls.moving) if balls else self._ends.in_world()
        parts = self._parts(lam, axes[0], moving)
        slip = parts[:k]
        slip[:between] -= parts[k:]
        rows = (axes[0] @ slip.reshape(k, 3, -1)).reshape(3 * k, 4, n)
        J[self._rows], rhs[self._below] = rows[:, 0], rows[:, 1:3].reshape(3 * k, -1)
        if self._drift:
            by_q = self._drift.Kp * self._c_q(axes[0], moving, J)
            by_q += self._drift.Kd * self._v_q(axes[0], moving)
            rhs[:, :n][self._below] -= by_q.reshape(-1, n)
        if between:
            J2, turned = parts[k:, :, 0], slip[:between, :, 3]
            rhs[:n, :n] += J2.reshape(-1, n).T.dot(turned.reshape(-1, n))

    def turning(self, out: Array) -> None:
        """Write v_q (m, nv) of these rows."""
        axes, moving = self._ends.in_world()
        out[self._rows] = self._v_q(axes[0], moving).reshape(-1, self._n)

    def _parts(self, lam: Array, axes: Array, moving: Array) -> Array:
        """Return J, -a_q, -a_v and F x Ja of both ends (k + between, 3, 4, nv), in the world.

        Those of c2 come behind all of c1. Both have their part of a2 x Ja in -a_q.
        """
        np.concatenate(self._sources, axis=1, out=self._whole)
        self._turns[:] = self._left[0][3:]
        A_v, dJ, dV = self._dV
        np.subtract(A_v, dJ, out=dV)
        places, k = self._places, self.k
        places[:, 1:10] = moving.take(self._taken)
        F = (lam[self._rows].reshape(k, 1, 3) @ axes).reshape(k, 3)
        places[:k, 10:], places[k:, 10:] = F, F[: self.between]
        factors = places.dot(_ACCELERATED).reshape(-1, 15)
        parts: Array = factors.dot(self._columns.reshape(15, -1)).reshape(-1, 3, 4, self._n)
        parts *= self._chosen
        return parts

    def _v_q(self, axes: Array, moving: Array) -> Array:
        """Return the partials of J v by q (k, 3, nv)."""
        J, dJ, _, A_v = self._left
        x = self._places[:, :7].copy()
        x[:, 1:4] = moving.reshape(-1, 9)[: len(x), :3]
        x[: self.k, 4:], x[self.k :, 4:] = moving[1, :, 1], moving[1, : self.between, 1]
        columns = np.concatenate((A_v - dJ, J[3:]))
        parts = x.dot(_MOVED).reshape(-1, 9).dot(columns).reshape(-1, 3, self._n)
        parts *= self._moved[:, 0]
        parts[: self.between] -= parts[self.k :]
        return np.asarray(axes @ parts[: self.k])

    def _c_q(self, axes: Array, moving: Array, J: Array) -> Array:
        """Return the partials of the violation (k, 3, nv), zero without an anchor."""
        apart = skews(moving[1, :, 0] - moving[0, :, 0])
        turned = axes @ apart @ (self._moved[: self.k, 0] * self._left[0][3:])
        return np.asarray(self._anchored * (J[self._rows].reshape(self.k, 3, -1) - turned))


def _moved(model: Any, points: Sequence[Bound]) -> Array:
    """Return (2, k, 1, 1, nv): one where a column moves the body of c1, or that of c2."""
    moved = np.zeros((2, len(points), 1, 1, model.nv))
    for i, b in enumerate(points):
        for end, joint in enumerate((b.joint1, b.joint2)):
            for above in list(model.supports[joint])[1:]:
                at = model.idx_vs[above]
                moved[end, i, ..., at : at + model.nvs[above]] = 1.0
    return moved
