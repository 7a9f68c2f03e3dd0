"""Cut joints: loops that keep a choice of the six rows of the relative velocity.

With r, R, v, omega as in `condyn_pin.constraints.rows.ends`, body 1 moves relative to body 2 at
the origin of c2 with

    s_lin = v1 + omega1 x r - R v2 = -r',       s_ang = omega1 - R omega2

in the axes of c1, and its derivatives, component by component in those axes, are

    s_lin' = a1 - R a2 + alpha1 x r + omega1 x (omega1 x r) - 2 omega1 x s_lin
    s_ang' = alpha1 - R alpha2 + omega1 x R omega2.

The violation is -r, and for turns -log(R), or for a hinge about e the turn that brings e back onto
R e.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.rows.bound import Bound
from condyn_pin.constraints.rows.ends import Ends
from condyn_pin.constraints.rows.frames import FrameJacobian, rows_of

_YZX, _ZXY = np.array([1, 2, 0]), np.array([2, 0, 1])


class CutJoints:
    """All loops of one scene with other rows than Pinocchio's."""

    def __init__(self, ends: Ends, bounds: Sequence[Bound]) -> None:
        self._bounds, self._ends = tuple(bounds), ends
        k = len(bounds)
        self._rows = rows_of(bounds)
        chosen = [6 * i + j for i, b in enumerate(bounds) for j in b.selection]
        self._chosen = np.array(chosen, dtype=np.int_)  # of the k x 6 components
        self._hinges = np.array([i for i, b in enumerate(bounds) if b.is_hinge], dtype=np.int_)
        self._axes = np.eye(3)[[bounds[i].axis for i in self._hinges]]
        self._sliders = [i for i, b in enumerate(bounds) if b.size == 5 and not b.is_hinge]
        self._anchored = np.array([[[float(b.anchored)]] for b in bounds])
        self._R, self._r = np.zeros((k, 3, 3)), np.zeros((k, 3))

    def evaluate(self, c: Array, velocity: Array, acceleration: Array) -> None:
        """Write the rows of these loops into the three vectors of all rows."""
        self._R, self._r, s, s_dot = relative_velocities(self._ends)
        off = np.empty_like(s)
        off[:, 0], off[:, 1] = -self._r, self._turn_off()
        off *= self._anchored
        for six, out in ((off, c), (s, velocity), (s_dot, acceleration)):
            out[self._rows] = six.reshape(-1)[self._chosen]

    def stack(self, lam: Array, f1: Array, f2: Array) -> None:
        """Write the forces and moments (6 k) at the origins of c1 and c2, each in its axes."""
        six = np.zeros((len(self._bounds), 2, 3))
        six.reshape(-1)[self._chosen] = lam[self._rows]
        force, moment = six[:, 0], six[:, 1]
        f2.reshape(-1, 2, 3)[:] = six @ self._R  # R^T f, R^T m
        moment += cross(self._r, force)
        f1[:] = six.reshape(-1)

    def jacobian(self, J: Array, of_frame: FrameJacobian) -> None:
        """Write the rows of these loops into J (m, nv), at the last evaluation."""
        for i, b in enumerate(self._bounds):
            J1, J2 = of_frame(b.joint1, b.placement1), of_frame(b.joint2, b.placement2)
            R = self._R[i]
            linear = J1[:3] - pin.skew(self._r[i]) @ J1[3:] - R @ J2[:3]
            J[b.rows] = np.vstack([linear, J1[3:] - R @ J2[3:]])[list(b.selection)]

    def _turn_off(self) -> Array:
        """Return the turn that is missing, of hinges and sliders."""
        off = np.zeros_like(self._r)
        for i in self._sliders:
            off[i] = -pin.log3(self._R[i])
        if not len(self._hinges):
            return off
        e = self._axes
        turned = (self._R[self._hinges] @ e[:, :, None])[:, :, 0]
        across, cosine = cross(turned, e), dot(turned, e)
        sine = np.sqrt(dot(across, across))
        # an axis that points backwards is half a turn off, about any axis across
        across = np.where(
            sine[:, None] > 0, across, np.where(cosine[:, None] < 0, np.roll(e, 1, axis=1), 0)
        )
        scale = np.arctan2(sine, cosine) / np.where(sine > 0, sine, 1.0)
        off[self._hinges] = scale[:, None] * across
        return off


def relative_velocities(ends: Ends) -> tuple[Array, Array, Array, Array]:
    """Return R (k, 3, 3), r (k, 3), and the relative velocities and their rates (k, 2, 3).

    Both have a linear and an angular part, in the axes of c1.
    """
    R, r = ends.apart()
    (v1, v2), (a1, a2) = ends.linear()
    (w1, w2), (alpha1, alpha2) = ends.angular()
    (v2, w2), (a2, alpha2) = turned(R, v2, w2), turned(R, a2, alpha2)
    w1_r, alpha1_r, w1_w2 = cross(w1, r), cross(alpha1, r), cross(w1, w2)
    s, s_dot = np.empty((2, len(r), 2, 3))
    s[:, 0] = v1 + w1_r - v2
    s[:, 1] = w1 - w2
    s_dot[:, 0] = a1 - a2 + alpha1_r + cross(w1, w1_r - 2 * s[:, 0])
    s_dot[:, 1] = alpha1 - alpha2 + w1_w2
    return R, r, s, s_dot


def turned(R: Array, *parts: Array) -> Array:
    """Return R x for each of many (k, 3, 3) and some parts (k, 3)."""
    x = np.empty((len(parts), len(R), 3, 1))
    for i, part in enumerate(parts):
        x[i, :, :, 0] = part
    return np.asarray((R @ x)[..., 0])


def cross(x: Array, y: Array) -> Array:
    """Return x x y for each of many (..., 3): a tenth of the time of `np.cross`."""
    x_yzx, y_yzx = x.take(_YZX, axis=-1), y.take(_YZX, axis=-1)
    return np.asarray(x_yzx * y.take(_ZXY, axis=-1) - x.take(_ZXY, axis=-1) * y_yzx)


def dot(x: Array, y: Array) -> Array:
    """Return x . y for each of many (k, 3)."""
    return np.asarray(np.einsum("ij,ij->i", x, y))
