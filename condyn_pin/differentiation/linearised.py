"""The two equations, linearised: how their residuals change with q and v at fixed a and lam.

    r = M a + h - tau - J^T lam,        s = J a + gamma - a_ref

Newton-Euler's derivatives give those of r with the constraint forces fixed in the axes of their
bodies; `condyn_pin.differentiation.partials` adds what turns, and has those of s.

References
----------
Carpentier, Mansard. Analytical derivatives of rigid body dynamics algorithms. RSS, 2018.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from condyn_pin._pin import LOCAL, pin
from condyn_pin.arrays import Array
from condyn_pin.differentiation.gaps import gap_of
from condyn_pin.differentiation.partials import (
    End,
    Partials,
    dual_cross,
    of_frame,
    of_pair,
    of_point,
    spatial_cross,
)
from condyn_pin.differentiation.rolling import (
    Rows,
    gap_of_rolled,
    plane_in_body,
    rows_of_touch,
    touch_of,
)
from condyn_pin.drift import Baumgarte
from condyn_pin.rows.bound import POINT, AnyBound, Bound, Coupled, Rolled


class Linearised(NamedTuple):
    """The partial derivatives at one (q, v, a, lam)."""

    M_inv: Array  # (nv, nv), the inverse of the mass matrix
    J: Array  # (m, nv)
    by_state: Array  # (nv + m, 2 nv), [[r_q, r_v], [s_q, s_v]]

    @property
    def s_q(self) -> Array:
        """(m, nv)."""
        n = len(self.M_inv)
        return self.by_state[n:, :n]


class Linearisation:
    """The linearised equations of one model with its bound constraints, and their memory.

    Parameters
    ----------
    model : pin.Model
    bounds : sequence of AnyBound
    drift : Baumgarte, optional
    """

    def __init__(
        self, model: Any, bounds: Sequence[AnyBound], drift: Baumgarte | None = None
    ) -> None:
        self._model, self._data = model, model.createData()
        self._pairs = [b for b in bounds if isinstance(b, Bound)]
        self._couplings = [b for b in bounds if isinstance(b, Coupled)]
        self._rolling = [
            (b, b.placement1.toDualActionMatrix()) for b in bounds if isinstance(b, Rolled)
        ]
        self._drift = drift
        self._m = sum(b.size for b in bounds)
        self._world = End(*np.zeros((2, 6)), *np.zeros((4, 6, model.nv)))
        self._wrenches = pin.StdVec_Force()
        for _ in range(model.njoints):
            self._wrenches.append(pin.Force.Zero())
        loaded = {j for b in self._pairs for j in (b.joint1, b.joint2) if j}
        loaded |= {b.joint1 for b, _ in self._rolling}
        self._on_joint = {j: self._wrenches[j].vector for j in loaded}  # views
        self._duals = [
            (b.placement1.toDualActionMatrix(), b.placement2.toDualActionMatrix())
            for b in self._pairs
        ]
        # their force, and where it goes: constant in the axes of their joint
        self._held = [_is_held(b) for b in self._pairs]
        self._held_duals = [
            on1[:, list(b.selection)] for b, (on1, _) in zip(self._pairs, self._duals, strict=True)
        ]

    def at(self, q: Array, v: Array, a: Array, lam: Array) -> Linearised:
        """Return the partial derivatives at a state and an answer."""
        model, data, n, m = self._model, self._data, self._model.nv, self._m
        pin.computeForwardKinematicsDerivatives(model, data, q, v, a)
        by_state, J = np.zeros((n + m, 2 * n)), np.zeros((m, n))
        r_q, r_v = by_state[:n, :n], by_state[:n, n:]
        s_q, s_v = by_state[n:, :n], by_state[n:, n:]
        for wrench in self._on_joint.values():
            wrench[:] = 0.0
        turning: list[Array] = []
        for k, b in enumerate(self._pairs):
            rows, (of, force) = b.rows, self._partials(k, b.sign * lam[b.rows])
            J[rows], s_q[rows], s_v[rows] = of.J, of.s_q, of.s_v
            if b.sign < 0:
                for part in (J, s_q, s_v):
                    part[rows] *= -1.0
            if force is not None:
                turning.append(force)
            if self._drift:
                gap = gap_of(b, *self._both_ends(b))
                s_q[rows] += b.sign * (self._drift.Kp * gap.c_q + self._drift.Kd * gap.v_q)
        for rolled, dual in self._rolling:
            rows, one = rolled.rows, self._end(rolled.joint1, rolled.placement1)
            rolling = self._roll(rolled, one, lam[rows])
            self._on_joint[rolled.joint1] += dual @ rolling.wrench
            J[rows], s_q[rows], s_v[rows] = rolling.J, rolling.s_q, rolling.s_v
            turning.append(one.J.T @ rolling.wrench_q)
        for coupled in self._couplings:
            J[coupled.rows, list(coupled.velocity)] = 1.0, -coupled.ratio
            if self._drift:
                s_q[coupled.rows] += self._drift.Kp * J[coupled.rows]
        if self._drift:
            s_v += self._drift.Kd * J
        pin.computeRNEADerivatives(model, data, q, v, a, self._wrenches)
        r_q[:], r_v[:] = data.dtau_dq, data.dtau_dv
        for force in turning:
            r_q -= force
        return Linearised(np.array(pin.computeMinverse(model, data, q)), J, by_state)

    def mass_matrix(self, q: Array) -> Array:
        """Return M (nv, nv)."""
        return np.array(pin.crba(self._model, self._data, q))

    def _partials(self, k: int, lam: Array) -> tuple[Partials, Array | None]:
        """Return the partials of one constraint and of its J^T lam, and apply its force."""
        b = self._pairs[k]
        if self._held[k]:
            self._on_joint[b.joint1] += self._held_duals[k].dot(lam)
            if b.selection != POINT:
                return of_frame(b, *self._derivatives(b.joint1, b.placement1)), None
            return of_point(self._end(b.joint1, b.placement1)), None
        duals = self._duals[k]
        one, two, c1Mc2 = self._both_ends(b)
        on1, on2 = wrenches(b, c1Mc2, lam)
        if b.joint1:
            self._on_joint[b.joint1] += duals[0] @ on1
        if b.joint2:
            self._on_joint[b.joint2] -= duals[1] @ on2
        of = of_pair(b, one, two, c1Mc2, lam)
        force = np.zeros((self._model.nv, self._model.nv))
        for J, w_q, sign in ((one.J, of.w1_q, 1.0), (two.J, of.w2_q, -1.0)):
            if w_q is not None:
                force += sign * J.T @ w_q
        return of, force

    def _roll(self, b: Rolled, one: End, lam: Array) -> Rows:
        """Return the partials of what rolls, drift control included."""
        touch = touch_of(b, one, plane_in_body(b, self._data.oMi[b.joint1]))
        of = rows_of_touch(touch, lam)
        if self._drift:
            gap = gap_of_rolled(b, touch, of.J)
            of = of._replace(s_q=of.s_q + self._drift.Kp * gap.c_q + self._drift.Kd * gap.v_q)
        return of

    def by_frame(
        self, q: Array, v: Array, a: Array, lam: Array, b: Bound | Rolled, end: int
    ) -> tuple[Array, Array]:
        """Return r (nv, 6) and s (rows, 6) by a twist of frame c1 or c2 on its body, in its axes.

        The frame moves as if a joint held it: its velocity turns by -x x v, and its wrench goes
        along. The end that stays has no part in it.
        """
        pin.computeForwardKinematicsDerivatives(self._model, self._data, q, v, a)
        if isinstance(b, Rolled):
            wheel = self._end(b.joint1, b.placement1)
            rolling = self._roll(b, _moved(wheel), lam[b.rows])
            return -wheel.J.T @ (rolling.wrench_q + dual_cross(rolling.wrench)), rolling.s_q
        one, two, c1Mc2 = self._both_ends(b)
        moved, rest = (one, two) if end == 1 else (two, one)
        nothing, lam = np.zeros((6, 6)), b.sign * lam[b.rows]
        moving = _moved(moved)
        still = End(rest.v, rest.a, nothing, nothing, nothing, nothing)
        pair = (moving, still) if end == 1 else (still, moving)
        on1, on2 = wrenches(b, c1Mc2, lam)
        if not _is_held(b):
            of = of_pair(b, *pair, c1Mc2, lam)
        elif b.selection == POINT:
            of = of_point(moving)
        else:
            of = of_frame(b, moving.v_q, moving.a_q, moving.a_v, moving.J)
        w1 = nothing if of.w1_q is None else of.w1_q
        w2 = nothing if of.w2_q is None else of.w2_q
        if end == 1:
            w1 = w1 + dual_cross(on1)
        else:
            w2 = w2 + dual_cross(on2)
        s = of.s_q
        if self._drift:
            gap = gap_of(b, *pair, c1Mc2)
            s = s + self._drift.Kp * gap.c_q + self._drift.Kd * gap.v_q
        return two.J.T @ w2 - one.J.T @ w1, b.sign * s

    def _both_ends(self, b: Bound) -> tuple[End, End, Any]:
        oMi = self._data.oMi
        c1Mc2 = (oMi[b.joint1] * b.placement1).actInv(oMi[b.joint2] * b.placement2)
        return self._end(b.joint1, b.placement1), self._end(b.joint2, b.placement2), c1Mc2

    def _end(self, joint: int, placement: Any) -> End:
        if joint == 0:
            return self._world
        v, a = placement.actInv(self._data.v[joint]), placement.actInv(self._data.a[joint])
        return End(v.vector, a.vector, *self._derivatives(joint, placement))

    def _derivatives(self, joint: int, placement: Any) -> tuple[Array, Array, Array, Array]:
        """Return v_q, a_q, a_v and J of a frame."""
        found: tuple[Array, Array, Array, Array] = pin.getFrameAccelerationDerivatives(
            self._model, self._data, joint, placement, LOCAL
        )
        if self._model.nv > 1:
            return found
        v_q, a_q, a_v, J = (part.reshape(6, 1) for part in found)  # Pinocchio gives vectors
        return v_q, a_q, a_v, J


def _moved(end: End) -> End:
    """Return an end with its partials by a twist of the frame on its body."""
    turning = spatial_cross(end.v), spatial_cross(end.a)
    return End(end.v, end.a, *turning, np.zeros((6, 6)), np.eye(6))


def _is_held(b: Bound) -> bool:
    """Whether the rows are those of a frame in its own axes: nothing of the world enters."""
    return b.joint2 == 0 and (b.is_plain or not b.anchored)


def wrenches(b: Bound, c1Mc2: Any, lam: Array) -> tuple[Array, Array]:
    """Return the force of a constraint at the origin of c1 in its axes, and the same for c2."""
    six = np.zeros(6)
    if b.is_rod:
        six[:3] = lam[0] * c1Mc2.translation / np.linalg.norm(c1Mc2.translation)
    else:
        six[list(b.selection)] = lam
    if _is_held(b):  # nothing says where c2 is
        return six, np.zeros(6)
    if b.is_plain and b.size == 6:
        return six, c1Mc2.toActionMatrix().T @ six
    R = c1Mc2.rotation
    at_c2 = np.concatenate([R.T @ six[:3], R.T @ six[3:]])
    if b.is_plain:
        return six, at_c2
    return np.concatenate([six[:3], six[3:] + np.cross(c1Mc2.translation, six[:3])]), at_c2
