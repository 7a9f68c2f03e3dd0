"""Rolling: the lowest point of a wheel or of a ball has no velocity.

In the axes of the body, with n the normal of the plane, w its angular velocity, and all that is
fixed in the world turning backwards, n' = n x w:

    wheel with axle e    t = e x n / |e x n|    r = radius e x t
    ball                 t = x of the plane     r = -radius n

The axes of the rows are T = (t, n x t, n), and with the slip of the lowest point s = v + w x r

    J v = T s,        J a + gamma = T s' + T' s,        s' = v' + w' x r + w x r'

v' and w' component by component. The last row is the rate of the point's height, c = n . (r - p),
p a point of the plane.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from condyn_pin._pin import pin
from condyn_pin.arrays import Array
from condyn_pin.rows.bound import Rolled
from condyn_pin.rows.cut_joints import cross, dot
from condyn_pin.rows.ends import Ends
from condyn_pin.rows.frames import FrameJacobian, rows_of

# |e x n| of a wheel that lies flat: it has no lowest point, and rounding would choose one.
FLAT: Final = 1e-12


class Rolling:
    """All that rolls in one scene.

    Parameters
    ----------
    data : pin.Data
    bounds : sequence of Rolled
    """

    def __init__(self, data: Any, bounds: Sequence[Rolled]) -> None:
        self._bounds, self._ends = tuple(bounds), Ends(data, bounds)
        k = len(bounds)
        self._rows = rows_of(bounds)
        chosen = [3 * i + j for i, b in enumerate(bounds) for j in b.selection]
        self._chosen = np.array(chosen, dtype=np.int_)  # of the k x 3 components
        self._radius = np.array([[b.radius] for b in bounds])
        self._axle = np.array(
            [np.zeros(3) if b.axle is None else np.eye(3)[b.axle] for b in bounds]
        )
        self._is_ball = np.array([[b.axle is None] for b in bounds])
        self._height = np.array([[0.0, 0.0, float(b.anchored)] for b in bounds])
        self._T, self._r = np.zeros((k, 3, 3)), np.zeros((k, 3))

    def evaluate(self, c: Array, velocity: Array, acceleration: Array) -> None:
        """Write the rows into the three vectors of all rows."""
        E, p = self._ends.apart()
        (v, _), (a, _) = self._ends.linear()
        (w, _), (alpha, _) = self._ends.angular()
        r_dot, T_dot = self._point(E, w)
        T, r = self._T, self._r
        w_r = cross(w, r)
        s = v + w_r
        s_dot = a - cross(w, v) + cross(alpha, r) + cross(w, r_dot)  # a is the classical one
        rows = (
            self._height * dot(T[:, 2], r - p)[:, None],
            (T @ s[:, :, None])[:, :, 0],
            (T @ s_dot[:, :, None] + T_dot @ s[:, :, None])[:, :, 0],
        )
        for three, out in zip(rows, (c, velocity, acceleration), strict=True):
            out[self._rows] = three.reshape(-1)[self._chosen]

    def stack(self, lam: Array, f1: Array) -> None:
        """Write the forces and moments (6 k) at the origins of c1, in its axes."""
        three = np.zeros((len(self._bounds), 3))
        three.reshape(-1)[self._chosen] = lam[self._rows]
        force = (three[:, None] @ self._T)[:, 0]
        f1.reshape(-1, 6)[:] = np.hstack([force, cross(self._r, force)])

    def jacobian(self, J: Array, of_frame: FrameJacobian) -> None:
        """Write the rows into J (m, nv), at the last evaluation."""
        for b, T, r in zip(self._bounds, self._T, self._r, strict=True):
            of = of_frame(b.joint1, b.placement1)
            J[b.rows] = (T @ (of[:3] - pin.skew(r) @ of[3:]))[list(b.selection)]

    def _point(self, E: Array, w: Array) -> tuple[Array, Array]:
        """Find the lowest points r and the axes T of the rows; return how both move."""
        e, n, x = self._axle, E[:, :, 2], E[:, :, 0]
        n_dot = cross(n, w)
        m, m_dot = cross(e, n), cross(e, n_dot)
        size = np.sqrt(dot(m, m))[:, None]
        shrink = np.divide(1.0, size, out=np.zeros_like(size), where=size > FLAT)
        t = m * shrink
        t_dot = (m_dot - t * dot(t, m_dot)[:, None]) * shrink
        ball, radius = self._is_ball, self._radius
        r_dot = np.where(ball, -radius * n_dot, radius * cross(e, t_dot))
        self._r = np.where(ball, -radius * n, radius * cross(e, t))
        t, t_dot = np.where(ball, x, t), np.where(ball, cross(x, w), t_dot)
        self._T = np.stack([t, cross(n, t), n], axis=1)
        return r_dot, np.stack([t_dot, cross(n_dot, t) + cross(n, t_dot), n_dot], axis=1)


def touching(bound: Rolled, oMi: Any) -> Any:
    """Return the frame of the rows: its origin the lowest point, its axes t, n x t and n.

    Parameters
    ----------
    bound : Rolled
    oMi : pin.SE3
        Placement of its joint in the world.
    """
    oMc1, R2 = oMi * bound.placement1, bound.placement2.rotation
    n, t = R2[:, 2], R2[:, 0]
    r = -bound.radius * n
    if bound.axle is not None:
        e = oMc1.rotation[:, bound.axle]
        m = np.cross(e, n)
        size = float(np.linalg.norm(m))
        t = m / size if size > FLAT else t
        r = bound.radius * np.cross(e, t) if size > FLAT else 0.0 * n
    return pin.SE3(np.column_stack([t, np.cross(n, t), n]), oMc1.translation + r)
