"""How the rows of one constraint change with q and v, at fixed accelerations and forces.

With delta = J_s dq the slip of c1 past c2 that a step dq makes,

    d(R x) = -delta_ang x (R x) + R dx,    dr = -delta_lin,    d(X y) = -delta x (X y) + X dy,

the last cross product that of spatial motions. The rows themselves are in
`condyn_pin.constraints.rows.loops`, `cut_joints` and `rods`; their partials follow by the product
rule. A force that is fixed in c1 turns in c2: its wrench on body 2 changes too, and that on body 1
where its lever does.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from condyn_pin._core._pin import LOCAL, pin
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.rows.bound import FRAME, Bound
from condyn_pin.constraints.rows.related import Related

_skew = pin.skew


class End(NamedTuple):
    """One end of a constraint: a frame on a joint, everything in its own axes."""

    v: Array  # (6,)
    a: Array  # (6,), spatial
    v_q: Array  # (6, nv)
    a_q: Array
    a_v: Array
    J: Array

    def classical(self) -> tuple[Array, Array, Array]:
        """Return the acceleration of the origin, and its derivatives by q and v."""
        v, w = self.v[:3], self.v[3:]
        W, V = _skew(w), _skew(v)
        return (
            self.a[:3] + W @ v,
            self.a_q[:3] + W @ self.v_q[:3] - V @ self.v_q[3:],
            self.a_v[:3] + W @ self.J[:3] - V @ self.J[3:],
        )

    def by_twist(self) -> End:
        """Return it with its partials by a twist of the frame on its body."""
        turning = spatial_cross(self.v), spatial_cross(self.a)
        return End(self.v, self.a, *turning, np.zeros((6, 6)), np.eye(6))


class Frames:
    """The frames that constraints hold, from what Pinocchio's derivatives left in its data."""

    def __init__(self, model: Any, data: Any) -> None:
        self._model, self.data = model, data
        self._world = End(*np.zeros((2, 6)), *np.zeros((4, 6, model.nv)))

    def between(self, b: Bound | Related) -> Any:
        """Return c1Mc2."""
        oMi = self.data.oMi
        return (oMi[b.joint1] * b.placement1).actInv(oMi[b.joint2] * b.placement2)

    def ends(self, b: Bound | Related) -> tuple[End, End]:
        """Return c1 and c2."""
        return self.end(b.joint1, b.placement1), self.end(b.joint2, b.placement2)

    def end(self, joint: int, placement: Any) -> End:
        """Return a frame on a joint as the end of a constraint."""
        if joint == 0:
            return self._world
        v, a = placement.actInv(self.data.v[joint]), placement.actInv(self.data.a[joint])
        return End(v.vector, a.vector, *self.partials(joint, placement))

    def partials(self, joint: int, placement: Any) -> tuple[Array, Array, Array, Array]:
        """Return v_q, a_q, a_v and J of a frame on a joint."""
        found: tuple[Array, Array, Array, Array] = pin.getFrameAccelerationDerivatives(
            self._model, self.data, joint, placement, LOCAL
        )
        if self._model.nv > 1:
            return found
        v_q, a_q, a_v, J = (part.reshape(6, 1) for part in found)  # Pinocchio gives vectors
        return v_q, a_q, a_v, J


class Partials(NamedTuple):
    """Partial derivatives of the rows of one constraint, and of its wrenches on the two bodies."""

    J: Array  # (rows, nv)
    s_q: Array  # (rows, nv), of J a + gamma
    s_v: Array  # (rows, nv)
    w1_q: Array | None = None  # (6, nv), of the wrench at the origin of c1, in its axes
    w2_q: Array | None = None  # (6, nv), the same of c2


def of_frame(b: Bound, _v_q: Array, a_q: Array, a_v: Array, J: Array) -> Partials:
    """Return the partials of a surface or an edge: rows of the frame's own velocity."""
    if b.selection == FRAME:
        return Partials(J, a_q, a_v)
    chosen = list(b.selection)
    return Partials(J[chosen], a_q[chosen], a_v[chosen])


def of_point(one: End) -> Partials:
    """Return the partials of a point on the world."""
    _, a_q, a_v = one.classical()
    return Partials(one.J[:3], a_q, a_v)


def of_pair(b: Bound, one: End, two: End, c1Mc2: Any, lam: Array) -> Partials:
    """Return the partials of a loop between two bodies, or with an anchor in the world."""
    if b.is_plain and b.size == 6:
        return of_weld(one, two, c1Mc2, lam)
    return of_points(b, one, two, c1Mc2, lam)


def of_weld(one: End, two: End, c1Mc2: Any, lam: Array) -> Partials:
    """Return the partials of a weld between two bodies."""
    X = c1Mc2.toActionMatrix()
    X_J2 = X @ two.J
    J = one.J - X_J2
    v2, a2 = X @ two.v, X @ two.a
    by_v2, by_slip = spatial_cross(v2), spatial_cross(one.v - v2)
    v2_q = by_v2 @ J + X @ two.v_q
    s_q = one.a_q - spatial_cross(a2) @ J - X @ two.a_q
    s_q += by_slip @ v2_q - by_v2 @ (one.v_q - v2_q)
    s_v = one.a_v - X @ two.a_v + by_slip @ X_J2 - by_v2 @ J
    return Partials(J, s_q, s_v, None, X.T @ dual_cross(lam) @ J)


def of_points(b: Bound, one: End, two: End, c1Mc2: Any, lam: Array) -> Partials:
    """Return the partials of a ball or of a cut joint between two bodies."""
    R, r = c1Mc2.rotation, c1Mc2.translation
    slip = slip_of(one, two, R, r, at_c2=not b.is_plain)
    if b.is_rod:
        return _of_rod(one, two, R, r, slip, float(lam[0]))
    turn = turn_of(one, two, R)
    chosen, six = list(b.selection), np.zeros(6)
    six[chosen] = lam
    F, T = _skew(six[:3]), _skew(six[3:])
    w1_q = None if b.is_plain else np.concatenate([np.zeros_like(slip.dr), -F @ slip.dr])
    w2_q = -np.concatenate([R.T @ F @ turn.J, R.T @ T @ turn.J])
    J, s_q, s_v = (np.concatenate(pair)[chosen] for pair in zip(slip[:3], turn[:3], strict=True))
    return Partials(J, s_q, s_v, w1_q, w2_q)


class Slip(NamedTuple):
    """The linear part of the slip and of its derivative in time, with their partials."""

    J: Array  # (3, nv), of the slip by v
    s_q: Array  # (3, nv), of its derivative in time
    s_v: Array
    slip: Array  # (3,)
    slip_q: Array
    s: Array  # (3,), its derivative in time
    dr: Array  # (3, nv), of r by q


class Turn(NamedTuple):
    """The same of the angular part."""

    J: Array
    s_q: Array
    s_v: Array


def slip_of(one: End, two: End, R: Array, r: Array, *, at_c2: bool) -> Slip:
    """Return the slip at the origin of c2; or with the two origins compared as if r were zero."""
    dr = _skew(r) @ one.J[3:] + R @ two.J[:3] - one.J[:3]
    Ja = one.J[3:] - R @ two.J[3:]
    (a1, a1_q, a1_v), (a2, a2_q, a2_v) = one.classical(), two.classical()
    v2, a2 = R @ two.v[:3], R @ a2
    slip = one.v[:3] - v2
    slip_q = one.v_q[:3] - _skew(v2) @ Ja - R @ two.v_q[:3]
    s, s_q, s_v = a1 - a2, a1_q - _skew(a2) @ Ja - R @ a2_q, a1_v - R @ a2_v
    if not at_c2:
        return Slip(one.J[:3] - R @ two.J[:3], s_q, s_v, slip, slip_q, s, dr)
    W, A, r_x = _skew(one.v[3:]), _skew(one.a[3:]), _skew(r)
    slip, slip_q = slip + W @ r, slip_q + W @ dr - r_x @ one.v_q[3:]
    y = W @ r - 2 * slip
    y_q = W @ dr - r_x @ one.v_q[3:] - 2 * slip_q
    y_v = 2 * dr - r_x @ one.J[3:]
    Y = _skew(y)
    s = s + A @ r + W @ y
    s_q = s_q + A @ dr - r_x @ one.a_q[3:] + W @ y_q - Y @ one.v_q[3:]
    s_v = s_v - r_x @ one.a_v[3:] + W @ y_v - Y @ one.J[3:]
    return Slip(-dr, s_q, s_v, slip, slip_q, s, dr)


def turn_of(one: End, two: End, R: Array) -> Turn:
    """Return the angular part of the slip."""
    J = one.J[3:] - R @ two.J[3:]
    w2, alpha2 = _skew(R @ two.v[3:]), _skew(R @ two.a[3:])
    W = _skew(one.v[3:])
    s_q = one.a_q[3:] - alpha2 @ J - R @ two.a_q[3:]
    s_q += W @ (w2 @ J + R @ two.v_q[3:]) - w2 @ one.v_q[3:]
    s_v = one.a_v[3:] - R @ two.a_v[3:] + W @ R @ two.J[3:] - w2 @ one.J[3:]
    return Turn(J, s_q, s_v)


def _of_rod(one: End, two: End, R: Array, r: Array, of: Slip, lam: float) -> Partials:
    """Return the partials of n . s' - (|s|^2 - (n . s)^2) / |r|, and of the force lam n."""
    distance = float(np.linalg.norm(r))
    n, n_q = direction(r, of.dr)
    along, along_q = n @ of.slip, n @ of.slip_q + of.slip @ n_q
    across = of.slip @ of.slip - along**2
    s_q = n @ of.s_q + of.s @ n_q + across / distance**2 * (n @ of.dr)
    s_q -= 2 * (of.slip @ of.slip_q - along * along_q) / distance
    s_v = n @ of.s_v - 2 * (of.slip @ of.J - along * (n @ of.J)) / distance
    F_q, F = lam * n_q, lam * _skew(n)
    w1_q = np.concatenate([F_q, _skew(r) @ F_q - F @ of.dr])
    turned = R.T @ (F_q - F @ (one.J[3:] - R @ two.J[3:]))
    w2_q = np.concatenate([turned, np.zeros_like(turned)])
    return Partials((n @ of.J)[None], s_q[None], s_v[None], w1_q, w2_q)


def direction(r: Array, dr: Array) -> tuple[Array, Array]:
    """Return n = r / |r| and how it changes."""
    distance = np.linalg.norm(r)
    n = r / distance
    return n, (np.eye(3) - np.outer(n, n)) @ dr / distance


def spatial_cross(x: Array) -> Array:
    """Return the matrix of the spatial cross product x times."""
    return np.array(pin.Motion(x).action)


def dual_cross(wrench: Array) -> Array:
    """Return the matrix D with D x = x x* wrench, for a spatial motion x."""
    D, F = np.zeros((6, 6)), _skew(-wrench[:3])
    D[:3, 3:] = D[3:, :3] = F
    D[3:, 3:] = _skew(-wrench[3:])
    return D
