"""How the rows of contacts that may let go change with q.

A feeler with its middle p over a plane with the axes d and the normal n touches at P = p - radius n
and has the rows d . (S_l + S_a x P) of each column S = (S_l, S_a) that moves body or ground, in the
axes of the world and at its origin. A step of coordinate j carries along what is above it,

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

    def at(self, q: Array, w: Array, lam: Array) -> tuple[Array, Array]:
        """Return J w by q (rows, nv) and J^T lam by q (nv, nv), both w (nv,) and lam (rows,) fixed.

        Cost: 0.1 ms for four feelers over planes.
        """
        n, m = self._model.nv, self._candidates.rows
        if not self._moves:
            return np.zeros((m, n)), np.zeros((n, n))
        if self._over_planes is None:
            return self._differenced(q, w, lam)
        pin.computeJointJacobians(self._model, self._data, q)
        by_q, pulled = self._over_planes.at(self._data, w, lam)
        still = np.zeros((m - len(by_q), n))  # of stops and dry friction
        return np.concatenate((by_q, still)), pulled

    def _differenced(self, q: Array, w: Array, lam: Array) -> tuple[Array, Array]:
        m = self._candidates.rows

        def turned(step: Array) -> Array:
            at = pin.integrate(self._model, q, step)
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
    """Feelers over planes, in closed form."""

    def __init__(self, model: Any, touches: Sequence[Touch]) -> None:
        self._touches = touches
        k, n = len(touches), model.nv
        self._placements = Placements(joint for t in touches for joint in (t.joint, t.ground))
        self._body = np.reshape([columns(model, t.joint) for t in touches], (k, n))
        self._ground = np.reshape([columns(model, t.ground) for t in touches], (k, n))
        self._radius = np.array([t.radius for t in touches])
        above = np.zeros((n, n))  # [i, j]: column j belongs to the joint of i, or to one below it
        owner = np.zeros((n, n))
        for joint in list(model.joints)[1:]:
            its = slice(joint.idx_v, joint.idx_v + joint.nv)
            above[its] = columns(model, joint.id)
            owner[its, its] = 1.0
        self._above, self._below = above, above - owner

    def at(self, data: Any, w: Array, lam: Array) -> tuple[Array, Array]:
        """Return J w by q (3 k, nv) and J^T lam by q (nv, nv); reads data.oMi and data.J."""
        k, S = len(self._touches), data.J.reshape(6, -1)
        p, d = self._world(data)  # (k, 3) and (k, 3, 3), axes as rows
        n = d[:, 2]
        P = p - self._radius[:, None] * n
        lin, ang = S[:3].T, S[3:].T  # (nv, 3)
        # what a step of each coordinate does to P (k, nv, 3), and to what turns with the ground
        moved = self._body[:, :, None] * (lin + np.cross(ang, p[:, None]))
        moved -= (self._ground * self._radius[:, None])[:, :, None] * np.cross(ang, n[:, None])
        turned = self._ground[:, :, None] * ang
        by_q = self._slips(S, w, P, d, moved, turned)
        f = (lam[: 3 * k].reshape(k, 1, 3) @ d)[:, 0]  # (k, 3)
        return by_q.reshape(3 * k, -1), self._pulls(S, P, f, moved, turned)

    def _slips(
        self, S: Array, w: Array, P: Array, d: Array, moved: Array, turned: Array
    ) -> Array:
        """Return d . (V_l + V_a x P) by q (k, 3, nv), V the velocity of the body less the ground's."""
        columns_w = S * w
        of_body, of_ground = self._body @ columns_w.T, self._ground @ columns_w.T  # (k, 6)
        parents = self._below @ columns_w.T  # (nv, 6), of what is below each coordinate
        V = of_body - of_ground
        carried = self._body[:, :, None] * (of_body[:, None] - parents)
        carried -= self._ground[:, :, None] * (of_ground[:, None] - parents)  # (k, nv, 6)
        lin, ang = S[:3].T, S[3:].T
        V_a = np.cross(ang, carried[..., 3:])
        change = np.cross(ang, carried[..., :3]) + np.cross(lin, carried[..., 3:])
        change += np.cross(V_a, P[:, None]) + np.cross(V[:, None, 3:], moved)
        u = V[:, :3] + np.cross(V[:, 3:], P)
        change -= np.cross(turned, u[:, None])  # (a x d) . u = -d . (a x u)
        return np.asarray(d @ change.transpose(0, 2, 1))

    def _pulls(self, S: Array, P: Array, f: Array, moved: Array, turned: Array) -> Array:
        """Return the sum of J^T lam by q (nv, nv), f the forces (k, 3) in the world."""
        f_turned = np.cross(turned, f[:, None])  # (k, nv, 3)
        moment = np.cross(moved, f[:, None]) + np.cross(P[:, None], f_turned)
        change = np.concatenate((f_turned, moment), axis=2)  # (k, nv, 6)
        moves = self._body - self._ground  # (k, nv)
        rows = moves[:, :, None] * S.T  # (k, nv, 6)
        by_q = np.tensordot(rows, change, axes=((0, 2), (0, 2)))
        wrench = np.concatenate((f, np.cross(P, f)), axis=1).T @ moves  # (6, nv), on each column
        lin, ang, force, about = S[:3].T, S[3:].T, wrench[:3].T, wrench[3:].T
        crossed = np.concatenate(
            (np.cross(ang, force), np.cross(ang, about) + np.cross(lin, force)), axis=1
        )
        return np.asarray(by_q + self._above * (crossed @ S))

    def _world(self, data: Any) -> tuple[Array, Array]:
        """Return the middles (k, 3) and the axes of the planes as rows (k, 3, 3)."""
        p = np.empty((len(self._touches), 3))
        d = np.empty((len(self._touches), 3, 3))
        for i, t in enumerate(self._touches):
            p[i] = data.oMi[t.joint].act(t.centre)
            d[i] = (data.oMi[t.ground].rotation @ t.plane.rotation).T
        return p, d
