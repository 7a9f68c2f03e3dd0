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
from condyn_pin.constraints.drift import Baumgarte, gains
from condyn_pin.constraints.rows.bound import BoundBetweenFrames, TwoFrameConstraint, length
from condyn_pin.constraints.rows.frames import Ends, Joints, indices, rows_of
from condyn_pin.constraints.rows.special import BoundRelation, skews

_skew = pin.skew

# A constraint between two frames, but for points.
Pair: TypeAlias = BoundBetweenFrames | BoundRelation


# Places in `FrameMotion.by` of the partials of a velocity by q and v, and of its rate by q and v.
V_Q, J_, A_Q, A_V = range(4)


class FrameMotion(NamedTuple):
    """Velocity, its rate, and the partials of both: of a frame in its own axes, or of many."""

    v: Array  # (6,)
    a: Array  # (6,), spatial of a frame
    by: Array  # (6, 4, nv)

    @property
    def v_q(self) -> Array:
        """Partials (6, nv) of the velocity by q."""
        return self.by[..., V_Q, :]

    @property
    def J(self) -> Array:
        """Partials (6, nv) of the velocity by v."""
        return self.by[..., J_, :]

    @property
    def a_q(self) -> Array:
        """Partials (6, nv) of the rate by q."""
        return self.by[..., A_Q, :]

    @property
    def a_v(self) -> Array:
        """Partials (6, nv) of the rate by v."""
        return self.by[..., A_V, :]

    def mapped(self, X: Array) -> FrameMotion:
        """Motions X v of many, with constant matrices (k, 6, 6)."""
        v, a = _times(X, np.array((self.v, self.a)))
        return FrameMotion(v, a, _each(X, self.by))

    def classical(self) -> tuple[Array, Array, Array]:
        """Acceleration of the origin of one frame, and its partials by q and v."""
        v, w = self.v[:3], self.v[3:]
        W, V = _skew(w), _skew(v)
        return (
            self.a[:3] + W @ v,
            self.a_q[:3] + W @ self.v_q[:3] - V @ self.v_q[3:],
            self.a_v[:3] + W @ self.J[:3] - V @ self.J[3:],
        )

    def still(self) -> FrameMotion:
        """Frame that does not change by a twist of the other."""
        return FrameMotion(self.v, self.a, np.zeros((6, 4, 6)))

    def by_twist(self) -> FrameMotion:
        """Frame with its partials by a twist of it on its body."""
        by = spatial_cross(self.v), np.eye(6), spatial_cross(self.a), np.zeros((6, 6))
        return FrameMotion(self.v, self.a, np.stack(by, axis=1))


def relative_motion(
    one: FrameMotion, two: FrameMotion, X: Array, lever: Array | None
) -> FrameMotion:
    """Motion of body 1 relative to body 2 in the axes of c1, at the origin of c2."""
    # X maps motions at c2 to those axes, and `lever` those at c1 to the origin of c2; without it
    # the origin is that of c1, and X maps to there.
    # As spatial motions, of frames that both bodies carry at the same place,
    #     s = v1 - X v2,    s' = a1 - X a2 + s x X v2,
    # and as the origin of c2 moves on body 1, r' = -s_lin, there is s_lin x s_ang in s_lin'
    # besides.
    if lever is not None:
        one = one.mapped(lever)
    two = two.mapped(X)
    s, by = one.v - two.v, one.by - two.by
    turns = spatial_cross(np.array((two.v, two.a, s, one.v)))
    by_J, by_s, by_v1 = turns[:2].swapaxes(0, 1), turns[2], turns[3]
    J = by[:, None, :, J_]
    by[:, :, ::A_Q] -= (by_J @ J).swapaxes(1, 2)
    by[:, :, A_Q:] += _each(by_s, one.by[:, :, :A_Q]) - _each(by_v1, by[:, :, :A_Q])
    rate = one.a - two.a + _times(by_s, two.v)
    if lever is not None:
        lin, p, w = by[:, :3], s[:, :3], s[:, 3:]
        by_p, by_w, by_alpha = skews(np.array((p, w, rate[:, 3:])))
        by_J = np.stack((by_w, by_alpha), axis=1)
        lin[:, :, ::A_Q] -= (by_J @ J[:, :, :3]).swapaxes(1, 2)
        lin[:, :, A_Q:] += _each(by_p, by[:, 3:, :A_Q]) - _each(by_w, lin[:, :, :A_Q])
        rate[:, :3] += _times(by_p, w)
    return FrameMotion(s, rate, by)


def _each(A: Array, by: Array) -> Array:
    """Products of matrices (k, i, j) with partials (k, j, s, nv)."""
    k, j, parts, n = by.shape
    return (A @ by.reshape(k, j, -1)).reshape(k, -1, parts, n)


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


class EndsAtState(NamedTuple):
    """Ends of k constraints at one state."""

    one: FrameMotion
    two: FrameMotion
    X: Array  # (k, 6, 6), motions in c2 to those in c1
    R: Array  # (k, 3, 3), c1Mc2
    r: Array  # (k, 3)

    @classmethod
    def single(cls, one: FrameMotion, two: FrameMotion, c1Mc2: Any) -> EndsAtState:
        """Ends of one constraint."""
        many1, many2 = (FrameMotion(end.v[None], end.a[None], end.by[None]) for end in (one, two))
        X, R, r = c1Mc2.toActionMatrix(), c1Mc2.rotation, c1Mc2.translation
        return cls(many1, many2, X[None], R[None], r[None])

    @property
    def turn(self) -> Array:
        """Matrices (k, 6, 6) from the axes of c2 to those of c1."""
        turn = self.X.copy()
        turn[:, :3, 3:] = 0.0
        return turn

    @property
    def lever(self) -> Array:
        """Matrices (k, 6, 6) of motions at the origin of c1 to those at that of c2."""
        lever = np.zeros((len(self.R), 6, 6))
        lever[:] = np.eye(6)
        lever[:, :3, 3:] = -skews(self.r)
        return lever


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

    def evaluate(self) -> EndsAtState:
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
        R = axes[:k] @ axes[k:].swapaxes(1, 2)
        r = (axes[:k] @ (E[k:, 3] - E[:k, 3])[:, :, None])[:, :, 0]
        between = np.zeros((k, 6, 6))
        between[:, :3, :3] = between[:, 3:, 3:] = R
        between[:, :3, 3:] = skews(r) @ R
        return EndsAtState(
            FrameMotion(v[:k], a[:k], parts[:k]),
            FrameMotion(v[k:], a[k:], parts[k:]),
            between,
            R,
            r,
        )


class Frames:
    """Frames of the constraints, by Pinocchio's derivatives in its data."""

    def __init__(self, model: Any, data: Any) -> None:
        self._model, self.data = model, data
        self._world = FrameMotion(np.zeros(6), np.zeros(6), np.zeros((6, 4, model.nv)))

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

    def ends(self, b: Pair) -> tuple[FrameMotion, FrameMotion, Any]:
        """Ends c1 and c2, and their relative placement c1Mc2."""
        c1, c2 = b.placed(self.data.oMi)
        one, two = self.end(b.joint1, b.placement1), self.end(b.joint2, b.placement2)
        return one, two, c1.actInv(c2)

    def end(self, joint: int, placement: Any) -> FrameMotion:
        """Frame on a joint as the end of a constraint."""
        if joint == 0:
            return self._world
        v, a = placement.actInv(self.data.v[joint]), placement.actInv(self.data.a[joint])
        return FrameMotion(v.vector, a.vector, self.partials(joint, placement))

    def partials(self, joint: int, placement: Any) -> Array:
        """Partials (6, 4, nv) of the motion of a frame on a joint."""
        v_q, a_q, a_v, J = pin.getFrameAccelerationDerivatives(
            self._model, self.data, joint, placement, LOCAL
        )
        if self._model.nv == 1:  # Pinocchio gives vectors
            return np.stack((v_q, J, a_q, a_v), axis=1)[:, :, None]
        return np.concatenate((v_q, J, a_q, a_v), axis=1).reshape(6, 4, -1)


def dual_crosses(wrenches: Array) -> Array:
    """Matrices D (k, 6, 6) with D x = x x* wrench, for a spatial motion x."""
    D = np.zeros((len(wrenches), 6, 6))
    F, T = skews(-wrenches.reshape(-1, 2, 3)).swapaxes(0, 1)
    D[:, :3, 3:] = D[:, 3:, :3] = F
    D[:, 3:, 3:] = T
    return D


def dual_cross(wrench: Array) -> Array:
    """Matrix D of one wrench."""
    return np.asarray(dual_crosses(wrench[None])[0])


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


class FrameRows(NamedTuple):
    """Rows of some constraints, with what they are made of."""

    by: Array  # (rows, 4, nv), partials of J v, and of J a + gamma with what pulls the rows back
    J: Array  # (k, 6, nv), of s
    X: Array  # (k, 6, 6), motions at c2 to those in the axes of c1, where s is
    lever: Array | None  # (k, 6, 6), motions at c1 to where s is; None if that is c1
    weights: tuple[Array, Array] | None  # W and D; None if the rows are some of s


class WrenchPartials(NamedTuple):
    """Wrenches on both bodies, and their partials."""

    f: Array  # (k, 6), W^T lam
    to1: Array  # (k, 6, 6), f to the wrench on body 1 at the origin of c1, in its axes
    to2: Array  # (k, 6, 6), f to the opposite of that on body 2, at c2
    w1_q: Array | None  # (k, 6, nv), of the wrenches on body 1; None where they are fixed
    w2_q: Array


_ONE: Final = np.eye(6)


class FrameConstraints:
    """Constraints between two frames, with their weights.

    Each has p rows here, of which `chosen` are those that it has.
    """

    def __init__(self, bounds: Sequence[Pair], drift: Baumgarte | None) -> None:
        self._bounds, self._drift = bounds, drift
        of_six = (isinstance(b, BoundBetweenFrames) and not b.is_rod for b in bounds)
        self._p = p = max(6 if six else b.size for b, six in zip(bounds, of_six, strict=True))
        self.rows = rows_of(bounds)
        self._chosen = indices([p * i + j for i, b in enumerate(bounds) for j in b.of_six])
        self.signs = np.concatenate([np.full((b.size, 1), b.sign) for b in bounds])
        # rows of the motion at the origin of c1, of c2, or weighed ones of the latter
        self._about_c1 = all(isinstance(b, BoundBetweenFrames) and b.is_about_c1 for b in bounds)
        are_cut = all(isinstance(b, BoundBetweenFrames) and b.is_cut for b in bounds)
        self._weigh, self._signed = not (self._about_c1 or are_cut), bool((self.signs < 0).any())
        if drift:
            self._Kp, self._Kd = (each[:, None] for each in gains(bounds, drift))

    def at(self, at: EndsAtState) -> FrameRows:
        """Rows at the ends of one state."""
        k, p, lever = len(self._bounds), self._p, None if self._about_c1 else at.lever
        X = at.X if lever is None else at.turn
        of, weights = relative_motion(at.one, at.two, X, lever), None
        by, J, W = of.by, of.J, _ONE
        if self._weigh:
            W, D, bend = weights_of(self._bounds, p, at.R, at.r, of.v)
            by_delta = _times(D, np.array((of.v, of.a))[:, :, None])  # D(delta) s, D(delta) s'
            D_s = (of.v[:, None, None] @ D)[:, :, 0] + by_delta[0]
            by_delta[1] += bend
            by, weights = _each(W, of.by), (W, D)
            by[:, :, ::A_Q] += (by_delta @ J).transpose(1, 2, 0, 3)
            by[:, :, A_Q:] += _each(D_s, of.by[:, :, :A_Q])
        by = by.reshape(k * p, 4, -1)[self._chosen]
        if self._signed:
            by = by * self.signs[:, :, None]
        if self._drift:
            by[:, A_Q] += self._Kp * self._c_q(at, W, J) + self._Kd * by[:, V_Q]
        return FrameRows(by, J, X, lever, weights)

    def wrenches(self, rows: FrameRows, lam: Array) -> WrenchPartials:
        """Wrenches of the forces lam (rows,)."""
        _, J, X, lever, weights = rows
        k, p, XT = len(J), self._p, X.swapaxes(1, 2)
        f = np.zeros((k, p))
        f.reshape(-1)[self._chosen] = self.signs[:, 0] * lam
        if weights:
            W, D = weights
            f_q = (f[:, None] @ D.reshape(k, p, 36)).reshape(k, 6, 6).swapaxes(1, 2)
            f = (f[:, None] @ W)[:, 0]
        turned = dual_crosses(f)
        if lever is None:
            return WrenchPartials(f, _ONE[None], XT, None, XT @ turned @ J)
        # the lever of body 1 changes, not that of body 2
        w1_q, to1 = np.zeros((k, 6, 6)), lever.swapaxes(1, 2)
        w1_q[:, 3:, :3], turned[:, 3:, :3] = -turned[:, 3:, :3], 0.0
        if weights:
            w1_q, turned = w1_q + to1 @ f_q, turned + f_q
        return WrenchPartials(f, to1, XT, w1_q @ J, XT @ turned @ J)

    def _c_q(self, at: EndsAtState, W: Array, J: Array) -> Array:
        """Partials of c (rows, nv)."""
        W = np.broadcast_to(W, (len(self._bounds), self._p, 6))
        C = np.stack([by_gap(*each) for each in zip(self._bounds, at.R, at.r, W, strict=True)])
        if self._about_c1:
            C = C @ at.lever
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
            v, distance = velocity[i, :3], length(r[i])
            n = r[i] / distance
            P = (_ONE[:3, :3] - n[:, None] * n) / distance
            W[i, 0, :3], D[i, 0, :3, :3] = n, -P
            Pv = P @ v
            bend[i, 0, :3] = (2 * (n @ v) * Pv + (v @ Pv) * n) / -distance
        else:
            W[i, :6] = np.eye(6)
            if b.is_about_c1:  # W = (1, r x; 0, 1)
                W[i, :3, 3:], D[i, :3, :3, 3:] = _skew(r[i]), _SWEPT
    return W, D, bend


_SWEPT: Final = -skews(np.eye(3)).swapaxes(0, 1)  # W' by each component of s_lin


def by_gap(b: Pair, R: Array, r: Array, W: Array) -> Array:
    """Partials (rows, 6) of c by delta: W, but for angles of gaps."""
    # With M = E1^-1 E2 and u = R e the axis of a hinge,
    # d(-log6 M) = Jlog6(M) R^T delta, d(-log R) = Jlog(R) R^T delta_ang, du = u x delta_ang.
    if isinstance(b, BoundRelation):
        placed = [row - b.rows.start for row in b.positioned]
        return np.isin(np.arange(len(W)), placed)[:, None] * W
    if not b.anchored or b.is_rod:
        return b.anchored * W
    C = W.copy()
    if b.is_about_c1:
        C[:6] = pin.Jlog6(pin.SE3(R, r)) @ np.kron(np.eye(2), R.T)
    elif not b.is_aligned:
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
    b: BoundBetweenFrames,
    one: FrameMotion,
    two: FrameMotion,
    c1Mc2: Any,
    lam: Array,
    drift: Baumgarte | None,
) -> tuple[Array, WrenchPartials]:
    """Partials (3, 4, 6) of a point, whose two forces act at both origins: they have no lever."""
    # J v = v1 - R v2,    J a + gamma = a1 - R a2,    c = -r
    R, r, f = c1Mc2.rotation, c1Mc2.translation, b.sign * lam
    (_, a1_q, a1_v), (a2, a2_q, a2_v) = one.classical(), two.classical()
    Ja = one.J[3:] - R @ two.J[3:]
    J = one.J[:3] - R @ two.J[:3]
    s_q = a1_q - _skew(R @ a2) @ Ja - R @ a2_q
    v_q = one.v_q[:3] - _skew(R @ two.v[:3]) @ Ja - R @ two.v_q[:3]
    if drift:
        s_q = s_q + drift.Kp * b.anchored * (J - _skew(r) @ one.J[3:]) + drift.Kd * v_q
    w2_q = np.concatenate((-R.T @ _skew(f) @ Ja, np.zeros_like(Ja)))
    six, to2 = np.concatenate((f, np.zeros(3))), np.kron(np.eye(2), R.T)
    rows = b.sign * np.stack((v_q, J, s_q, a1_v - R @ a2_v), axis=1)
    return rows, WrenchPartials(six, _ONE, to2, None, w2_q)
