"""How the rows of contacts that may let go change with q.

A contact point with its middle p over a plane with the axes d and the normal n touches at
P = p - radius n and has the rows d . (S_l + S_a x P) of each column S = (S_l, S_a) that moves body
or ground, in the axes of the world and at its origin. A step of coordinate j carries along what is
above it,

    P'   = b_j (S_l + S_a x p)_j - g_j radius S_aj x n,    d' = g_j S_aj x d,
    S_i' = S_j x S_i    if j belongs to the joint of i or to one below it,

with b_j and g_j one where j moves the body and the ground. Stops and dry friction have rows that
stay. Where shapes meet, and where the axes of a joint turn with its own q, rows are differenced:

    f'(0) d ~ sum_k w_k (f(k h d) - f(-k h d)) / h
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.joints import turning
from condyn_pin.constraints.contacts.bound import BoundContact, Touch
from condyn_pin.constraints.contacts.candidates import Candidates
from condyn_pin.constraints.contacts.placements import Placements
from condyn_pin.constraints.contacts.touches import columns

_WEIGHTS: Final = (4 / 5, -1 / 5, 4 / 105, -1 / 280)
_H: Final = 2.0**-12  # [rad, m]: shapes do not meet elsewhere so soon; rounding leaves 1e-12


class ContactTurning:
    """The partials of the rows of all candidates of one model; not to be shared between threads."""

    def __init__(self, model: Any, bounds: Sequence[BoundContact]) -> None:
        self._model, self._data = model, model.createData()
        self._candidates = Candidates(model, bounds)
        touches = [touch for bound in bounds for touch in bound.touches]
        pairs = any(bound.pairs for bound in bounds)
        self._over_planes: _OverPlanes | None = None
        if touches and not pairs and not turning(model):
            self._over_planes = _OverPlanes(model, touches)
        self._moves = bool(touches) or pairs

    def go(self, q: Array) -> None:
        """Go to a configuration."""
        self._q = q
        if self._over_planes is not None:
            pin.computeJointJacobians(self._model, self._data, q)
            self._over_planes.go(self._data)

    def slips(self, w: Array) -> Array:
        """Return J w by q (rows, nv), w (nv,) fixed."""
        n, m = self._model.nv, self._candidates.rows
        if not self._moves:
            return np.zeros((m, n))
        if self._over_planes is None:
            return self._differenced(w, np.zeros(m))[0]
        by_q = self._over_planes.slips(w)
        still = m - len(by_q)  # stops and dry friction
        return np.concatenate((by_q, np.zeros((still, n)))) if still else by_q

    def pulls(self, lam: Array) -> Array:
        """Return J^T lam by q (nv, nv), lam (rows,) fixed."""
        n = self._model.nv
        if not self._moves:
            return np.zeros((n, n))
        if self._over_planes is None:
            return self._differenced(np.zeros(n), lam)[1]
        return self._over_planes.pulls(lam)

    def _differenced(self, w: Array, lam: Array) -> tuple[Array, Array]:
        m = self._candidates.rows

        def turned(step: Array) -> Array:
            at = pin.integrate(self._model, self._q, step)
            pin.computeJointJacobians(self._model, self._data, at)
            J = self._candidates.evaluate(self._data, at)[1]
            return np.concatenate((J.dot(w), lam.dot(J)))

        by_q = np.zeros((m + len(w), len(w)))
        for i, along in enumerate(np.eye(len(w))):
            for k, weight in enumerate(_WEIGHTS, start=1):
                change = turned(k * _H * along) - turned(-k * _H * along)
                by_q[:, i] += weight / _H * change
        return by_q[:m], by_q[m:]


class _OverPlanes:
    """Contact points over planes, in closed form."""

    def __init__(self, model: Any, touches: Sequence[Touch]) -> None:
        k, n = len(touches), model.nv
        self._placements = Placements(joint for t in touches for joint in (t.joint, t.ground))
        self._body = np.reshape([columns(model, t.joint) for t in touches], (k, n))
        self._ground = np.reshape([columns(model, t.ground) for t in touches], (k, n))
        self._moves, self._grounds_move = self._body - self._ground, bool(self._ground.any())
        self._radius = np.array([t.radius for t in touches])
        self._local = np.zeros((self._placements.size, 4 * k))  # middles (k), axes (3 k)
        for i, t in enumerate(touches):
            self._local[self._placements.rows(t.joint), i] = (*t.centre, 1.0)
            axes = t.plane.homogeneous[:, :3]
            self._local[self._placements.rows(t.ground), k + 3 * i : k + 3 * i + 3] = axes
        above = np.zeros((n, n))  # [i, j]: column j belongs to the joint of i, or to one below it
        owner = np.zeros((n, n))
        for joint in list(model.joints)[1:]:
            its = slice(joint.idx_v, joint.idx_v + joint.nv)
            above[its] = columns(model, joint.id)
            owner[its, its] = 1.0
        self._above, self._below = above, above - owner

    def go(self, data: Any) -> None:
        """Go to where data.oMi and data.J are."""
        k = len(self._radius)
        world = self._placements.read(data).dot(self._local)
        p, self._d = world[:, :k].T, world[:, k:].T.reshape(k, 3, 3)
        self._P = p - self._radius[:, None] * self._d[:, 2]
        self._S = np.array(data.J).reshape(6, -1)
        self._skew_p, self._skew_P = _skew(p), _skew(self._P)
        self._F = np.concatenate((self._d, -self._d @ self._skew_P), axis=2)  # (k, 3, 6)

    def slips(self, w: Array) -> Array:
        """Return J w by q (3 k, nv).

        With F = (d, P x d), e = d x V_a and u = V_l + V_a x P, rows of

            b (V_b x* F + (e, p x e)) . S - g (V_g x* F + (0, r n x e - d x u)) . S - F . (S x V_0)

        V_b and V_g the velocities of body and ground, V that of one against the other, and V_0 that
        of what carries the joint of a coordinate.
        """
        S, d, F = self._S, self._d, self._F
        moved = S * w
        V_b, V_g, V_0 = moved @ self._body.T, moved @ self._ground.T, moved @ self._below.T
        V = (V_b - V_g).T
        e = d @ _skew(V[:, 3:])  # d x V_a
        on_body = _turned_by(V_b.T, F)
        on_body += np.concatenate((e, -e @ self._skew_p), axis=2)
        by_q = self._body[:, None] * (on_body @ S) - self._moves[:, None] * (F @ _crossed(S, V_0))
        if self._grounds_move:
            u = V[:, :3] + np.cross(V[:, 3:], self._P)
            on_ground = _turned_by(V_g.T, F)
            on_ground[:, :, 3:] -= self._radius[:, None, None] * (e @ _skew(d[:, 2])) + d @ _skew(u)
            by_q -= self._ground[:, None] * (on_ground @ S)
        return np.asarray(by_q.reshape(-1, S.shape[1]))

    def pulls(self, lam: Array) -> Array:
        """Return J^T lam by q (nv, nv).

        Column i feels F_i, the wrench of all that it moves: with S_i' = S_j x S_i that is
        (S_i x* F_i) . S_j, and F' = (f', P' x f + P x f') comes on top.
        """
        S, d = self._S, self._d
        k, lin, ang = len(d), S[:3], S[3:]
        f = (lam[: 3 * k].reshape(k, 1, 3) @ d)[:, 0]  # (k, 3)
        P_moved = self._body[:, None] * (lin - self._skew_p @ ang)  # (k, 3, nv)
        rows = self._moves[:, None] * ang
        if self._grounds_move:
            P_moved += (self._ground * self._radius[:, None])[:, None] * (_skew(d[:, 2]) @ ang)
            f_turned = -self._ground[:, None] * (_skew(f) @ ang)
            about = self._skew_P @ f_turned
            on_ground = (self._moves[:, None] * lin).reshape(3 * k, -1).T @ f_turned.reshape(
                3 * k, -1
            )
            on_ground += rows.reshape(3 * k, -1).T @ about.reshape(3 * k, -1)
        by_q = -rows.reshape(3 * k, -1).T @ (_skew(f) @ P_moved).reshape(3 * k, -1)
        if self._grounds_move:
            by_q += on_ground
        wrench = (
            np.concatenate((f, (self._skew_P @ f[:, :, None])[:, :, 0]), axis=1).T @ self._moves
        )
        felt = np.concatenate(
            (_cross(ang, wrench[:3]), _cross(ang, wrench[3:]) + _cross(lin, wrench[:3]))
        )
        return np.asarray(by_q + self._above * (felt.T @ S))


def _skew(a: Array) -> Array:
    """Return the matrices (k, 3, 3) with a x b = skew(a) b."""
    return (a @ _EPSILON).reshape(-1, 3, 3)


def _cross(a: Array, b: Array) -> Array:
    """Return a x b of columns (3, n)."""
    c = np.empty_like(b)
    c[0] = a[1] * b[2] - a[2] * b[1]
    c[1] = a[2] * b[0] - a[0] * b[2]
    c[2] = a[0] * b[1] - a[1] * b[0]
    return c


def _crossed(S: Array, V: Array) -> Array:
    """Return S x V of columns of motions (6, n)."""
    return np.concatenate((_cross(S[3:], V[:3]) + _cross(S[:3], V[3:]), _cross(S[3:], V[3:])))


def _turned_by(V: Array, F: Array) -> Array:
    """Return V x* F (k, 3, 6), the rows of F (k, 3, 6) as a motion V (k, 6) turns them."""
    w, u = _skew(V[:, 3:]), _skew(V[:, :3])
    f, m = F[:, :, :3], F[:, :, 3:]
    return np.concatenate((-f @ w, -f @ u - m @ w), axis=2)


# a @ _EPSILON has the nine entries of skew(a)
_EPSILON: Final = np.array(
    [[0, 0, 0, 0, 0, -1, 0, 1, 0], [0, 0, 1, 0, 0, 0, -1, 0, 0], [0, -1, 0, 1, 0, 0, 0, 0, 0]],
    dtype=np.float64,
)
