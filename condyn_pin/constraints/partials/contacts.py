"""How the rows of contacts that may let go change with q.

Column i of the rows of a contact point P is m_i u_i, the velocity of P that a unit of coordinate i
gives to the body, m = 1, or to the ground, m = -1. With w_i its angular velocity, P moved along by
the body, and all of it seen from the ground,

    d(m_i u_i)/dq_j = m_i m_j (w_j x u_i)    if i belongs to the joint of j or to one below it,
                      m_i m_j (w_i x u_j)    else,

the other way round where j moves the ground; what moves both is no change. A ball of radius r on a
plane with normal n is touched at its middle less r n, which adds m_i m_j w_i x (w_j x r n). Stops
and dry friction have rows that stay; `meetings` has those of shapes that meet. Where the axes of a
joint turn with its own q, and where shapes meet in a point without a derivative, rows are
differenced:

    f'(0) d ~ sum_k w_k (f(k h d) - f(-k h d)) / h
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.joints import turning
from condyn_pin._core.trees import whole_data
from condyn_pin.constraints.contacts.bound import BoundContact, Touch
from condyn_pin.constraints.contacts.candidates import Candidates
from condyn_pin.constraints.contacts.placements import Placements
from condyn_pin.constraints.contacts.touches import columns
from condyn_pin.constraints.partials.meetings import MeetingTurning

_WEIGHTS: Final = (4 / 5, -1 / 5, 4 / 105, -1 / 280)
_H: Final = 2.0**-12  # [rad, m]: rounding leaves 1e-12


class ContactTurning:
    """The partials of the rows of all candidates of one model; not to be shared between threads."""

    def __init__(self, model: Any, bounds: Sequence[BoundContact]) -> None:
        self._model, self._data = model, whole_data(model)
        self._candidates = Candidates(model, bounds)
        touches = [touch for bound in bounds for touch in bound.touches]
        pairs = [pair for bound in bounds for pair in bound.pairs]
        closed = not turning(model)
        self._over_planes = _OverPlanes(model, touches) if touches and closed else None
        self._meetings = MeetingTurning(model, pairs) if pairs and closed else None
        self._moves = bool(touches or pairs)
        self._differences = self._moves and not closed

    def go(self, q: Array, J: Array) -> None:
        """Go to a configuration; J (rows, nv) are the rows of all candidates there."""
        self._q = q
        if self._over_planes is None and self._meetings is None:
            return
        pin.computeJointJacobians(self._model, self._data, q)
        if self._over_planes is not None:
            self._over_planes.go(self._data, J[: 3 * self._candidates.contact_points])
        if self._meetings is not None:
            self._differences = not self._meetings.go(self._data)

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
        W = np.array(velocities)
        if self._differences:
            return self._differenced(W, lam)
        pulls, first = (
            np.zeros((self._model.nv, self._model.nv)),
            3 * self._candidates.contact_points,
        )
        if self._over_planes is not None:
            pulls += self._over_planes.pulls(lam)
        if self._meetings is not None:
            pulls += self._meetings.pulls(lam[first : first + self._meetings.size])
        return self._slips(W), pulls

    def velocity_by_q(self, w: Array) -> Array:
        """Return J w by q (rows, nv), w (nv,) fixed."""
        if self._differences:
            return np.asarray(self.by_q((w,), np.zeros(self._candidates.rows))[0][0])
        return np.asarray(self._slips(w[None])[0])

    def _slips(self, W: Array) -> Array:
        """Return J w by q of all rows; those of stops and dry friction stay."""
        by_q, first = np.zeros((len(W), self._candidates.rows, self._model.nv)), 0
        for part in (self._over_planes, self._meetings):
            if part is not None:
                slips = part.slips(W)
                by_q[:, first : first + slips.shape[1]] = slips
                first += slips.shape[1]
        return by_q

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
    """Contact points over planes, in closed form, all of it in the axes of their planes.

    Attributes
    ----------
    _u, _w : (5, k, nv) array
        m u and m w of each column along t1, t2, n, and t1, t2 once more (`_crossed`).
    """

    def __init__(self, model: Any, touches: Sequence[Touch]) -> None:
        self._k, self._n = k, n = len(touches), model.nv
        self._placements = Placements(t.ground for t in touches)
        axes = np.zeros((self._placements.size, 5, k))
        for i, t in enumerate(touches):
            of_plane = t.plane.homogeneous[:, :3]
            axes[self._placements.rows(t.ground), :, i] = of_plane[:, _CYCLE]
        self._axes = axes.reshape(-1, 5 * k)
        self._rows = np.add.outer(_CYCLE, 3 * np.arange(k))  # those of u among the rows of J
        body = np.reshape([columns(model, t.joint) for t in touches], (k, n))
        ground = np.reshape([columns(model, t.ground) for t in touches], (k, n))
        self._moves, self._grounds_move = body - ground, bool(ground.any())
        self._of_ground, self._of_body = self._moves < 0, self._moves > 0
        self._radial = np.zeros((5, k, 1))  # (0, 0, radius)
        self._radial[2, :, 0] = [t.radius for t in touches]
        self._is_round = bool(self._radial.any())
        self._below = np.zeros((n, n))  # [i, j]: column i belongs to the joint of j, or below it
        for joint in list(model.joints)[1:]:
            self._below[joint.idx_v : joint.idx_v + joint.nv] = columns(model, joint.id)
        self._is_below, self._rest = self._below > 0, 1.0 - self._below

    def go(self, data: Any, J: Array) -> None:
        """Go to where data.oMi and data.J are; J (3 k, nv) are the rows there."""
        axes = self._placements.read(data).dot(self._axes).T  # (5 k, 3)
        turning = axes.dot(data.J.reshape(6, -1)[3:]).reshape(5, self._k, self._n)
        self._w, self._u = turning * self._moves, J.take(self._rows, axis=0)
        if self._is_round:
            self._rolled = _crossed(self._w, self._radial).take(_CYCLE, axis=0)

    def slips(self, W: Array) -> Array:
        """Return J x by q for all x in the rows of W (count, 3 k, nv).

        Column j is m_j w_j x (what is below moves) + (what is not below turns) x m_j u_j, and the
        other way round where it moves the ground.
        """
        u, w, below, rest = self._u[:, None], self._w[:, None], self._below, self._rest
        moved, turned = u * W[:, None], w * W[:, None]  # (5, count, k, nv), to be summed
        slip, spin = _sums(moved, below), _sums(turned, rest)
        if self._grounds_move:
            slip = np.where(self._of_ground, _sums(moved, rest), slip)
            spin = np.where(self._of_ground, _sums(turned, below), spin)
        by_q = _crossed(w, slip)
        by_q += _crossed(spin, u)
        if self._is_round:
            by_q += _crossed(turned.sum(axis=-1, keepdims=True), self._rolled[:, None])
        return by_q.transpose(1, 2, 0, 3).reshape(len(W), -1, self._n)

    def pulls(self, lam: Array) -> Array:
        """Return J^T lam by q (nv, nv).

        Entry i, j is m_i m_j (u_i x lam) . w_j where i is below j, and else that of j, i; the other
        way round where j moves the ground.
        """
        lam = lam.take(self._rows)[..., None]
        arms, w, is_below = _crossed(self._u, lam), self._w[:3], self._is_below
        if not self._grounds_move:
            below = _paired(arms, w)
            by_q = np.where(is_below, below, below.T)
        else:
            body, ground = self._of_body, self._of_ground
            by_q = np.where(is_below, _paired(arms, w * body), _paired(w, arms * body))
            by_q += np.where(is_below, _paired(w, arms * ground), _paired(arms, w * ground))
        if self._is_round:
            by_q += _paired(w, _crossed(self._rolled, lam))
        return by_q


def _sums(each: Array, which: Array) -> Array:
    """Return the sums (..., n) over columns (..., n) that belong to each: `which` (n, n)."""
    return np.asarray(each.reshape(-1, len(which)).dot(which)).reshape(each.shape)


def _crossed(a: Array, b: Array) -> Array:
    """Return a x b (3, ...), of vectors as (5, ...): x, y, z, and x, y once more."""
    by = a[1:4] * b[2:5]
    by -= a[2:5] * b[1:4]
    return by


def _paired(a: Array, b: Array) -> Array:
    """Return a_i . b_j, summed over all contacts (n, n), of a and b (3, k, n)."""
    n = a.shape[-1]
    return np.asarray(a.reshape(-1, n).T.dot(b.reshape(-1, n)))


_CYCLE: Final = np.array([0, 1, 2, 0, 1])
