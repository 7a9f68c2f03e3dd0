"""The equations of a scene at a state, from Pinocchio's primitives.

    M(q) a + h(q, v) = tau + J(q)^T lam,        J a + gamma = a_ref

M comes from the composite rigid body algorithm, h from recursive Newton-Euler, J from joint
Jacobians, gamma = Jdot v from forward kinematics with a = 0. The errors of an answer use
neither M, h nor J: Newton-Euler with lam as external forces, and forward kinematics with the
answer's a.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from condyn_pin._pin import LOCAL, pin
from condyn_pin.arrays import Array
from condyn_pin.binding import Bound
from condyn_pin.frames import WorldContacts, Wrenches
from condyn_pin.loops import Balls, Weld

# bound once: these are called in every proof, which is to cost little more than they do
_rnea = pin.rnea
_forward_kinematics = pin.forwardKinematics
_largest = np.maximum.reduceat


@dataclass(frozen=True, eq=False)
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

    M: Array
    h: Array
    J: Array
    gamma: Array
    a_ref: Array


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
        self._flipped = any(b.sign < 0 for b in bounds)
        self._still = np.zeros(model.nv)
        contacts = [b for b in bounds if not (b.joint2 or b.anchored)]
        balls = [b for b in bounds if b.size == 3 and (b.joint2 or b.anchored)]
        welds = [b for b in bounds if b.size == 6 and (b.joint2 or b.anchored)]
        self._contacts = WorldContacts(self.data, contacts, self.m + 1) if contacts else None
        self._loops: list[Balls | Weld] = []
        self._action: dict[str, Callable[[], Array]] = {}  # R or X of a loop, after `motion`
        if balls:
            together = Balls(self.data, balls)
            self._loops.append(together)
            self._action |= {b.name: partial(together.action, k) for k, b in enumerate(balls)}
        for b in welds:
            weld = Weld(model, self.data, b)
            self._loops.append(weld)
            self._action[b.name] = weld.action
        self._wrenches = Wrenches(model, bounds)
        self._lam2 = np.zeros(self.m)
        # |dynamics|, |a|, |c|, |J v| and |J a + gamma| share one array, so that one call finds the
        # largest of each; the last three end with a zero, so that none is empty.
        n, width = model.nv, self.m + 1
        self._all = np.zeros(2 * n + 3 * width)
        self._starts = np.array([0, n, 2 * n, 2 * n + width, 2 * n + 2 * width])
        self._dynamics, self._a, self._c, self._velocity, self._acceleration = (
            self._all[start : start + size]
            for start, size in zip(self._starts, (n, n, self.m, self.m, self.m), strict=True)
        )
        self._motion = self._all[2 * n + width :].reshape(2, width)

    def terms(self, q: Array, v: Array) -> Terms:
        """Return M, h, J, gamma and a_ref; they are owned by the caller."""
        model, data = self.model, self.data
        M = np.array(pin.crba(model, data, q))
        h = np.array(pin.nonLinearEffects(model, data, q, v))
        self.motion(q, v, self._still)
        return Terms(M, h, self._jacobian(q), self._acceleration.copy(), np.zeros(self.m))

    def jacobian(self, q: Array) -> Array:
        """Return J (m, nv)."""
        self.motion(q, self._still, self._still)
        return self._jacobian(q)

    def violation(self, q: Array) -> Array:
        """Return c(q) (m,)."""
        self.motion(q, self._still, self._still)
        return self._c.copy()

    def placements(self, q: Array) -> list[Any]:
        """Return the placement of each frame c1 in the world."""
        pin.forwardKinematics(self.model, self.data, q)
        return [self.data.oMi[b.joint1] * b.placement1 for b in self.bounds]

    def errors(
        self, q: Array, v: Array, tau: Array, a: Array, lam: Array
    ) -> tuple[Array, list[float]]:
        """Return the residuals of an answer (a, lam) to (q, v, tau).

        Returns
        -------
        dynamics : (nv,) array
            |M a + h - tau - J^T lam|, elementwise; overwritten by the next call.
        largest : list of float
            The largest of |M a + h - tau - J^T lam|, |a|, |c|, |J v| and |J a + gamma - a_ref|.
        """
        self.motion(q, v, a)
        lam1 = lam * self.sign if self._flipped else lam
        for loops in self._loops:
            loops.turn(lam1, self._lam2)
        wrenches = self._wrenches.of(lam1, self._lam2)
        np.subtract(_rnea(self.model, self.data, q, v, a, wrenches), tau, out=self._dynamics)
        self._a[:] = a
        everything = self._all
        np.abs(everything, out=everything)
        return self._dynamics, _largest(everything, self._starts).tolist()

    def motion(self, q: Array, v: Array, a: Array) -> None:
        """Evaluate c(q), J v and J a + gamma into the memory of this object."""
        _forward_kinematics(self.model, self.data, q, v, a)
        if self._contacts:
            self._contacts.evaluate(self._motion)
        for loops in self._loops:
            loops.evaluate(self._c, self._velocity, self._acceleration)
        if self._flipped:
            for rows in (self._c, self._velocity, self._acceleration):
                rows *= self.sign

    def _jacobian(self, q: Array) -> Array:
        """Return J, right after `motion` at the same q."""
        model, data = self.model, self.data
        pin.computeJointJacobians(model, data, q)
        J = np.empty((self.m, model.nv))
        for b in self.bounds:
            Jb = pin.getFrameJacobian(model, data, b.joint1, b.placement1, LOCAL)[: b.size]
            if b.joint2:
                J2 = pin.getFrameJacobian(model, data, b.joint2, b.placement2, LOCAL)[: b.size]
                Jb = Jb - self._action[b.name]() @ J2
            J[b.rows] = Jb
        return self.sign[:, None] * J if self._flipped else J
