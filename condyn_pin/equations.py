"""The equations of a scene at a state, from Pinocchio's primitives.

    M(q) a + h(q, v) = tau + J(q)^T lam,        J a + gamma = a_ref

M comes from the composite rigid body algorithm, h from recursive Newton-Euler, J from joint
Jacobians, gamma = Jdot v from forward kinematics with a = 0. The proof of an answer takes another
route: Newton-Euler with lam as external forces, and forward kinematics with the answer's a.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from condyn_pin._pin import LOCAL, pin
from condyn_pin.binding import Bound
from condyn_pin.robot import Vector


@dataclass(frozen=True)
class Terms:
    """The terms of the two equations at one state.

    Attributes
    ----------
    M : (nv, nv) array
        Mass matrix, armature included, both triangles.
    h : (nv,) array
        Coriolis, centrifugal and gravity torque.
    J : (m, nv) array
        Constraint Jacobian, rows in the order of the scene, in the axes of each constraint.
    gamma : (m,) array
        Jdot v.
    a_ref : (m,) array
        Wanted acceleration of the constraints; zero without drift control.
    """

    M: Vector
    h: Vector
    J: Vector
    gamma: Vector
    a_ref: Vector


class Equations:
    """The equations of one model with its bound constraints, and the memory to evaluate them.

    Parameters
    ----------
    model : pin.Model
    bounds : sequence of Bound
    """

    def __init__(self, model: Any, bounds: Sequence[Bound]) -> None:
        self.model = model
        self.data = model.createData()
        self.bounds = tuple(bounds)
        self.m = sum(bound.size for bound in bounds)
        self.sign = np.concatenate([np.full(b.size, b.sign) for b in bounds] or [np.zeros(0)])
        self._still = np.zeros(model.nv)
        self._wrenches = pin.StdVec_Force()
        for _ in range(model.njoints):
            self._wrenches.append(pin.Force.Zero())
        self._no_wrench = pin.Force.Zero()

    def terms(self, q: Vector, v: Vector) -> Terms:
        """Return M, h, J, gamma and a_ref; they are owned by the caller."""
        model, data = self.model, self.data
        M = np.array(pin.crba(model, data, q))
        M = np.triu(M) + np.triu(M, 1).T
        h = np.array(pin.nonLinearEffects(model, data, q, v))
        gamma = self.motion(q, v, self._still)[2]
        return Terms(M, h, self._jacobian(q), gamma, np.zeros(self.m))

    def jacobian(self, q: Vector) -> Vector:
        """Return J (m, nv)."""
        pin.forwardKinematics(self.model, self.data, q)
        return self._jacobian(q)

    def _jacobian(self, q: Vector) -> Vector:
        """Return J, with the joint placements of q in data already."""
        model, data = self.model, self.data
        pin.computeJointJacobians(model, data, q)
        J = np.empty((self.m, model.nv))
        for b in self.bounds:
            J1 = pin.getFrameJacobian(model, data, b.joint1, b.placement1, LOCAL)
            if b.joint2:
                J2 = pin.getFrameJacobian(model, data, b.joint2, b.placement2, LOCAL)
                c1Mc2 = self._relative_placement(b)
                if b.size == 3:
                    J1 = J1[:3] - c1Mc2.rotation @ J2[:3]
                else:
                    J1 = J1 - c1Mc2.toActionMatrix() @ J2
            J[b.rows] = b.sign * J1[: b.size]
        return J

    def violation(self, q: Vector) -> Vector:
        """Return c(q) (m,)."""
        return self.motion(q, self._still, self._still)[0]

    def motion(self, q: Vector, v: Vector, a: Vector) -> Vector:
        """Return c(q), J v and J a + gamma as the rows of a (3, m) array."""
        model, data = self.model, self.data
        pin.forwardKinematics(model, data, q, v, a)
        rows = np.zeros((3, self.m))
        for b in self.bounds:
            _against_world(model, data, b, rows) if b.joint2 == 0 else self._between(b, rows)
            if b.anchored:
                c1Mc2 = self._relative_placement(b)
                error = c1Mc2.translation if b.size == 3 else pin.log6(c1Mc2).vector
                rows[0, b.rows] = -error
        if self.sign.size and self.sign.min() < 0:
            rows *= self.sign
        return rows

    def _between(self, b: Bound, rows: Vector) -> None:
        """Fill in J v and J a + gamma of a loop between two moving bodies."""
        model, data = self.model, self.data
        one = (model, data, b.joint1, b.placement1, LOCAL)
        two = (model, data, b.joint2, b.placement2, LOCAL)
        c1Mc2 = self._relative_placement(b)
        v1, v2 = pin.getFrameVelocity(*one), c1Mc2.act(pin.getFrameVelocity(*two))
        if b.size == 3:
            # the velocity and the acceleration of each frame's own origin, only turned
            R = c1Mc2.rotation
            rows[1, b.rows] = v1.linear - R @ pin.getFrameVelocity(*two).linear
            a1 = pin.getFrameClassicalAcceleration(*one).linear
            rows[2, b.rows] = a1 - R @ pin.getFrameClassicalAcceleration(*two).linear
        else:
            slip = v1 - v2
            a1 = pin.getFrameAcceleration(*one)
            a2 = c1Mc2.act(pin.getFrameAcceleration(*two))
            rows[1, b.rows] = slip.vector
            rows[2, b.rows] = (a1 - a2 + slip.cross(v2)).vector

    def _relative_placement(self, b: Bound) -> Any:
        oMi = self.data.oMi
        oMc1 = oMi[b.joint1] * b.placement1
        oMc2 = oMi[b.joint2] * b.placement2 if b.joint2 else b.placement2
        return oMc1.actInv(oMc2)


    def errors(
        self, q: Vector, v: Vector, tau: Vector, a: Vector, lam: Vector
    ) -> tuple[Vector, Vector]:
        """Return the residuals of an answer (a, lam) to (q, v, tau).

        Returns
        -------
        dynamics : (nv,) array
            M a + h - tau - J^T lam.
        rows : (3, m) array
            c(q), J v and J a + gamma - a_ref.
        """
        rows = self.motion(q, v, a)
        self._apply(lam)
        dynamics: Vector = pin.rnea(self.model, self.data, q, v, a, self._wrenches) - tau
        return dynamics, rows

    def _apply(self, lam: Vector) -> None:
        """Put lam on the bodies: as it is on joint 1, and its opposite on joint 2."""
        wrenches = self._wrenches
        for b in self.bounds:
            wrenches[b.joint1] = self._no_wrench
            if b.joint2:
                wrenches[b.joint2] = self._no_wrench
        for b in self.bounds:
            f = np.zeros(6)
            f[: b.size] = b.sign * lam[b.rows]
            force = pin.Force(f)
            wrenches[b.joint1] += b.placement1.act(force)
            if b.joint2:
                c1Mc2 = self._relative_placement(b)
                if b.size == 3:  # acts at the origin of c2
                    c1Mc2.translation = np.zeros(3)
                wrenches[b.joint2] -= b.placement2.act(c1Mc2.actInv(force))

    def placements(self, q: Vector) -> list[Any]:
        """Return the placement of each frame c1 in the world."""
        pin.forwardKinematics(self.model, self.data, q)
        return [self.data.oMi[b.joint1] * b.placement1 for b in self.bounds]


def _against_world(model: Any, data: Any, b: Bound, rows: Vector) -> None:
    """Fill in J v and J a + gamma of a contact with the world."""
    frame = (model, data, b.joint1, b.placement1, LOCAL)
    if b.size == 3:
        rows[1, b.rows] = pin.getFrameVelocity(*frame).linear
        rows[2, b.rows] = pin.getFrameClassicalAcceleration(*frame).linear
    else:
        rows[1, b.rows] = pin.getFrameVelocity(*frame).vector
        rows[2, b.rows] = pin.getFrameAcceleration(*frame).vector
