"""Partial derivatives by q and v of the rows of all constraints.

The linearised equations of one scene need

    -[[r_q, r_v], [s_q, s_v]],             r = M a + h - tau - J^T lam,    s = J a + gamma - a_ref.

Each group adds the turning of J^T lam to -r_q, the `pulls` (nv, nv), and writes `by_state`,
-[s_q, s_v] (m, 2 nv), and its rows of J.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Final, NamedTuple

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.drift import Baumgarte, gains
from condyn_pin.constraints.partials.motion import (
    A_Q,
    J_,
    V_Q,
    EndPartials,
    EndsAtState,
    FrameConstraints,
    FrameMotion,
    Frames,
    Pair,
    dual_cross,
    of_point,
)
from condyn_pin.constraints.rows.bound import BoundBetweenFrames, BoundConstraint
from condyn_pin.constraints.rows.frames import AXES, ONE, ROWS, PointEnds, rows_of
from condyn_pin.constraints.rows.functions import BoundFunctions
from condyn_pin.constraints.rows.special import (
    FLAT,
    BoundCoupling,
    BoundRelation,
    BoundRolling,
    skews,
)


class ConstraintPartials:
    """Partials of all constraints of one scene.

    `data` holds what `pin.computeRNEADerivatives` leaves.
    """

    def __init__(
        self, model: Any, data: Any, bounds: Sequence[BoundConstraint], drift: Baumgarte | None
    ) -> None:
        frames = Frames(model, data)
        self._bounds, self._drift = {b.name: b for b in bounds}, drift
        self._pairs = PairPartials(frames, bounds, drift)
        self._rolling = RollingPartials(frames, bounds, drift)
        self._points = PointPartials(model, data, bounds, drift)
        self._couplings = [b for b in bounds if isinstance(b, BoundCoupling)]
        self._own = [b.at_work() for b in bounds if isinstance(b, BoundFunctions)]
        on_joints = self._couplings or self._own
        # what makes arrays for `write`: zeros where there are couplings, all other rows are written
        self.make: Callable[[tuple[int, ...]], Array] = np.zeros if on_joints else np.empty

    def write(
        self, lam: Array, pulls: Array, by_state: Array, J: Array, ends: PointEnds | None = None
    ) -> None:
        """Write all rows but those of couplings into by_state and J, arrays made by `make`."""
        # `ends` are those of the loops of three rows, where this answer was evaluated already.
        if self._pairs.k:
            self._pairs.write(lam, pulls, by_state, J)
        if self._rolling.k:
            self._rolling.write(lam, pulls, by_state, J)
        if self._points.k:
            known = self._points.k == self._points.between
            self._points.write(lam, pulls, by_state, J, ends if known else None)

    def write_couplings(
        self, state: tuple[Array, Array, Array, Array], rhs: Array, J: Array
    ) -> None:
        """Write the rows on coordinates at (q, v, a, lam), and what bends of them in -r_q."""
        q, v, a, lam = state
        n = J.shape[1]
        by_state = rhs[n:]
        for b in self._couplings:
            row, columns = b.rows.start, b.columns
            J[row, columns] = b.bent(q, 1) if b.bends else b.weights
            drift = self._drift and (b.drift or self._drift)
            if drift:
                by_state[row, :n] = -drift.Kp * J[row]
                by_state[row, n:] = -drift.Kd * J[row]
            if b.bends:
                second, third, v_i = b.bent(q, 2), b.bent(q, 3), v[columns]
                Kd = drift.Kd if drift else 0.0
                rhs[columns, columns] += lam[row] * second
                by_state[row, columns] -= second * (a[columns] + Kd * v_i) + third * v_i**2
                by_state[row, [n + column for column in columns]] -= 2.0 * second * v_i
        for own in self._own:
            t = own.time
            J[own.rows], K = own.J(q, t), own.bend(q, t)
            K_v = np.einsum("rij,i->rj", K, v)  # partials of J v, and then of J v - b
            s_q = np.einsum("rij,i->rj", K, a) + own.gamma_q(q, v, t)
            s_v = K_v + K @ v
            if own.rheonomic:
                b_q = own.b_q(q, t)
                s_v += own.J_rate(q, 0.0 * v, t, 1.0) - b_q
                K_v -= b_q
            if drift := self._drift and (own.drift or self._drift):
                s_q += drift.Kd * K_v + drift.Kp * own.anchored * J[own.rows]
                s_v += drift.Kd * J[own.rows]
            by_state[own.rows, :n], by_state[own.rows, n:] = -s_q, -s_v
            rhs[:n, :n] += np.einsum("rij,r->ij", K, lam[own.rows])

    def turn_couplings(self, q: Array, w: Array, out: Array) -> None:
        """Write the partials (m, nv) of J w by q of couplings that bend."""
        for b in self._couplings:
            if b.bends:
                out[b.rows.start, b.columns] = b.bent(q, 2) * w[b.columns]
        for own in self._own:
            out[own.rows] = np.einsum("rij,i->rj", own.bend(q, own.time), w)

    def turning(self, out: Array) -> None:
        """Write the partials (m, nv) of J v by q, but for couplings."""
        for part in (self._pairs, self._rolling, self._points):
            if part.k:
                part.turning(out)

    def by_frame(self, name: str, lam: Array, end: int) -> tuple[Array, Array]:
        """Partials r (nv, 6) and s (rows, 6) by a twist of a constraint's c1 or c2, in its axes."""
        b = self._bounds[name]
        if isinstance(b, BoundRolling):
            return self._rolling.by_frame(b, lam[b.rows])
        assert isinstance(b, BoundBetweenFrames | BoundRelation)  # a coupling has no frames
        return self._pairs.by_frame(b, lam[b.rows], end)


# How the rows of constraints between two frames change with q and v: those of surfaces and edges on
# the world, of welds, cut joints, rods and relations, all at once by the chain rule of
# `condyn_pin.constraints.partials.motion`. Those of points, which have less to do, are below.


_skew = pin.skew


class PairPartials:
    """Partials of all constraints between two frames in one scene, but those of points."""

    def __init__(
        self, frames: Frames, bounds: Sequence[BoundConstraint], drift: Baumgarte | None
    ) -> None:
        self._frames, self._drift = frames, drift
        pairs = [
            b
            for b in bounds
            if isinstance(b, BoundRelation)
            or (isinstance(b, BoundBetweenFrames) and not b.is_point)
        ]
        self.k = len(pairs)
        # rows of one end; what pulls them back has two
        self._held = [
            b for b in pairs if not drift and isinstance(b, BoundBetweenFrames) and b.is_held
        ]
        self._between = between = [b for b in pairs if b not in self._held]
        self._kinds = FrameConstraints(between, drift) if between else None
        # a single one is quicker by itself
        self._ends = EndPartials(frames, between) if len(between) > 1 else None

    def write(self, lam: Array, pulls: Array, by_state: Array, J: Array) -> None:
        """Write J (m, nv) and by_state, -[s_q, s_v]; add the turning of J^T lam to pulls, -r_q."""
        size, n = J.shape
        for b in self._held:
            by = self._of_held(b)
            J[b.rows] = by[:, J_]
            np.negative(by[:, A_Q:], out=by_state[b.rows].reshape(-1, 2, n))
        if self._kinds:
            at, rows = self._at(), self._kinds.rows
            of = self._kinds.at(at)
            J[rows], by_state.reshape(size, 2, n)[rows] = of.by[:, J_], -of.by[:, A_Q:]
            *_, w1_q, w2_q = self._kinds.wrenches(of, lam[rows])
            if w1_q is not None:
                pulls += at.one.J.reshape(-1, n).T @ w1_q.reshape(-1, n)
            pulls -= at.two.J.reshape(-1, n).T @ w2_q.reshape(-1, n)

    def turning(self, out: Array) -> None:
        """Write the partials (m, nv) of J v by q."""
        for b in self._held:
            out[b.rows] = self._of_held(b)[:, V_Q]
        if self._kinds:
            out[self._kinds.rows] = self._kinds.at(self._at()).by[:, V_Q]

    def _of_held(self, b: BoundBetweenFrames) -> Array:
        """Partials (rows, 4, nv) of a frame's own velocity."""
        by = self._frames.partials(b.joint1, b.placement1)
        if b.size < 6:
            by = by[list(b.selection)]
        return by if b.sign > 0 else -by

    def _at(self) -> EndsAtState:
        """Ends of those between two frames."""
        return (
            self._ends.evaluate()
            if self._ends
            else EndsAtState.single(*self._frames.ends(*self._between))
        )

    def by_frame(self, b: Pair, lam: Array, end: int) -> tuple[Array, Array]:
        """Partials r (nv, 6) and s (rows, 6) by a twist of c1 or c2, of a ball too."""
        one, two, c1Mc2 = self._frames.ends(b)
        moving1, moving2 = (
            each.by_twist() if end == i else each.still() for i, each in ((1, one), (2, two))
        )
        if isinstance(b, BoundBetweenFrames) and b.is_point:
            drift = self._drift and (b.drift or self._drift)
            by, of = of_point(b, moving1, moving2, c1Mc2, lam, drift)
        else:
            kind = FrameConstraints([b], self._drift)
            rows = kind.at(EndsAtState.single(moving1, moving2, c1Mc2))
            by, of = rows.by, kind.wrenches(rows, lam)
        w1 = np.zeros((6, 6)) if of.w1_q is None else of.w1_q.reshape(6, 6)
        w2, f = of.w2_q.reshape(6, 6), of.f.reshape(6)
        if end == 1:
            w1 = w1 + dual_cross(of.to1.reshape(6, 6) @ f)
        else:
            w2 = w2 + dual_cross(of.to2.reshape(6, 6) @ f)
        return two.J.T @ w2 - one.J.T @ w1, by[:, A_Q]


# How the rows of all points change with q and v, at fixed accelerations.
#
# A point of one moving body on a point of another, or on one of the world. In axes of the world.
# `pin.computeRNEADerivatives` leaves a column a joint coordinate, linear part at the world's
# origin: J, dV, dA and dA_v, the parts in the axes of the body of what q and v do to the velocity
# and the acceleration of every body that moves with it. A point at p with the velocity p' has, of
# each of them, lin + ang x p; and since its acceleration is the classical one,
#
#     J         J_lin + J_ang x p
#     v_q       dV_lin + dV_ang x p
#     a_q       dA_lin + dA_ang x p + 2 dV_ang x p'
#     a_v       dA_v_lin + dA_v_ang x p + 2 J_ang x p'
#
# The rows are the difference of two points in the axes of c1. With Ja the angular part of J, body
# 1's less body 2's,
#
#     s_q = R1^T (a1_q - a2_q - a2 x Ja),         s_v = R1^T (a1_v - a2_v),
#     v_q = R1^T (v1_q - v2_q - v2 x Ja),         c_q = R1^T (J1 - J2 - (p2 - p1) x Ja_1),
#
# and the force F = R1 lam, fixed in c1, turns on body 2: J^T lam changes by J2^T F x Ja. One
# product does for all points: 1, p x, p2'' x, p' x and F x of either end, each where it is wanted,
# with the columns that all of them meet, J, dA, dA_v and dJ, for dV = dA_v - dJ. On the world all
# of body 2 is zero.


# What is known of an end, by its rows in `PointEnds.places`: p, p', p'' and F.
_P, _P1, _P2, _F = 3, 4, 5, 6
_MOVING: Final = slice(3 * (_P1 - _P), 3 * (_P2 - _P))  # where `PointEnds.known` has p'
# Where its columns begin: linear and angular ones of J, dA, dA_v and dJ.
_J, _J_ANG, _A, _A_ANG, _AV, _AV_ANG, _DJ_ANG, _DJ = range(0, 24, 3)


def _factors(*terms: tuple[int, float, int | None, int]) -> Array:
    """Map from the known quantities of an end to the factors of its first columns."""
    # Of terms (part, number, x, columns), with x None for the product with 1. There are three rows
    # a part, and the parts alternate: the x of all of them come first.
    parts = 1 + max(part for part, *_ in terms)
    of = np.zeros((ROWS, 3, 3, parts, 3 + max(columns for *_, columns in terms)))
    for part, number, x, columns in terms:
        three = slice(columns, columns + 3)
        if x is None:
            of[ONE, 0, :, part, three] += number * np.eye(3)
        else:
            for i, e in enumerate(np.eye(3)):
                of[x, i, :, part, three] += number * pin.skew(e)
    return np.ascontiguousarray(of[AXES.stop :].reshape(3 * (ROWS - AXES.stop), -1))


# Of J, -a_q and -a_v, where c1 has the p2'' of its c2, and of F x Ja.
_ACCELERATED: Final = (
    (0, 1.0, None, _J), (0, -1.0, _P, _J_ANG),
    (1, -1.0, None, _A), (1, 1.0, _P, _A_ANG), (1, 1.0, _P2, _J_ANG),
    (1, 2.0, _P1, _AV_ANG), (1, -2.0, _P1, _DJ_ANG),
    (2, -1.0, None, _AV), (2, 1.0, _P, _AV_ANG), (2, 2.0, _P1, _J_ANG),
)  # fmt: skip
_PUSHED: Final = (3, 1.0, _F, _J_ANG)
# Of v_q, where c1 has the p2' of its c2.
_MOVED: Final = _factors(
    (0, 1.0, None, _AV), (0, -1.0, None, _DJ), (0, -1.0, _P, _AV_ANG), (0, 1.0, _P, _DJ_ANG),
    (0, -1.0, _P1, _J_ANG),
)  # fmt: skip


class PointPartials:
    """Partials of all points in one scene.

    `data` holds what `pin.computeRNEADerivatives` leaves.

    k, between: how many points there are; of these, how many between two moving bodies
    """

    def __init__(
        self, model: Any, data: Any, bounds: Sequence[BoundConstraint], drift: Baumgarte | None
    ) -> None:
        self._data, self._drift, self._n = data, drift, model.nv
        points = [b for b in bounds if isinstance(b, BoundBetweenFrames) and b.is_point]
        points.sort(key=lambda b: b.joint2 == 0)  # those between two bodies come first
        self.k, self.between = k, between = len(points), sum(b.joint2 > 0 for b in points)
        self._rows, self._ends = rows_of(points), PointEnds(data, points)
        if drift:
            self._Kp, self._Kd = (each.reshape(k, 3, 1) for each in gains(points, drift))
        self._signs = np.array([b.sign for b in points]).reshape(k, 1, 1)
        self._anchored = np.array([float(b.anchored) for b in points]).reshape(k, 1, 1)
        # which columns move the bodies of c1, and those of c2 where they move
        moves = _moving_columns(model, points) * self._signs[:, :, :, None]
        self._moved = np.concatenate((moves[0], moves[1, :between]))
        self._make_room(data, model.nv)
        self._chosen = np.ascontiguousarray(np.broadcast_to(self._moved, self._parts.shape))

    def _make_room(self, data: Any, n: int) -> None:
        """Allocate columns and parts, and make the views into them."""
        k, between = self.k, self.between
        # views into data's own memory; of a single coordinate Pinocchio has vectors
        J, A, A_v, dJ = (part.reshape(6, n) for part in (data.J, data.dAdq, data.dAdv, data.dJ))
        self._left, self._columns = (J, A, A_v, dJ[3:], dJ[:3]), np.zeros((24, n))
        self._first_columns = self._columns[:_DJ]  # what accelerations change with
        # J, -a_q and -a_v, and F x Ja where a body 2 moves
        kinds = 4 if between else 3
        self._accelerated = _factors(*_ACCELERATED, *([_PUSHED] if between else []))
        self._flat_parts = np.zeros((3 * kinds * (k + between), n))
        self._parts = parts = self._flat_parts.reshape(k + between, 3, kinds, n)
        self._slip_between, self._of_c2 = parts[:between], parts[k:]
        self._stacked_slip = parts[:k].reshape(k, 3, kinds * n)
        self._J2T = parts[k:, :, 0].reshape(-1, n).T
        self._turned = parts[:between, :, -1].reshape(-1, n)
        self._rotated = np.zeros((k, 3, kinds * n))
        rows = self._rotated.reshape(3 * k, kinds, n)
        self._J, self._by_state = rows[:, 0], rows[:, 1:3]

    def write(
        self, lam: Array, pulls: Array, by_state: Array, J: Array, ends: PointEnds | None = None
    ) -> None:
        """Write J (m, nv) and by_state, -[s_q, s_v]; add the turning of J^T lam to pulls, -r_q."""
        # `ends` are those of all points, if they were evaluated with this lam already.
        ends = ends or self._evaluated(lam)
        ends.of_c1[:] = ends.of_c2
        np.concatenate(self._left, out=self._columns)
        self._of_ends(ends.known, self._accelerated, self._first_columns, self._flat_parts)
        self._parts *= self._chosen
        self._slip_between -= self._of_c2
        np.matmul(ends.axes1, self._stacked_slip, out=self._rotated)
        parts = by_state.reshape(-1, 2, self._n)
        J[self._rows], parts[self._rows] = self._J, self._by_state
        if self.between:
            pulls += self._J2T.dot(self._turned)
        if self._drift:
            by_q = self._Kp * self._c_q(ends, J)
            by_q += self._Kd * self._v_q(ends)
            parts[self._rows, 0] -= by_q.reshape(-1, self._n)

    def turning(self, out: Array) -> None:
        """Write v_q (m, nv) of these rows."""
        self._ends.evaluate()
        np.concatenate(self._left, out=self._columns)
        out[self._rows] = self._v_q(self._ends).reshape(-1, self._n)

    def _evaluated(self, lam: Array) -> PointEnds:
        """Ends of the points, with the forces of those between two bodies."""
        self._ends.evaluate()
        if self.between:
            self._ends.push(self._signs * lam[self._rows].reshape(-1, 1, 3))
        return self._ends

    def _of_ends(
        self, known: Array, factors: Array, columns: Array, out: Array | None = None
    ) -> Array:
        """Products of the columns with some factors, of c1 and after them of c2."""
        known = known[: self.k + self.between]
        return known.dot(factors).reshape(-1, len(columns)).dot(columns, out)  # type: ignore[no-any-return]

    def _v_q(self, ends: PointEnds) -> Array:
        """Partials of J v by q (k, 3, nv)."""
        known = ends.known.copy()
        known[: self.k, _MOVING] = known[self.k :, _MOVING]
        parts = self._of_ends(known, _MOVED, self._columns).reshape(-1, 3, self._n)
        parts *= self._moved[:, 0]
        parts[: self.between] -= parts[self.k :]
        return np.asarray(ends.axes1 @ parts[: self.k])

    def _c_q(self, ends: PointEnds, J: Array) -> Array:
        """Partials of the violation (k, 3, nv), zero without an anchor."""
        apart = skews(ends.places[1, :, _P] - ends.places[0, :, _P])
        turned = ends.axes1 @ apart @ (self._moved[: self.k, 0] * self._left[0][3:])
        return np.asarray(self._anchored * (J[self._rows].reshape(self.k, 3, -1) - turned))


def _moving_columns(model: Any, points: Sequence[BoundBetweenFrames]) -> Array:
    """Flags (2, k, 1, 1, nv) as numbers: one for a column that moves the body of c1, or of c2."""
    moved = np.zeros((2, len(points), 1, 1, model.nv))
    for i, b in enumerate(points):
        for end, joint in enumerate((b.joint1, b.joint2)):
            for above in list(model.supports[joint])[1:]:
                at = model.idx_vs[above]
                moved[end, i, ..., at : at + model.nvs[above]] = 1.0
    return moved


# How the rows of what rolls change with q and v, at fixed accelerations and forces.
#
# The rows are in `condyn_pin.constraints.rows.special`: T s' + T' s, with T and r turning as the
# normal does in the axes of the body. So each of these vectors x is carried along with its partials
# x_q, its rate x' and the partials x'_q; those by v need no room, x'_v = x_q. For what is fixed in
# the world,
#
#     x_q = x x J_w,    x' = x x w,    x'_q = -w x x_q + x x w_q,
#
# and the product rule does the rest.


class RollingPartials:
    """Partials of all rolling constraints in one scene."""

    def __init__(
        self, frames: Frames, bounds: Sequence[BoundConstraint], drift: Baumgarte | None
    ) -> None:
        self._frames, self._drift = frames, drift
        self._bounds = [b for b in bounds if isinstance(b, BoundRolling)]
        self.k = len(self._bounds)

    def write(self, lam: Array, pulls: Array, by_state: Array, J: Array) -> None:
        """Write J (m, nv) and by_state, -[s_q, s_v]; add the turning of J^T lam to pulls, -r_q."""
        n = J.shape[1]
        for b in self._bounds:
            one = self._frames.end(b.joint1, b.placement1)
            of = self._rows(b, one, lam[b.rows])
            J[b.rows] = of.J
            by_state[b.rows, :n], by_state[b.rows, n:] = -of.s_q, -of.s_v
            pulls += one.J.T @ of.wrench_q

    def turning(self, out: Array) -> None:
        """Write the partials (m, nv) of J v by q."""
        for b in self._bounds:
            out[b.rows] = v_q_of_touch(self._touch(b, self._frames.end(b.joint1, b.placement1)))

    def by_frame(self, b: BoundRolling, lam: Array) -> tuple[Array, Array]:
        """Partials r (nv, 6) and s (rows, 6) by a twist of the middle frame on its body."""
        one = self._frames.end(b.joint1, b.placement1)
        of = self._rows(b, one.by_twist(), lam)
        return -one.J.T @ (of.wrench_q + dual_cross(self._wrench(b, lam))), of.s_q

    def _rows(self, b: BoundRolling, one: FrameMotion, lam: Array) -> FrameRowPartials:
        """Partials of one constraint; s_q includes the drift control."""
        touch = self._touch(b, one)
        of = rows_of_touch(touch, lam)
        if self._drift:
            c_q = np.zeros_like(of.J)
            held = [row - b.rows.start for row in b.positioned]
            c_q[held] = of.J[held]  # the rate of the gap is J v
            v_q = v_q_of_touch(touch)
            drift = b.drift or self._drift
            of = of._replace(s_q=of.s_q + drift.Kp * c_q + drift.Kd * v_q)
        return of

    def _touch(self, b: BoundRolling, one: FrameMotion) -> Touch:
        R = (self._frames.data.oMi[b.joint1] * b.placement1).rotation.T @ b.placement2.rotation
        return touch_of(b, one, R)

    def _wrench(self, b: BoundRolling, lam: Array) -> Array:
        """Wrench (6,) of a force at the origin of c1, in its axes."""
        oMi = self._frames.data.oMi[b.joint1]
        at_point = pin.Force(b.whole(lam), np.zeros(3))
        return np.array((oMi * b.placement1).actInv(b.touching(oMi)).act(at_point).vector)


class Vector(NamedTuple):
    """Vector in the axes of the body, its rate, and their partials by q."""

    x: Array  # (3,)
    x_q: Array  # (3, nv)
    dot: Array  # (3,)
    dot_q: Array  # (3, nv)

    def mapped(self, A: Array) -> Vector:
        """Product A x with a constant matrix."""
        return Vector(*(A @ part for part in self))

    def cross(self, y: Vector) -> Vector:
        """Cross product x x y."""
        X, Y, X_dot, Y_dot = (_skew(part) for part in (self.x, y.x, self.dot, y.dot))
        return Vector(
            X @ y.x,
            X @ y.x_q - Y @ self.x_q,
            X_dot @ y.x + X @ y.dot,
            X_dot @ y.x_q + X @ y.dot_q - Y_dot @ self.x_q - Y @ self.dot_q,
        )

    def unit(self) -> Vector:
        """Unit vector x / |x|; zero where x vanishes."""
        size = float(np.linalg.norm(self.x))
        shrink = 1.0 / size if size > FLAT else 0.0
        x = shrink * self.x
        across = shrink * (np.eye(3) - np.outer(x, x))
        x_q, dot = across @ self.x_q, across @ self.dot
        # dot |x| = x' - x (x . x'), differentiated
        along, along_q = x @ self.dot, self.dot @ x_q + x @ self.dot_q
        dot_q = shrink * (self.dot_q - np.outer(x, along_q) - along * x_q)
        return Vector(x, x_q, dot, dot_q - shrink * np.outer(dot, x @ self.x_q))


class Touch(NamedTuple):
    """Lowest point r, axes of the rows that are held, and slip with its rate."""

    r: Vector
    axes: tuple[Vector, ...]
    slip: Array  # (3,), s
    slip_q: Array  # (3, nv)
    slip_v: Array
    rate: Array  # (3,), s'
    rate_q: Array
    rate_v: Array


class FrameRowPartials(NamedTuple):
    """Partial derivatives of the rows, and of their wrench at the origin of c1, in its axes."""

    J: Array  # (rows, nv)
    s_q: Array  # (rows, nv), of J a + gamma
    s_v: Array  # (rows, nv)
    wrench_q: Array  # (6, nv)


def touch_of(b: BoundRolling, one: FrameMotion, R: Array) -> Touch:
    """Contact point of a rolling constraint; R turns vectors of the plane into the body's axes."""
    n = _fixed_in_world(one, R[:, 2])
    if b.axle is None:
        t, r = _fixed_in_world(one, R[:, 0]), n.mapped(-b.radius * np.eye(3))
    else:
        e = _skew(np.eye(3)[b.axle])
        t = n.mapped(e).unit()
        r = t.mapped(b.radius * e)
    axes = (t, n.cross(t), n)
    W, A, r_x, r_dot_x = (_skew(x) for x in (one.v[3:], one.a[3:], r.x, r.dot))
    return Touch(
        r,
        tuple(axes[i] for i in b.selection),
        slip=one.v[:3] + W @ r.x,
        slip_q=one.v_q[:3] - r_x @ one.v_q[3:] + W @ r.x_q,
        slip_v=one.J[:3] - r_x @ one.J[3:],
        rate=one.a[:3] + A @ r.x + W @ r.dot,
        rate_q=one.a_q[:3] - r_x @ one.a_q[3:] + A @ r.x_q + W @ r.dot_q - r_dot_x @ one.v_q[3:],
        rate_v=one.a_v[:3] - r_x @ one.a_v[3:] + W @ r.x_q - r_dot_x @ one.J[3:],
    )


def rows_of_touch(of: Touch, lam: Array) -> FrameRowPartials:
    """Partials of the rows and of the force lam."""
    J = np.array([t.x @ of.slip_v for t in of.axes])
    s_q = np.array(
        [t.x @ of.rate_q + of.rate @ t.x_q + t.dot @ of.slip_q + of.slip @ t.dot_q for t in of.axes]
    )
    s_v = np.array([t.x @ of.rate_v + t.dot @ of.slip_v + of.slip @ t.x_q for t in of.axes])
    force = sum((f * t.x for f, t in zip(lam, of.axes, strict=True)), np.zeros(3))
    force_q = sum((f * t.x_q for f, t in zip(lam, of.axes, strict=True)), np.zeros_like(of.slip_q))
    moment_q = _skew(of.r.x) @ force_q - _skew(force) @ of.r.x_q
    return FrameRowPartials(J, s_q, s_v, np.concatenate([force_q, moment_q]))


def v_q_of_touch(of: Touch) -> Array:
    """Partials of J v by q."""
    return np.array([t.x @ of.slip_q + of.slip @ t.x_q for t in of.axes])


def _fixed_in_world(one: FrameMotion, x: Array) -> Vector:
    X, w = _skew(x), one.v[3:]
    x_q = X @ one.J[3:]
    return Vector(x, x_q, X @ w, X @ one.v_q[3:] - _skew(w) @ x_q)
