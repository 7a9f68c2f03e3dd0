"""The motion of one frame relative to another, and its partial derivatives at fixed accelerations.

With delta = J_s dq the displacement of c1 relative to c2 by a step dq, in the axes of c1,

    d(R x) = -delta_ang x (R x) + R dx,    dr = -delta_lin,    d(X y) = -delta x (X y) + X dy,

the last cross product that of spatial motions; R, r and X belong to c1Mc2.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.rows.rolling import skews

if TYPE_CHECKING:
    from condyn_pin.constraints.partials.formulas import End

_skew = pin.skew


class RelativeMotion(NamedTuple):
    """The velocity of c1 relative to c2 and its rate, component by component in the axes of c1.

    Of one constraint, or of many, stacked.
    """

    J: Array  # (6, nv), of the velocity by v
    s_q: Array  # (6, nv), of its rate
    s_v: Array
    velocity: Array  # (6,)
    velocity_q: Array
    s: Array  # (6,), its rate
    dr: Array  # (3, nv), of r by q

    def of(self, i: int) -> RelativeMotion:
        """Return that of one constraint among many."""
        return RelativeMotion(*(part[i] for part in self))


def twist_of(one: End, two: End, X: Array) -> RelativeMotion:
    """Return the relative twist, a spatial motion with its linear part at the origin of c1.

    u = v1 - X v2,    s = u' = a1 - X a2 + u x X v2
    """
    X_J2, v2, a2 = X @ two.J, _times(X, two.v), _times(X, two.a)
    J, velocity = one.J - X_J2, one.v - v2
    by_v2, by_velocity = spatial_cross(v2), spatial_cross(velocity)
    v2_q = by_v2 @ J + X @ two.v_q
    velocity_q = one.v_q - v2_q
    s_q = one.a_q - spatial_cross(a2) @ J - X @ two.a_q + by_velocity @ v2_q - by_v2 @ velocity_q
    s_v = one.a_v - X @ two.a_v + by_velocity @ X_J2 - by_v2 @ J
    s = one.a - a2 + _times(by_velocity, v2)
    return RelativeMotion(J, s_q, s_v, velocity, velocity_q, s, _of_lever(J, X))


def _of_lever(J: Array, X: Array) -> Array:
    """Return r by q, -(J_lin + J_ang x r), with X of R and r."""
    R, r_x_R = X[..., :3, :3], X[..., :3, 3:]
    return np.asarray(r_x_R @ (R.swapaxes(-1, -2) @ J[..., 3:, :]) - J[..., :3, :])


def at_c2(twist: RelativeMotion, r: Array) -> RelativeMotion:
    """Return the relative motion with its linear part at the origin of c2.

    With w the angular part, the linear one is

        p = u_lin + w x r,    p' = u_lin' + w' x r - w x p,    r' = -p.
    """
    lin, ang, r_x, J = slice(0, 3), slice(3, 6), skews(r), -twist.dr
    w, w_q, alpha = twist.velocity[..., ang], twist.velocity_q[..., ang, :], twist.s[..., ang]
    W = skews(w)
    p = twist.velocity[..., lin] - _times(r_x, w)
    p_q = twist.velocity_q[..., lin, :] - r_x @ w_q - W @ J
    by_p = skews(p)
    s = twist.s[..., lin] - _times(r_x, alpha) - _times(W, p)
    s_q = twist.s_q[..., lin, :] - r_x @ twist.s_q[..., ang, :] - skews(alpha) @ J
    s_q += by_p @ w_q - W @ p_q
    s_v = twist.s_v[..., lin, :] - r_x @ twist.s_v[..., ang, :] - W @ J
    s_v += by_p @ twist.J[..., ang, :]
    return _with_linear(twist, (J, s_q, s_v), p, p_q, s)


def apart(one: End, two: End, c1Mc2: Any, twist: RelativeMotion) -> RelativeMotion:
    """Return the relative motion of the two origins, as if r were zero."""
    R, Ja = c1Mc2.rotation, twist.J[3:]
    (a1, a1_q, a1_v), (a2, a2_q, a2_v) = one.classical(), two.classical()
    v2, a2 = R @ two.v[:3], R @ a2
    velocity_q = one.v_q[:3] - _skew(v2) @ Ja - R @ two.v_q[:3]
    s_q, s_v = a1_q - _skew(a2) @ Ja - R @ a2_q, a1_v - R @ a2_v
    rows = one.J[:3] - R @ two.J[:3], s_q, s_v
    return _with_linear(twist, rows, one.v[:3] - v2, velocity_q, a1 - a2)


def _with_linear(
    twist: RelativeMotion,
    rows: tuple[Array, Array, Array],
    velocity: Array,
    velocity_q: Array,
    s: Array,
) -> RelativeMotion:
    """Return a relative motion with another linear part and the same angular one."""
    J, s_q, s_v = (
        np.concatenate((part, whole[..., 3:, :]), axis=-2)
        for part, whole in zip(rows, twist, strict=False)
    )
    velocity, s = (
        np.concatenate((part, whole[..., 3:]), axis=-1)
        for part, whole in ((velocity, twist.velocity), (s, twist.s))
    )
    velocity_q = np.concatenate((velocity_q, twist.velocity_q[..., 3:, :]), axis=-2)
    return RelativeMotion(J, s_q, s_v, velocity, velocity_q, s, twist.dr)


def _times(A: Array, x: Array) -> Array:
    """Return A x, of one vector or of many."""
    return np.asarray((A @ x[..., None])[..., 0])


def spatial_cross(x: Array) -> Array:
    """Return the matrices (..., 6, 6) of the spatial cross product x times."""
    return np.asarray((x @ _SPATIAL).reshape(*x.shape, 6))


# x @ _SPATIAL has the entries of the matrix of x times
_SPATIAL: Final = np.array([pin.Motion(e).action.ravel() for e in np.eye(6)])
