"""Partial derivatives by q and v of relative motions of two frames.

Accelerations are fixed.

With delta = J_s dq the displacement of c1 relative to c2 by a step dq, in the axes of c1,

    d(R x) = -delta_ang x (R x) + R dx,    dr = -delta_lin,    d(X y) = -delta x (X y) + X dy,

the last cross product that of spatial motions; R, r and X belong to c1Mc2.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np

from condyn_pin._core._pin import LOCAL, pin
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.rows.bound import FRAME, Bound, TwoFrameConstraint
from condyn_pin.constraints.rows.frames import Ends, Joints
from condyn_pin.constraints.rows.special import BoundRelation, skews

_skew = pin.skew


class RelativeMotion(NamedTuple):
    """Velocity of c1 relative to c2, its rate, and their partials, in the axes of c1.

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
        """Relative motion of one constraint among many."""
        return RelativeMotion(*(part[i] for part in self))


def twist_of(one: End, two: End, X: Array) -> RelativeMotion:
    """Relative twist, a spatial motion with its linear part at the origin of c1.

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
    """Partials of r by q, -(J_lin + J_ang x r), with X of R and r."""
    R, r_x_R = X[..., :3, :3], X[..., :3, 3:]
    return np.asarray(r_x_R @ (R.swapaxes(-1, -2) @ J[..., 3:, :]) - J[..., :3, :])


def at_c2(twist: RelativeMotion, r: Array) -> RelativeMotion:
    """Relative motion with its linear part at the origin of c2.

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
    """Relative motion of the two origins, as if r were zero."""
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
    """Relative motion with another linear part and the same angular one."""
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
    """Products A x, of one vector or of many."""
    return np.asarray((A @ x[..., None])[..., 0])


def spatial_cross(x: Array) -> Array:
    """Matrices (..., 6, 6) of the spatial cross product x times."""
    return np.asarray((x @ _SPATIAL).reshape(*x.shape, 6))


# x @ _SPATIAL has the entries of the matrix of x times
_SPATIAL: Final = np.array([pin.Motion(e).action.ravel() for e in np.eye(6)])


# How the two ends of many constraints move, all at once: velocities, accelerations, partials.
#
# `pin.computeRNEADerivatives` leaves a column a joint coordinate, linear part at the world's
# origin: J, dV, dA and dA_v, what v and q do to the velocity and the acceleration of every body
# that moves with it. In the axes of a frame with the placement (R, p), a motion (lin, ang) is
#
#     R^T (lin + ang x p),    R^T ang
#
# and as those axes turn with the body, its acceleration changes by dA - v x dV with q, and by dA_v
# - v x J with v.


class At(NamedTuple):
    """Ends of k constraints at one state."""

    one: End
    two: End
    X: Array  # (k, 6, 6), motions in the axes of c2 to those of c1
    R: Array  # (k, 3, 3), c1Mc2
    r: Array  # (k, 3)


class EndPartials:
    """Ends of all constraints between two frames in one scene, with their partials."""

    def __init__(self, frames: Frames, bounds: Sequence[TwoFrameConstraint]) -> None:
        data, n, k = frames.data, frames.nv, len(bounds)
        left = data.J, data.dJ, data.dAdq, data.dAdv
        self._left = tuple(part.reshape(6, n) for part in left)
        self._ends = Ends(data, bounds)
        ends = [(b.joint1, b.placement1) for b in bounds]
        ends += [(b.joint2, b.placement2) for b in bounds]
        self._joints = Joints(data, {joint for joint, _ in ends})
        maps = np.stack(self._joints.maps(ends), axis=1)  # (6 k, 2, size): linear, angular
        self._six = maps.reshape(2 * k, 3, 2, -1).swapaxes(1, 2).reshape(12 * k, -1)
        self._moved = np.array([frames.moves(joint) for joint, _ in ends])[:, None, None]
        self._columns = np.zeros((6, 4, n))  # v_q, J, a_q and a_v
        self._X = np.zeros((2 * k, 6, 6))

    def evaluate(self) -> At:
        """Ends of the constraints, by the derivatives of Newton-Euler's recursion."""
        (J, dJ, A_q, A_v), columns, X = self._left, self._columns, self._X
        columns[:, 0], columns[:, 1], columns[:, 2], columns[:, 3] = A_v - dJ, J, A_q, A_v
        E = self._ends.placements().reshape(-1, 4, 3)
        axes, n = E[:, :3], columns.shape[2]
        X[:, :3, :3] = X[:, 3:, 3:] = axes
        X[:, :3, 3:] = -axes @ skews(E[:, 3])
        parts = X.reshape(-1, 6).dot(columns.reshape(6, -1)).reshape(-1, 6, 4, n)
        parts *= self._moved
        v, a = self._six.dot(self._joints.read().T).T.reshape(2, -1, 6)
        # the axes turn with the frame
        turned = spatial_cross(v) @ parts[:, :, :2].reshape(-1, 6, 2 * n)
        parts[:, :, 2:] -= turned.reshape(-1, 6, 2, n)
        k = len(X) // 2
        one, two = (
            End(v[half], a[half], v_q=of[:, :, 0], a_q=of[:, :, 2], a_v=of[:, :, 3], J=of[:, :, 1])
            for half, of in ((slice(k), parts[:k]), (slice(k, None), parts[k:]))
        )
        R = axes[:k] @ axes[k:].swapaxes(1, 2)
        r = (axes[:k] @ (E[k:, 3] - E[:k, 3])[:, :, None])[:, :, 0]
        between = np.zeros((k, 6, 6))
        between[:, :3, :3] = between[:, 3:, 3:] = R
        between[:, :3, 3:] = skews(r) @ R
        return At(one, two, between, R, r)


# How the rows of one constraint change with q and v, at fixed accelerations and forces.
#
# The rows themselves are in `condyn_pin.constraints.rows.frames`, and how relative
# velocities change is above; the rest follows by the product rule. A force
# that is fixed in c1 turns in c2: its wrench on body 2 changes too, and that on body 1 where its
# lever does.


class End(NamedTuple):
    """One end of a constraint: a frame on a joint, everything in its own axes; or many of them."""

    v: Array  # (6,)
    a: Array  # (6,), spatial
    v_q: Array  # (6, nv)
    a_q: Array
    a_v: Array
    J: Array

    def classical(self) -> tuple[Array, Array, Array]:
        """Acceleration of the origin, and its partials by q and v."""
        v, w = self.v[:3], self.v[3:]
        W, V = _skew(w), _skew(v)
        return (
            self.a[:3] + W @ v,
            self.a_q[:3] + W @ self.v_q[:3] - V @ self.v_q[3:],
            self.a_v[:3] + W @ self.J[:3] - V @ self.J[3:],
        )

    def of(self, i: int) -> End:
        """One end among many."""
        return End(*(part[i] for part in self))

    def by_twist(self) -> End:
        """End with its partials by a twist of the frame on its body."""
        turning = spatial_cross(self.v), spatial_cross(self.a)
        return End(self.v, self.a, *turning, np.zeros((6, 6)), np.eye(6))


class Frames:
    """Frames of the constraints, by Pinocchio's derivatives in its data."""

    def __init__(self, model: Any, data: Any) -> None:
        self._model, self.data = model, data
        self._world = End(*np.zeros((2, 6)), *np.zeros((4, 6, model.nv)))

    @property
    def nv(self) -> int:
        """Number of coordinates."""
        return int(self._model.nv)

    def moves(self, joint: int) -> Array:
        """Flags (nv,) as numbers: one for each coordinate that moves a joint."""
        moved = np.zeros(self.nv)
        for above in list(self._model.supports[joint])[1:]:
            at = self._model.idx_vs[above]
            moved[at : at + self._model.nvs[above]] = 1.0
        return moved

    def between(self, b: Bound | BoundRelation) -> Any:
        """Relative placement c1Mc2."""
        oMi = self.data.oMi
        return (oMi[b.joint1] * b.placement1).actInv(oMi[b.joint2] * b.placement2)

    def ends(self, b: Bound | BoundRelation) -> tuple[End, End]:
        """Ends c1 and c2."""
        return self.end(b.joint1, b.placement1), self.end(b.joint2, b.placement2)

    def end(self, joint: int, placement: Any) -> End:
        """Frame on a joint as the end of a constraint."""
        if joint == 0:
            return self._world
        v, a = placement.actInv(self.data.v[joint]), placement.actInv(self.data.a[joint])
        return End(v.vector, a.vector, *self.partials(joint, placement))

    def partials(self, joint: int, placement: Any) -> tuple[Array, Array, Array, Array]:
        """Partials v_q, a_q, a_v and J of a frame on a joint."""
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
    """Partials of a surface or an edge: rows of the frame's own velocity."""
    if b.selection == FRAME:
        return Partials(J, a_q, a_v)
    chosen = list(b.selection)
    return Partials(J[chosen], a_q[chosen], a_v[chosen])


def of_point(one: End) -> Partials:
    """Partials of a point on the world."""
    _, a_q, a_v = one.classical()
    return Partials(one.J[:3], a_q, a_v)


def of_pair(b: Bound, one: End, two: End, c1Mc2: Any, lam: Array) -> Partials:
    """Partials of a loop between two bodies, or with an anchor in the world."""
    X = c1Mc2.toActionMatrix()
    twist = twist_of(one, two, X)
    if b.is_plain and b.size == 6:
        return of_weld(twist, X, lam)
    if b.is_plain:
        return of_cut(b, apart(one, two, c1Mc2, twist), c1Mc2.rotation, lam)
    of = at_c2(twist, c1Mc2.translation)
    if b.is_rod:
        return of_rod(c1Mc2.rotation, c1Mc2.translation, of, float(lam[0]))
    return of_cut(b, of, c1Mc2.rotation, lam)


def of_weld(twist: RelativeMotion, X: Array, lam: Array) -> Partials:
    """Partials of a weld between two bodies."""
    return Partials(twist.J, twist.s_q, twist.s_v, None, X.T @ dual_cross(lam) @ twist.J)


def of_cut(b: Bound, of: RelativeMotion, R: Array, lam: Array) -> Partials:
    """Partials of a ball or of a cut joint between two bodies."""
    chosen, six = list(b.selection), np.zeros(6)
    six[chosen] = lam
    F, T = _skew(six[:3]), _skew(six[3:])
    # a plain ball is held at both origins: no lever changes
    w1_q = None if b.is_plain else np.concatenate([np.zeros_like(of.dr), -F @ of.dr])
    w2_q = -np.concatenate([R.T @ F @ of.J[3:], R.T @ T @ of.J[3:]])
    return Partials(of.J[chosen], of.s_q[chosen], of.s_v[chosen], w1_q, w2_q)


def of_rod(R: Array, r: Array, of: RelativeMotion, lam: float) -> Partials:
    """Partials of n . s' - (|s|^2 - (n . s)^2) / |r|, and of the force lam n."""
    v, v_q, dr = of.velocity[:3], of.velocity_q[:3], of.dr
    distance, J = float(np.linalg.norm(r)), of.J[:3]
    n, n_q = direction(r, dr)
    along, along_q = n @ v, n @ v_q + v @ n_q
    across = v @ v - along**2
    s_q = n @ of.s_q[:3] + of.s[:3] @ n_q + across / distance**2 * (n @ dr)
    s_q -= 2 * (v @ v_q - along * along_q) / distance
    s_v = n @ of.s_v[:3] - 2 * (v @ J - along * (n @ J)) / distance
    F_q, F = lam * n_q, lam * _skew(n)
    w1_q = np.concatenate([F_q, _skew(r) @ F_q - F @ dr])
    turned = R.T @ (F_q - F @ of.J[3:])
    w2_q = np.concatenate([turned, np.zeros_like(turned)])
    return Partials((n @ J)[None], s_q[None], s_v[None], w1_q, w2_q)


def direction(r: Array, dr: Array) -> tuple[Array, Array]:
    """Direction n = r / |r|, and its partials."""
    distance = np.linalg.norm(r)
    n = r / distance
    return n, (np.eye(3) - np.outer(n, n)) @ dr / distance


def dual_cross(wrench: Array) -> Array:
    """Matrix D with D x = x x* wrench, for a spatial motion x."""
    D, F = np.zeros((6, 6)), _skew(-wrench[:3])
    D[:3, 3:] = D[3:, :3] = F
    D[3:, 3:] = _skew(-wrench[3:])
    return D


# How the rows of a relation change with q and v, at fixed accelerations and forces.
#
# With delta = J_s dq the displacement of c1 relative to c2, W changes by D(delta), its rate at that
# velocity, linear in delta, and D(s) by its partials B(delta) at fixed s (`weights_bend`):
#
#     (J v)_q         = W s_q + D(delta) s
#     (J a + gamma)_q = W s'_q + D(delta) s' + D(s) s_q + D(s_q) s + B(delta) s
#     (J a + gamma)_v = W s'_v + D(s) J_s + D(J_s) s
#
# The wrench f = W^T lam at c2, in the axes of c1, changes by D(delta)^T lam, r by -delta_lin, and
# R^T f besides by R^T (delta_ang x f).


def of_relation(b: BoundRelation, of: RelativeMotion, R: Array, r: Array, lam: Array) -> Partials:
    """Partials of the rows, and of the wrenches on both bodies."""
    W, D = b.relation.weights(R, r), _rates(b, R, r)
    at_s = np.tensordot(of.velocity, D, 1)  # D(s)
    bend = np.einsum("irk,k->ri", b.relation.weights_bend(R, r, of.velocity), of.velocity)
    by_s = _applied(D, of.velocity)  # (rows, 6): delta to D(delta) s
    s_q = W @ of.s_q + (_applied(D, of.s) + bend) @ of.J + (at_s + by_s) @ of.velocity_q
    s_v = W @ of.s_v + (at_s + by_s) @ of.J
    f, f_q = W.T @ lam, np.einsum("irk,r->ki", D, lam) @ of.J
    moved = np.concatenate([f_q[:3], f_q[3:] + _skew(r) @ f_q[:3] + _skew(f[:3]) @ of.J[:3]])
    turned = [
        R.T @ (part - _skew(x) @ of.J[3:]) for part, x in ((f_q[:3], f[:3]), (f_q[3:], f[3:]))
    ]
    return Partials(W @ of.J, s_q, s_v, moved, np.concatenate(turned))


def gap_of_relation(
    b: BoundRelation, of: RelativeMotion, R: Array, r: Array
) -> tuple[Array, Array]:
    """Partials of c and of J v: that of c is J, for c' = J v."""
    W = b.relation.weights(R, r)
    return W @ of.J, W @ of.velocity_q + _applied(_rates(b, R, r), of.velocity) @ of.J


def wrenches_of_relation(b: BoundRelation, c1Mc2: Any, lam: Array) -> tuple[Array, Array]:
    """Wrench at the origin of c1 in its axes, and the same for c2."""
    R, r = c1Mc2.rotation, c1Mc2.translation
    f = b.relation.weights(R, r).T @ lam
    at_c2 = np.concatenate([R.T @ f[:3], R.T @ f[3:]])
    return np.concatenate([f[:3], f[3:] + _skew(r) @ f[:3]]), at_c2


def _rates(b: BoundRelation, R: Array, r: Array) -> Array:
    """Rates of W at each of the six unit velocities (6, rows, 6)."""
    return np.array([b.relation.weights_rate(R, r, e) for e in np.eye(6)])


def _applied(D: Array, x: Array) -> Array:
    """Matrix (rows, 6) of delta to D(delta) x."""
    return np.asarray(np.einsum("irk,k->ri", D, x))
