"""How the rows of all balls between two bodies change with q and v, at fixed accelerations.

In axes of the world. `pin.computeRNEADerivatives` leaves a column a joint coordinate, linear part
at the world's origin: J, dV, dA and dA_v, the parts in the axes of the body of what q and v do to
the velocity and the acceleration of every body that moves with it. A point at p with the velocity
p' has, of each of them, lin + ang x p; and since its acceleration is the classical one,

    J         J_lin + J_ang x p
    v_q       dV_lin + dV_ang x p
    a_q       dA_lin + dA_ang x p + 2 dV_ang x p'
    a_v       dA_v_lin + dA_v_ang x p + 2 J_ang x p'

one product for the points of all loops, [1, -p x, -2 p' x] with the columns. The rows are the
difference of two points in the axes of c1. With Ja the angular part of J, body 1's less body 2's,

    s_q = R1^T (a1_q - a2_q - a2 x Ja),         s_v = R1^T (a1_v - a2_v),
    v_q = R1^T (v1_q - v2_q - v2 x Ja),         c_q = R1^T (J1 - J2 - (p2 - p1) x Ja_1),

and the force F = R1 lam, fixed in c1, turns on body 2: J^T lam changes by J2^T F x Ja.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.constraints.baumgarte import Baumgarte
from condyn_pin.constraints.rows.any_bound import AnyBound
from condyn_pin.constraints.rows.bound import Bound
from condyn_pin.constraints.rows.ends import Ends
from condyn_pin.constraints.rows.frames import rows_of
from condyn_pin.constraints.rows.rolling import skews


class BallPartials:
    """The partials of all balls between two bodies in one scene.

    `data` holds `oMi` for `apply`, and what `pin.computeRNEADerivatives` leaves for the others.
    """

    def __init__(
        self, model: Any, data: Any, bounds: Sequence[AnyBound], drift: Baumgarte | None
    ) -> None:
        self._data, self._drift, n = data, drift, model.nv
        self._bounds = balls = [b for b in bounds if isinstance(b, Bound) and b.is_ball]
        self.k = k = len(balls)
        self.joints = {j for b in balls for j in (b.joint1, b.joint2)}
        self._rows, self._ends = rows_of(balls), Ends(data, balls)
        # which columns move the bodies of c1, and those of c2
        self._moved = np.zeros((2, k, 1, 1, n))
        for i, b in enumerate(balls):
            for end, joint in enumerate((b.joint1, b.joint2)):
                for above in list(model.supports[joint])[1:]:
                    at = model.idx_vs[above]
                    self._moved[end, i, ..., at : at + model.nvs[above]] = 1.0
        self._turned = self._moved[0, :, 0] - self._moved[1, :, 0]  # (k, 1, nv)
        self._columns = np.zeros((9, 4, n))  # lin and ang of J, dV, dA and dA_v; ang of dV and J
        self._points = np.zeros((3, 2 * k, 3))  # p, p' and p'' of the ends
        self._crosses = np.tile(np.eye(3, 9), (2 * k, 1, 1))  # 1, -p x and -2 p' x

        ends = [b.placement1 for b in balls] + [b.placement2 for b in balls]
        self._on_ends = [b.joint1 for b in balls] + [b.joint2 for b in balls]
        self._duals = np.array([c.toDualActionMatrix()[:, :3] for c in ends]).reshape(-1, 6, 3)

    def apply(self, lam: Array, on_joint: Mapping[int, Array]) -> None:
        """Add the forces to the wrenches on the joints."""
        R, _ = self._ends.apart()
        on1 = lam[self._rows].reshape(-1, 1, 3)
        forces = np.concatenate([on1, -on1 @ R]).swapaxes(1, 2)
        for joint, wrench in zip(self._on_ends, (self._duals @ forces)[..., 0], strict=True):
            on_joint[joint][:] += wrench

    def write(self, lam: Array, rhs: Array, J: Array) -> None:
        """Write the rows into J (m, nv) and -[s_q, s_v], and add the turning of J^T lam to -r_q."""
        n, rows, of = J.shape[1], self._rows, self._evaluate()
        of_J, v_q, s_q, s_v = of.parts.reshape(-1, 4, n).swapaxes(0, 1)
        if self._drift:
            s_q = s_q + self._drift.Kp * self._c_q(of_J, of.axes) + self._drift.Kd * v_q
        J[rows], rhs[n:, :n][rows], rhs[n:, n:][rows] = of_J, -s_q, -s_v
        F = (lam[rows].reshape(-1, 1, 3) @ of.axes)[:, 0]
        rhs[:n, :n] += of.J2.reshape(-1, n).T @ (skews(F) @ of.Ja).reshape(-1, n)

    def turning(self, out: Array) -> None:
        """Write v_q (m, nv) of these rows."""
        out[self._rows] = self._evaluate().parts[:, :, 1].reshape(-1, out.shape[1])

    def _c_q(self, J: Array, axes: Array) -> Array:
        """Return the partials of the violation (3 k, nv), right after `_evaluate`."""
        p1, p2 = self._points[0].reshape(2, self.k, 3)
        Ja_1 = self._moved[0, :, 0] * self._columns[3:6, 0]
        return np.asarray(J - (axes @ skews(p2 - p1) @ Ja_1).reshape(J.shape))

    def _evaluate(self) -> _Rows:
        data, k, columns, crosses = self._data, self.k, self._columns, self._crosses
        J, A_v = data.J, data.dAdv
        columns[:6, 0], columns[:6, 2], columns[:6, 3] = J, data.dAdq, A_v
        dV = np.subtract(A_v, data.dJ, out=columns[:6, 1])
        columns[6:, 2], columns[6:, 3] = dV[3:], J[3:]
        E, x = self._ends.placements().reshape(2 * k, 4, 3), self._points
        axes = E[:, :3]
        x[0] = E[:, 3]
        np.matmul(self._ends.linear().reshape(2, 2 * k, 1, 3), axes, out=x[1:, :, None])
        p_v_a = skews(x)
        crosses[:, :, 3:6], crosses[:, :, 6:] = -p_v_a[0], -2 * p_v_a[1]
        points = crosses.reshape(-1, 9) @ columns.reshape(9, -1)
        points = points.reshape(2, k, 3, 4, -1) * self._moved
        slip, Ja = points[0] - points[1], self._turned * J[3:]
        slip[:, :, 1:3] -= (p_v_a[1:, k:] @ Ja).transpose(1, 2, 0, 3)
        rows = (axes[:k] @ slip.reshape(k, 3, -1)).reshape(slip.shape)
        return _Rows(rows, axes[:k], points[1, :, :, 0], Ja)


class _Rows(NamedTuple):
    """Partial derivatives of the rows of k balls, and what they are made of."""

    parts: Array  # (k, 3, 4, nv), in the axes of c1: J and v_q, s_q, s_v
    axes: Array  # (k, 3, 3), those of c1 in the world, one a row
    J2: Array  # (k, 3, nv), of the point on body 2, in the world
    Ja: Array  # (k, 3, nv), of the turn of body 1 past body 2, in the world
