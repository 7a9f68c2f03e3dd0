"""The two equations, linearised: how their residuals change with q and v at fixed a and lam.

    r = M a + h - tau - J^T lam,        s = J a + gamma - a_ref

Newton-Euler's derivatives give those of r with the constraint forces fixed in the axes of their
bodies; `condyn_pin.differentiation.partials` adds what turns, and has those of s. A joint whose
axes turn with its own q is taken apart (`condyn_pin.differentiation.in_series`).

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
from condyn_pin.differentiation.balls import BallPartials, is_ball
from condyn_pin.differentiation.gaps import gap_of
from condyn_pin.differentiation.in_series import in_series
from condyn_pin.differentiation.partials import (
    End,
    Partials,
    dual_cross,
    of_frame,
    of_pair,
    of_point,
)
from condyn_pin.differentiation.rolling import RollingPartials
from condyn_pin.drift import Baumgarte
from condyn_pin.rows.bound import POINT, AnyBound, Bound, Coupled, Rolled


class Linearised(NamedTuple):
    """The partial derivatives at one (q, v, a, lam)."""

    M_inv: Array  # (nv, nv), the inverse of the mass matrix
    J: Array  # (m, nv)
    rhs: Array  # (nv + m, 2 nv), -[[r_q, r_v], [s_q, s_v]]: what a step of q and v leaves to solve

    @property
    def r_q(self) -> Array:
        """(nv, nv)."""
        n = len(self.M_inv)
        return -self.rhs[:n, :n]

    @property
    def s_q(self) -> Array:
        """(m, nv)."""
        n = len(self.M_inv)
        return -self.rhs[n:, :n]


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
        model, bounds = in_series(model, bounds)
        self._model, self._data = model, model.createData()
        self._bounds = {b.name: b for b in bounds}
        self._balls = BallPartials(model, self._data, bounds, drift)
        self._pairs = [b for b in bounds if isinstance(b, Bound) and not is_ball(b)]
        self._couplings = [b for b in bounds if isinstance(b, Coupled)]
        self._rolling = RollingPartials(self._data, bounds, drift)
        self._drift = drift
        self._m = sum(b.size for b in bounds)
        self._world = End(*np.zeros((2, 6)), *np.zeros((4, 6, model.nv)))
        self._wrenches = pin.StdVec_Force()
        for _ in range(model.njoints):
            self._wrenches.append(pin.Force.Zero())
        loaded = {j for b in self._pairs for j in (b.joint1, b.joint2) if j}
        loaded |= self._rolling.joints | self._balls.joints
        self._on_joint = {j: self._wrenches[j].vector for j in loaded}  # views
        self._duals = [
            (b.placement1.toDualActionMatrix(), b.placement2.toDualActionMatrix())
            for b in self._pairs
        ]
        # their force, and where it goes: constant in the axes of their joint
        self._held = [b.is_held for b in self._pairs]
        self._placed = bool(self._rolling.joints or self._balls.joints) or not all(self._held)
        self._held_duals = [
            on1[:, list(b.selection)] for b, (on1, _) in zip(self._pairs, self._duals, strict=True)
        ]

    def at(self, q: Array, v: Array, a: Array, lam: Array) -> Linearised:
        """Return the partial derivatives at a state and an answer."""
        model, data, n = self._model, self._data, self._model.nv
        forces = [lam[b.rows] if b.sign > 0 else -lam[b.rows] for b in self._pairs]
        c1Mc2 = self._apply(q, forces)
        self._rolling.apply(lam, self._on_joint)
        if self._balls.k:
            self._balls.apply(lam, self._on_joint)
        # it leaves behind all that the derivatives of frames read
        pin.computeRNEADerivatives(model, data, q, v, a, self._wrenches)
        rhs, J = np.zeros((n + self._m, 2 * n)), np.zeros((self._m, n))
        # [[r_q, r_v], [s_q, s_v]] first: to copy, and to turn the sign of all at once, is quicker
        rhs[:n, :n], rhs[:n, n:] = data.dtau_dq, data.dtau_dv
        minus_s_q, minus_s_v = rhs[n:, :n], rhs[n:, n:]
        for k, b in enumerate(self._pairs):
            of = self._partials(k, forces[k], c1Mc2[k], rhs)
            J_b, by_q, by_v = J[b.rows], minus_s_q[b.rows], minus_s_v[b.rows]
            J_b[:], by_q[:], by_v[:] = of.J, of.s_q, of.s_v
            if b.sign < 0:
                for part in (J_b, by_q, by_v):
                    np.negative(part, out=part)
            if self._drift:
                gap = gap_of(b, *self._ends(b), c1Mc2[k] or self._between(b))
                by_q += b.sign * (self._drift.Kp * gap.c_q + self._drift.Kd * gap.v_q)
        np.negative(rhs, out=rhs)
        self._rolling.write(self._end, lam, rhs, J)
        if self._balls.k:
            self._balls.write(lam, rhs, J)
        for coupled in self._couplings:
            J[coupled.rows, list(coupled.velocity)] = 1.0, -coupled.ratio
            minus_s_q[coupled.rows] = minus_s_v[coupled.rows] = 0.0
            if self._drift:
                minus_s_q[coupled.rows] = -self._drift.Kp * J[coupled.rows]
        if self._drift:
            minus_s_v -= self._drift.Kd * J
        return Linearised(np.array(pin.computeMinverse(model, data, q)), J, rhs)

    def _apply(self, q: Array, forces: list[Array]) -> list[Any]:
        """Put the constraint forces on the bodies; return c1Mc2 where a force depends on it."""
        if self._placed:
            pin.forwardKinematics(self._model, self._data, q)
        for wrench in self._on_joint.values():
            wrench.fill(0.0)
        between: list[Any] = []
        for k, (b, force) in enumerate(zip(self._pairs, forces, strict=True)):
            if self._held[k]:
                self._on_joint[b.joint1] += self._held_duals[k].dot(force)
                between.append(None)
                continue
            duals, c1Mc2 = self._duals[k], self._between(b)
            on1, on2 = wrenches(b, c1Mc2, force)
            if b.joint1:
                self._on_joint[b.joint1] += duals[0] @ on1
            if b.joint2:
                self._on_joint[b.joint2] -= duals[1] @ on2
            between.append(c1Mc2)
        return between

    def turning(self, q: Array, w: Array) -> Array:
        """Return how J w changes with q (m, nv) while w (nv,) stays: as the slip does at v = w."""
        model, data = self._model, self._data
        pin.computeRNEADerivatives(model, data, q, w, np.zeros_like(w))
        of_rows = np.zeros((self._m, model.nv))
        for b in self._pairs:
            if b.is_held:
                v_q, *_ = self._derivatives(b.joint1, b.placement1)
                of_rows[b.rows] = b.sign * v_q[list(b.selection)]
            else:
                of_rows[b.rows] = b.sign * gap_of(b, *self._ends(b), self._between(b)).v_q
        self._rolling.turning(self._end, of_rows)
        if self._balls.k:
            self._balls.turning(of_rows)
        return of_rows

    def mass_matrix(self, q: Array) -> Array:
        """Return M (nv, nv)."""
        return np.array(pin.crba(self._model, self._data, q))

    def _partials(self, k: int, lam: Array, c1Mc2: Any, rhs: Array) -> Partials:
        """Return the partials of one constraint; take what turns of its J^T lam off r_q."""
        b = self._pairs[k]
        if self._held[k]:
            if b.selection != POINT:
                return of_frame(b, *self._derivatives(b.joint1, b.placement1))
            return of_point(self._end(b.joint1, b.placement1))
        one, two = self._ends(b)
        of = of_pair(b, one, two, c1Mc2, lam)
        n = self._model.nv
        if of.w1_q is not None:
            rhs[:n, :n] -= one.J.T @ of.w1_q
        if of.w2_q is not None:
            rhs[:n, :n] += two.J.T @ of.w2_q
        return of

    def by_frame(
        self, q: Array, v: Array, a: Array, lam: Array, name: str, end: int
    ) -> tuple[Array, Array]:
        """Return r (nv, 6) and s (rows, 6) by a twist of c1 or c2 of a constraint, in its axes.

        The frame moves as if a joint held it: its velocity turns by -x x v, and its wrench goes
        along. The end that stays has no part in it.
        """
        pin.computeForwardKinematicsDerivatives(self._model, self._data, q, v, a)
        b = self._bounds[name]
        assert not isinstance(b, Coupled)  # it has no frames
        if isinstance(b, Rolled):
            return self._rolling.by_frame(b, self._end(b.joint1, b.placement1), lam[b.rows])
        (one, two), c1Mc2 = self._ends(b), self._between(b)
        moved, rest = (one, two) if end == 1 else (two, one)
        nothing, lam = np.zeros((6, 6)), b.sign * lam[b.rows]
        moving = moved.by_twist()
        still = End(rest.v, rest.a, nothing, nothing, nothing, nothing)
        pair = (moving, still) if end == 1 else (still, moving)
        on1, on2 = wrenches(b, c1Mc2, lam)
        if not b.is_held:
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

    def _between(self, b: Bound) -> Any:
        """Return c1Mc2."""
        oMi = self._data.oMi
        return (oMi[b.joint1] * b.placement1).actInv(oMi[b.joint2] * b.placement2)

    def _ends(self, b: Bound) -> tuple[End, End]:
        return self._end(b.joint1, b.placement1), self._end(b.joint2, b.placement2)

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


def wrenches(b: Bound, c1Mc2: Any, lam: Array) -> tuple[Array, Array]:
    """Return the force of a constraint at the origin of c1 in its axes, and the same for c2."""
    six = np.zeros(6)
    if b.is_rod:
        six[:3] = lam[0] * c1Mc2.translation / np.linalg.norm(c1Mc2.translation)
    else:
        six[list(b.selection)] = lam
    if b.is_held:  # nothing says where c2 is
        return six, np.zeros(6)
    if b.is_plain and b.size == 6:
        return six, c1Mc2.toActionMatrix().T @ six
    R = c1Mc2.rotation
    at_c2 = np.concatenate([R.T @ six[:3], R.T @ six[3:]])
    if b.is_plain:
        return six, at_c2
    return np.concatenate([six[:3], six[3:] + np.cross(c1Mc2.translation, six[:3])]), at_c2
