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
does for all points: [1, -p x, -2 p' x, -p2' x, -p2'' x] of either end with the columns that each of
them meets. On the world all of body 2 is zero.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.baumgarte import Baumgarte
from condyn_pin.constraints.rows.any_bound import AnyBound
from condyn_pin.constraints.rows.bound import Bound
from condyn_pin.constraints.rows.ends import Ends
from condyn_pin.constraints.rows.frames import rows_of
from condyn_pin.constraints.rows.rolling import skews


def _factors_by_place() -> Array:
    """Return the map (13, 45) of 1, p, p', p2' and p2'' to [1, -p x, -2 p' x, -p2' x, -p2'' x]."""
    of = np.zeros((13, 3, 15))
    of[0, :, :3] = np.eye(3)
    for block, times in enumerate((1.0, 2.0, 1.0, 1.0)):
        at = 3 * block
        for i, e in enumerate(np.eye(3)):
            of[1 + at + i, :, 3 + at : 6 + at] = -times * pin.skew(e)
    return of.reshape(13, 45)


_FACTORS: Final = _factors_by_place()


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
        self._signs = np.array([b.sign for b in points]).reshape(k, 1, 1)
        self._anchored = np.array([float(b.anchored) for b in points]).reshape(k, 1, 1)
        # which columns move the bodies of c1, and those of c2
        self._moved = _moved(model, points) * self._signs[:, :, None]
        self._turned = (self._moved[0] - self._moved[1])[:between, 0]  # (between, 1, nv)
        # J and v_q as they are; s_q and s_v are asked for with the other sign
        self._chosen = self._moved * np.array([1.0, 1.0, -1.0, -1.0])[:, None]
        # what 1, p x, 2 p' x, p2' x and p2'' x meet, for J, v_q, s_q and s_v each
        self._columns = np.zeros((15, 4, model.nv))
        self._places = np.ones((2, k, 13))  # 1, p and p' of each end, p' and p'' of c2

    def write(self, lam: Array, rhs: Array, J: Array) -> None:
        """Write the rows into J (m, nv) and -[s_q, s_v], and add the turning of J^T lam to -r_q."""
        n, between, of = self._n, self.between, self._evaluate()
        J[self._rows] = of.parts[:, :, 0].reshape(-1, n)
        rhs[self._below] = of.parts[:, :, 2:].reshape(-1, 2 * n)
        if self._drift:
            by_q = self._drift.Kp * self._c_q(of) + self._drift.Kd * of.parts[:, :, 1]
            rhs[:, :n][self._below] -= by_q.reshape(-1, n)
        if between:
            F = (self._forces(lam)[:between] @ of.axes[:between])[:, 0]
            turning = skews(F).reshape(-1, 3).dot(self._left[0][3:]).reshape(-1, 3, n)
            turning *= self._turned  # F x Ja
            rhs[:n, :n] += of.J2[:between].reshape(-1, n).T.dot(turning.reshape(-1, n))

    def turning(self, out: Array) -> None:
        """Write v_q (m, nv) of these rows."""
        out[self._rows] = self._evaluate().parts[:, :, 1].reshape(-1, self._n)

    def _forces(self, lam: Array) -> Array:
        """Return the forces on body 1 (k, 1, 3), in the axes of c1."""
        return np.asarray(lam[self._rows].reshape(-1, 1, 3) * self._signs)

    def _c_q(self, of: _Rows) -> Array:
        """Return the partials of the violation (k, 3, nv), zero without an anchor."""
        p1, p2 = self._places[:, :, 1:4]
        Ja_1 = self._moved[0, :, 0] * self._left[0][3:]
        turned = of.axes @ skews(p2 - p1) @ Ja_1
        return np.asarray(self._anchored * (of.parts[:, :, 0] - turned))

    def _evaluate(self) -> _Rows:
        k, n, columns, x = self.k, self._n, self._columns, self._places
        self._gather()
        E = self._ends.placements()
        x[..., 1:4] = E[:, :, 3]
        motion = (self._ends.linear()[..., None, :] @ E[:, :, :3])[..., 0, :]
        x[..., 4:7] = motion[0]
        x[..., 7:10], x[..., 10:] = motion[:, 1]
        factors = x.reshape(-1, 13).dot(_FACTORS).reshape(-1, 15)
        points = factors.dot(columns.reshape(15, -1)).reshape(2, k, 3, 4, n)
        points *= self._chosen
        slip = (points[0] - points[1]).reshape(k, 3, -1)
        axes = E[0, :, :3]
        return _Rows((axes @ slip).reshape(k, 3, 4, n), axes, points[1, :, :, 0])

    def _gather(self) -> None:
        """Copy what the derivatives of Newton-Euler left behind."""
        J, dJ, A_q, A_v = self._left
        columns = self._columns
        columns[:6, 0], columns[:6, 2], columns[:6, 3] = J, A_q, A_v
        dV = np.subtract(A_v, dJ, out=columns[:6, 1])
        columns[6:9, 2] = dV[3:]
        columns[6:9, 3] = columns[9:12, 1] = columns[12:, 2] = J[3:]


class _Rows(NamedTuple):
    """Partial derivatives of the rows of k points, and what they are made of."""

    parts: Array  # (k, 3, 4, nv), in the axes of c1: J and v_q, -s_q, -s_v
    axes: Array  # (k, 3, 3), those of c1 in the world, one a row
    J2: Array  # (k, 3, nv), of the point on body 2, in the world


def _moved(model: Any, points: Sequence[Bound]) -> Array:
    """Return (2, k, 1, 1, nv): one where a column moves the body of c1, or that of c2."""
    moved = np.zeros((2, len(points), 1, 1, model.nv))
    for i, b in enumerate(points):
        for end, joint in enumerate((b.joint1, b.joint2)):
            for above in list(model.supports[joint])[1:]:
                at = model.idx_vs[above]
                moved[end, i, ..., at : at + model.nvs[above]] = 1.0
    return moved
