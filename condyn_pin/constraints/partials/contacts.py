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

    def by_q(self, velocities: Sequence[Array], lam: Array) -> tuple[Array, Array]:
        """Return how rows turn: J w by q of each w, and J^T lam by q.

        Parameters
        ----------
        velocities : sequence of (nv,) array
            All w, which stay.
        lam : (rows,) array
            It stays too.

        Returns
        -------
        slips : (count, rows, nv) array
        pulls : (nv, nv) array
        """
        n, m, W = self._model.nv, self._candidates.rows, np.array(velocities)
        if not self._moves:
            return np.zeros((len(W), m, n)), np.zeros((n, n))
        if self._over_planes is None:
            return self._differenced(W, lam)
        return self._with_still(self._over_planes.slips(W)), self._over_planes.pulls(lam)

    def slips(self, w: Array) -> Array:
        """Return J w by q (rows, nv), w (nv,) fixed."""
        if self._over_planes is None:
            return np.asarray(self.by_q((w,), np.zeros(self._candidates.rows))[0][0])
        return np.asarray(self._with_still(self._over_planes.slips(w[None]))[0])

    def _with_still(self, of_cones: Array) -> Array:
        """Return the same with the rows of stops and dry friction, which stay."""
        still = self._candidates.rows - of_cones.shape[1]
        return np.pad(of_cones, ((0, 0), (0, still), (0, 0))) if still else of_cones

    def _differenced(self, W: Array, lam: Array) -> tuple[Array, Array]:
        (count, n), m = W.shape, len(lam)

        def turned(step: Array) -> Array:
            at = pin.integrate(self._model, self._q, step)
            pin.computeJointJacobians(self._model, self._data, at)
            J = self._candidates.evaluate(self._data, at)[1]
            return np.concatenate(((W @ J.T).ravel(), lam.dot(J)))

        by_q = np.zeros((count * m + n, n))
        for i, along in enumerate(np.eye(n)):
            for k, weight in enumerate(_WEIGHTS, start=1):
                change = turned(k * _H * along) - turned(-k * _H * along)
                by_q[:, i] += weight / _H * change
        return by_q[: count * m].reshape(count, m, n), by_q[count * m :]


class _OverPlanes:
    """Contact points over planes, in closed form."""

    def __init__(self, model: Any, touches: Sequence[Touch]) -> None:
        k, n = len(touches), model.nv
        self._placements = Placements(joint for t in touches for joint in (t.joint, t.ground))
        self._body = np.reshape([columns(model, t.joint) for t in touches], (k, n))
        self._ground = np.reshape([columns(model, t.ground) for t in touches], (k, n))
        self._grounds_move = bool(self._ground.any())
        self._moves, self._bodies = (self._body - self._ground)[:, None], self._body[:, None]
        self._grounds = self._ground[:, None]
        self._radius = np.array([t.radius for t in touches])[:, None]
        self._is_round = bool(self._radius.any())
        self._radial = np.zeros((k, 3, 3))
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
        self._above, self._below = above, (above - owner).T.copy()

    def go(self, data: Any) -> None:
        """Go to where data.oMi and data.J are."""
        k = len(self._radius)
        world = self._placements.read(data).dot(self._local)
        p, self._d = world[:, :k].T, world[:, k:].T.reshape(k, 3, 3)
        self._P = p
        if self._is_round:
            radial = self._radius * self._d[:, 2]
            self._P, self._radial = p - radial, _skew(radial)
        self._F = np.concatenate((self._d, self._d @ -_skew(self._P)), axis=2)  # (k, 3, 6)
        self._S = S = np.array(data.J).reshape(6, -1)
        # (k, 3, nv), the middles if all coordinates move them
        self._reach = S[:3] - _skew(p) @ S[3:]

    def slips(self, W: Array) -> Array:
        """Return J w by q for all w in the rows of W (count, 3 k, nv).

        With V_0 the velocity of what carries the joint of a coordinate, v_P and w_b those of the
        body at P and its turning, w_g that of the ground, and F = (d, P x d), a coordinate that
        moves one of the two has

            F . (V_0 x S) + (v_P x d + radius n x (d x w_b)) . S_a - (d x w_g) . (S_l + S_a x p)
        """
        S, d, (count, n), k = self._S, self._d, W.shape, len(self._d)
        moved = S * W[:, None]  # (count, 6, nv)
        V = self._body @ moved.swapaxes(1, 2)  # (count, k, 6)
        turning = _skew(V[..., 3:])
        v_P = V[..., :3] + (turning @ self._P[:, :, None])[..., 0]
        about = d @ (_skew(v_P) + turning @ self._radial if self._is_round else _skew(v_P))
        by_q = self._F.reshape(-1, 6) @ _crossed(moved @ self._below, S)
        by_q -= about.reshape(count, -1, 3) @ S[3:]
        by_q = by_q.reshape(count, k, 3, n)
        if self._grounds_move:
            turned = _skew(self._ground @ moved[:, 3:].swapaxes(1, 2))
            by_q -= d @ turned @ self._reach
        by_q *= self._moves
        return np.asarray(by_q.reshape(count, -1, n))

    def pulls(self, lam: Array) -> Array:
        """Return J^T lam by q (nv, nv).

        Column i feels the wrenches F = (f, P x f) of all that it moves, and

            (S_i . F)' = S_i . Q S_j + S_ai . (P' x f + P x f'),    S_i . Q S_j = (S_j x S_i) . F
        """
        S, n, k = self._S, self._S.shape[1], len(self._d)
        wrenches = (lam[: 3 * k].reshape(k, 1, 3) @ self._F).reshape(k, 6)
        Q = wrenches.dot(_FELT)  # (k, 36)
        skew_f = Q.reshape(k, 6, 6)[:, :3, 3:]
        moved = self._moves * S  # (k, 6, nv)
        by_q = moved.reshape(-1, n).T.dot(Q.reshape(-1, 6).dot(S))
        by_q *= self._above
        turned = skew_f @ (self._bodies * self._reach)  # (k, 3, nv), of the moment: f x P'
        if self._grounds_move:
            f_turned = self._grounds * (skew_f @ S[3:])  # f x S_aj
            turned += self._grounds * (skew_f @ (self._radial @ S[3:])) + _skew(self._P) @ f_turned
            by_q -= moved[:, :3].reshape(-1, n).T.dot(f_turned.reshape(-1, n))
        by_q -= moved[:, 3:].reshape(-1, n).T.dot(turned.reshape(-1, n))
        return np.asarray(by_q)


def _skew(a: Array) -> Array:
    """Return the matrices (..., 3, 3) with a x b = skew(a) b."""
    return (a @ _EPSILON).reshape(*a.shape[:-1], 3, 3)


def _crossed(V: Array, S: Array) -> Array:
    """Return V x S of columns of motions, V (count, 6, n) and S (6, n)."""
    by_V = S.T.dot(_BY_V).reshape(-1, 6, 6)  # (n, 6, 6), a map of V for each column
    return np.asarray((by_V @ V.transpose(2, 1, 0)).transpose(2, 1, 0))


# a @ _EPSILON has the nine entries of skew(a)
_EPSILON: Final = np.array(
    [[0, 0, 0, 0, 0, -1, 0, 1, 0], [0, 0, 1, 0, 0, 0, -1, 0, 0], [0, -1, 0, 1, 0, 0, 0, 0, 0]],
    dtype=np.float64,
)


def _felt() -> Array:
    """Return what makes Q of a wrench (f, m): [[0, skew f], [skew f, skew m]]."""
    Q, skews = np.zeros((6, 6, 6)), _EPSILON.reshape(3, 3, 3)
    Q[:3, :3, 3:] = Q[:3, 3:, :3] = Q[3:, 3:, 3:] = skews
    return Q.reshape(6, 36)


_FELT: Final = _felt()


def _by_V() -> Array:
    """Return what makes of S the map of V to V x S: -[[skew S_a, skew S_l], [0, skew S_a]]."""
    of, skews = np.zeros((6, 6, 6)), -_EPSILON.reshape(3, 3, 3)
    of[3:, :3, :3] = of[:3, :3, 3:] = of[3:, 3:, 3:] = skews
    return of.reshape(6, 36)


_BY_V: Final = _by_V()
