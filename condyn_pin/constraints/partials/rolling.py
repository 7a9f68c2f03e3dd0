"""How the rows of what rolls change with q and v, at fixed accelerations and forces.

The rows are in `condyn_pin.constraints.rows.rolling`: T s' + T' s, with T and r turning as the
normal does in the axes of the body. So each of these vectors x is carried along with its partials
x_q, its rate x' and the partials x'_q; those by v need no room, x'_v = x_q. For what is fixed in
the world,

    x_q = x x J_w,    x' = x x w,    x'_q = -w x x_q + x x w_q,

and the product rule does the rest.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.baumgarte import Baumgarte
from condyn_pin.constraints.partials.formulas import End, Frames, dual_cross
from condyn_pin.constraints.rows.any_bound import AnyBound
from condyn_pin.constraints.rows.rolling import FLAT, Rolled

_skew = pin.skew


class RollingPartials:
    """The partials of all that rolls in one scene."""

    def __init__(self, frames: Frames, bounds: Sequence[AnyBound], drift: Baumgarte | None) -> None:
        self._frames, self._drift = frames, drift
        self._bounds = [b for b in bounds if isinstance(b, Rolled)]
        self.k = len(self._bounds)

    def write(self, lam: Array, pulls: Array, by_state: Array, J: Array) -> None:
        """Write J (m, nv) and by_state, -[s_q, s_v]; add what turns of J^T lam to pulls, -r_q."""
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

    def by_frame(self, b: Rolled, lam: Array) -> tuple[Array, Array]:
        """Return r (nv, 6) and s (rows, 6) by a twist of the frame in the middle on its body."""
        one = self._frames.end(b.joint1, b.placement1)
        of = self._rows(b, one.by_twist(), lam)
        return -one.J.T @ (of.wrench_q + dual_cross(self._wrench(b, lam))), of.s_q

    def _rows(self, b: Rolled, one: End, lam: Array) -> Rows:
        """Return the partials of one; s_q has the part of drift control."""
        touch = self._touch(b, one)
        of = rows_of_touch(touch, lam)
        if self._drift:
            c_q = np.zeros_like(of.J)
            held = [row - b.rows.start for row in b.positioned]
            c_q[held] = of.J[held]  # the rate of the gap is J v
            v_q = v_q_of_touch(touch)
            of = of._replace(s_q=of.s_q + self._drift.Kp * c_q + self._drift.Kd * v_q)
        return of

    def _touch(self, b: Rolled, one: End) -> Touch:
        R = (self._frames.data.oMi[b.joint1] * b.placement1).rotation.T @ b.placement2.rotation
        return touch_of(b, one, R)

    def _wrench(self, b: Rolled, lam: Array) -> Array:
        """Return the wrench (6,) of a force at the origin of c1, in its axes."""
        oMi = self._frames.data.oMi[b.joint1]
        at_point = pin.Force(b.whole(lam), np.zeros(3))
        return np.array((oMi * b.placement1).actInv(b.touching(oMi)).act(at_point).vector)


class Vector(NamedTuple):
    """A vector that turns with the state, in the axes of the body."""

    x: Array  # (3,)
    x_q: Array  # (3, nv)
    dot: Array  # (3,)
    dot_q: Array  # (3, nv)

    def mapped(self, A: Array) -> Vector:
        """Return A x for a constant matrix."""
        return Vector(*(A @ part for part in self))

    def cross(self, y: Vector) -> Vector:
        """Return x x y."""
        X, Y, X_dot, Y_dot = (_skew(part) for part in (self.x, y.x, self.dot, y.dot))
        return Vector(
            X @ y.x,
            X @ y.x_q - Y @ self.x_q,
            X_dot @ y.x + X @ y.dot,
            X_dot @ y.x_q + X @ y.dot_q - Y_dot @ self.x_q - Y @ self.dot_q,
        )

    def unit(self) -> Vector:
        """Return x / |x|; zero where x vanishes."""
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
    """The lowest point r, the axes of the rows that are held, and the slip with its rate."""

    r: Vector
    axes: tuple[Vector, ...]
    slip: Array  # (3,), s
    slip_q: Array  # (3, nv)
    slip_v: Array
    rate: Array  # (3,), s'
    rate_q: Array
    rate_v: Array


class Rows(NamedTuple):
    """Partial derivatives of the rows, and of their wrench at the origin of c1, in its axes."""

    J: Array  # (rows, nv)
    s_q: Array  # (rows, nv), of J a + gamma
    s_v: Array  # (rows, nv)
    wrench_q: Array  # (6, nv)


def touch_of(b: Rolled, one: End, R: Array) -> Touch:
    """Return how the lowest point moves; R turns vectors of the plane into the body's axes."""
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


def rows_of_touch(of: Touch, lam: Array) -> Rows:
    """Return the partials of the rows and of the force lam."""
    J = np.array([t.x @ of.slip_v for t in of.axes])
    s_q = np.array(
        [t.x @ of.rate_q + of.rate @ t.x_q + t.dot @ of.slip_q + of.slip @ t.dot_q for t in of.axes]
    )
    s_v = np.array([t.x @ of.rate_v + t.dot @ of.slip_v + of.slip @ t.x_q for t in of.axes])
    force = sum((f * t.x for f, t in zip(lam, of.axes, strict=True)), np.zeros(3))
    force_q = sum((f * t.x_q for f, t in zip(lam, of.axes, strict=True)), np.zeros_like(of.slip_q))
    moment_q = _skew(of.r.x) @ force_q - _skew(force) @ of.r.x_q
    return Rows(J, s_q, s_v, np.concatenate([force_q, moment_q]))


def v_q_of_touch(of: Touch) -> Array:
    """Return the partials of J v by q."""
    return np.array([t.x @ of.slip_q + of.slip @ t.x_q for t in of.axes])


def _fixed_in_world(one: End, x: Array) -> Vector:
    X, w = _skew(x), one.v[3:]
    x_q = X @ one.J[3:]
    return Vector(x, x_q, X @ w, X @ one.v_q[3:] - _skew(w) @ x_q)
