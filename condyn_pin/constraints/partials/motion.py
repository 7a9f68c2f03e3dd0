"""Partial derivatives by q and v of relations between two frames.

Accelerations and forces are fixed. Every kind is its weights W of the relative motion s: hinges,
sliders, planar pins, welds, surfaces, edges and rods as much as relations of users.

With delta = J_s dq the displacement of c1 relative to c2 by a step dq, in the axes of c1,

    d(R x) = -delta_ang x (R x) + R dx,    dr = -delta_lin,    d(X y) = -delta x (X y) + X dy,

the last cross product that of spatial motions; R, r and X belong to c1Mc2.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np

from condyn_pin._core._pin import LOCAL, pin
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.baumgarte import Baumgarte, gains
from condyn_pin.constraints.rows.bound import Bound, TwoFrameConstraint
from condyn_pin.constraints.rows.frames import Ends, Joints, cross, rows_of
from condyn_pin.constraints.rows.special import BoundRelation, skews

_skew = pin.skew

# A constraint between two frames, but for points.
Pair: TypeAlias = Bound | BoundRelation


class RelativeMotion(NamedTuple):
    """Velocities, their rates, and the partials of both, of k constraints."""

    J: Array  # (k, 6, nv), of the velocity by v
    s_q: Array  # (k, 6, nv), of its rate
    s_v: Array
    velocity: Array  # (k, 6)
    velocity_q: Array
    s: Array  # (k, 6), its rate


def relative_motion(one: End, two: End, X: Array, r: Array) -> RelativeMotion:
    """Velocity of body 1 relative to body 2 at the origin of c2, in the axes of c1.

    From that at the origin of c1,

        u = v1 - X v2,    u' = a1 - X a2 + u x X v2,

    by r' = -s_lin:

        s = W u,    s' = W u' + W' u,    W = (1, -r x; 0, 1),    W' = (0, s_lin x; 0, 0).
    """
    X_J2, v2, a2 = X @ two.J, _times(X, two.v), _times(X, two.a)
    J, u = one.J - X_J2, one.v - v2
    by_v2, by_u = spatial_cross(v2), spatial_cross(u)
    v2_q = by_v2 @ J + X @ two.v_q
    u_q = one.v_q - v2_q
    s_q = one.a_q - spatial_cross(a2) @ J - X @ two.a_q + by_u @ v2_q - by_v2 @ u_q
    s_v = one.a_v - X @ two.a_v + by_u @ X_J2 - by_v2 @ J
    rate = one.a - a2 + _times(by_u, v2)
    W, turned, swept, by_rate = np.zeros((4, *X.shape))
    W[:] = np.eye(6)
    W[..., :3, 3:] = -skews(r)
    velocity, J_c1, J = _times(W, u), J, W @ J
    # D(delta) u = delta_lin x u_ang, and the same of u'
    swept[..., :3, :3], by_rate[..., :3, :3] = -skews(u[..., 3:]), -skews(rate[..., 3:])
    turned[..., :3, 3:] = skews(velocity[..., :3])  # W'
    velocity_q = W @ u_q + swept @ J
    s_q = W @ s_q + by_rate @ J + turned @ u_q + swept @ velocity_q
    s_v = W @ s_v + turned @ J_c1 + swept @ J
    return RelativeMotion(J, s_q, s_v, velocity, velocity_q, _times(W, rate) + _times(turned, u))


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

    @classmethod
    def single(cls, one: End, two: End, c1Mc2: Any) -> At:
        """Ends of one constraint."""
        X, R, r = c1Mc2.toActionMatrix(), c1Mc2.rotation, c1Mc2.translation
        return cls(one.stacked(), two.stacked(), X[None], R[None], r[None])


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

    def stacked(self) -> End:
        """One end as many."""
        return End(*(part[None] for part in self))

    def still(self) -> End:
        """End that does not change by a twist of the other."""
        return End(self.v, self.a, *np.zeros((4, 6, 6)))

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

    def ends(self, b: Pair) -> tuple[End, End, Any]:
        """Ends c1 and c2, and their relative placement c1Mc2."""
        c1, c2 = b.ends(self.data.oMi)
        one, two = self.end(b.joint1, b.placement1), self.end(b.joint2, b.placement2)
        return one, two, c1.actInv(c2)

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


def dual_cross(wrench: Array) -> Array:
    """Matrix D with D x = x x* wrench, for a spatial motion x."""
    D, F = np.zeros((6, 6)), _skew(-wrench[:3])
    D[:3, 3:] = D[3:, :3] = F
    D[3:, 3:] = _skew(-wrench[3:])
    return D


# How the rows of every kind change with q and v, at fixed accelerations and forces.
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


class Partials(NamedTuple):
    """Partial derivatives of the rows of some constraints, and of their k wrenches."""

    J: Array  # (rows, nv)
    s_q: Array  # (rows, nv), of J a + gamma, and of what pulls the rows back
    s_v: Array  # (rows, nv), of J a + gamma
    v_q: Array  # (rows, nv), of J v
    w1: Array  # (k, 6), wrench on body 1 at the origin of c1, in its axes
    w2: Array  # (k, 6), the opposite of that on body 2, at c2
    w1_q: Array  # (k, 6, nv)
    w2_q: Array


class Kinds:
    """Constraints between two frames, with their weights.

    Each has p rows here, six or more, of which `chosen` are those that it has.
    """

    def __init__(self, bounds: Sequence[Pair], drift: Baumgarte | None) -> None:
        self._bounds, self._drift = bounds, drift
        self._p = p = max(6, *(b.size for b in bounds))
        self.rows = rows_of(bounds)
        self._chosen = np.array([p * i + j for i, b in enumerate(bounds) for j in b.of_six])
        self.signs = np.concatenate([np.full((b.size, 1), b.sign) for b in bounds])
        # those of cut joints are rows of s
        self._weigh = not all(isinstance(b, Bound) and b.is_cut for b in bounds)
        if drift:
            self._Kp, self._Kd = (each[:, None] for each in gains(bounds, drift))

    def at(self, at: At, lam: Array) -> Partials:
        """Partials at the ends of one state, with forces lam (rows,)."""
        of, R, r, k = relative_motion(*at[:2], at.X, at.r), at.R, at.r, len(self._bounds)
        J, s_q, s_v, v_q = of.J, of.s_q, of.s_v, of.velocity_q
        f = np.zeros((k, self._p))
        f.reshape(-1)[self._chosen] = self.signs[:, 0] * lam
        f_q, W = np.zeros((k, 6, 6)), np.eye(6)
        if self._weigh:
            W, D, bend = weights_of(self._bounds, self._p, R, r, of.velocity)
            by_s, by_rate = (_times(D, x[:, None]) for x in (of.velocity, of.s))
            by_velocity = (of.velocity[:, None, None] @ D)[:, :, 0] + by_s
            J, v_q = W @ of.J, W @ of.velocity_q + by_s @ of.J
            s_q = W @ of.s_q + (by_rate + bend) @ of.J + by_velocity @ of.velocity_q
            s_v = W @ of.s_v + by_velocity @ of.J
            f_q = np.einsum("kr,krij->kji", f, D)
            f = (f[:, None] @ W)[:, 0]
        J, s_q, s_v, v_q = (
            self.signs * x.reshape(-1, x.shape[2])[self._chosen] for x in (J, s_q, s_v, v_q)
        )
        if self._drift:
            s_q += self._Kp * self._c_q(R, r, W, of.J) + self._Kd * v_q
        # on body 1 at c1, and on body 2 in the axes of c2
        RT, w1, w1_q, turned = R.swapaxes(1, 2), f.copy(), f_q.copy(), f_q.copy()
        w1[:, 3:] += cross(r, f[:, :3])
        w1_q[:, 3:] += skews(r) @ f_q[:, :3]
        F, T = skews(f.reshape(2 * k, 3)).reshape(k, 2, 3, 3).swapaxes(0, 1)
        w1_q[:, 3:, :3] += F
        turned[:, :3, 3:] -= F
        turned[:, 3:, 3:] -= T
        w2_q = (RT[:, None] @ turned.reshape(k, 2, 3, 6)).reshape(k, 6, 6)
        w2 = (f.reshape(k, 2, 3) @ R).reshape(k, 6)
        return Partials(J, s_q, s_v, v_q, w1, w2, w1_q @ of.J, w2_q @ of.J)

    def _c_q(self, R: Array, r: Array, W: Array, J: Array) -> Array:
        """Partials of c (rows, nv)."""
        W = np.broadcast_to(W, (len(self._bounds), self._p, 6))
        C = np.stack([by_gap(b, *of) for b, *of in zip(self._bounds, R, r, W, strict=True)])
        return np.asarray(self.signs * (C @ J).reshape(-1, J.shape[2])[self._chosen])


def weights_of(
    bounds: Sequence[Pair], p: int, R: Array, r: Array, velocity: Array
) -> tuple[Array, Array, Array]:
    """Weights W (k, p, 6), their rates D (k, p, 6, 6) by delta, and B(delta) s (k, p, 6)."""
    k = len(bounds)
    W, D, bend = np.zeros((k, p, 6)), np.zeros((k, p, 6, 6)), np.zeros((k, p, 6))
    for i, b in enumerate(bounds):
        if isinstance(b, BoundRelation):
            of, rows, s = b.relation, slice(b.size), velocity[i]
            W[i, rows] = of.weights(R[i], r[i])
            for j, e in enumerate(np.eye(6)):
                D[i, rows, j] = of.weights_rate(R[i], r[i], e)
            bend[i, rows] = (of.weights_bend(R[i], r[i], s) @ s).T
        elif b.is_rod:  # W = n, n' = -P s_lin
            v, distance = velocity[i, :3], np.linalg.norm(r[i])
            n = r[i] / distance
            P = (np.eye(3) - np.outer(n, n)) / distance
            W[i, 0, :3], D[i, 0, :3, :3] = n, -P
            bend[i, 0, :3] = -(2 * (n @ v) * (P @ v) + (v @ P @ v) * n) / distance
        else:
            W[i, :6] = np.eye(6)
            if b.is_about_c1:  # W = (1, r x; 0, 1)
                W[i, :3, 3:], D[i, :3, :3, 3:] = _skew(r[i]), _SWEPT
    return W, D, bend


_SWEPT: Final = -skews(np.eye(3)).swapaxes(0, 1)  # W' by each component of s_lin


def by_gap(b: Pair, R: Array, r: Array, W: Array) -> Array:
    """Partials (rows, 6) of c by delta: W, but for angles of gaps.

    With M = E1^-1 E2 and u = R e the axis of a hinge,

        d(-log6 M) = Jlog6(M) R^T delta,   d(-log R) = Jlog(R) R^T delta_ang,   du = u x delta_ang.
    """
    if not b.anchored or isinstance(b, BoundRelation) or b.is_rod:
        return b.anchored * W
    C = W.copy()
    if b.is_about_c1:
        C[:6] = pin.Jlog6(pin.SE3(R, r)) @ np.kron(np.eye(2), R.T)
    elif not b.is_hinge:
        C[3:6, 3:] = pin.Jlog3(R) @ R.T
    else:
        e = np.eye(3)[b.axis]
        u = R @ e
        across, cosine = _skew(u) @ e, float(u @ e)
        sine = float(np.linalg.norm(across))
        angle = np.arctan2(sine, cosine)
        scale = angle / sine if sine else 1.0
        bend = 1 / 3 if angle < _STRAIGHT else (1 - angle * cosine / sine) / sine**2
        C[3:6, 3:] = -(scale * _skew(e) + bend * np.outer(across, e)) @ _skew(u)
    return C


_STRAIGHT: Final = 1e-4  # [rad]; below, the series of (1 - angle cot(angle)) / sin^2 is exact


def of_point(
    b: Bound, one: End, two: End, c1Mc2: Any, lam: Array, drift: Baumgarte | None
) -> Partials:
    """Partials of a point, whose two forces act at both origins: they have no lever.

    J v = v1 - R v2,    J a + gamma = a1 - R a2,    c = -r
    """
    R, r, f = c1Mc2.rotation, c1Mc2.translation, b.sign * lam
    (_, a1_q, a1_v), (a2, a2_q, a2_v) = one.classical(), two.classical()
    Ja = one.J[3:] - R @ two.J[3:]
    J = one.J[:3] - R @ two.J[:3]
    s_q = a1_q - _skew(R @ a2) @ Ja - R @ a2_q
    v_q = one.v_q[:3] - _skew(R @ two.v[:3]) @ Ja - R @ two.v_q[:3]
    if drift:
        s_q = s_q + drift.Kp * b.anchored * (J - _skew(r) @ one.J[3:]) + drift.Kd * v_q
    w1, w2, nothing = (np.concatenate((x, np.zeros(3))) for x in (f, R.T @ f, 0.0 * f))
    w2_q = np.concatenate((-R.T @ _skew(f) @ Ja, np.zeros_like(Ja)))
    rows = (b.sign * x for x in (J, s_q, a1_v - R @ a2_v, v_q))
    return Partials(*rows, w1, w2, np.outer(nothing, nothing), w2_q)
