"""The equations of a scene at a state, from Pinocchio's primitives.

    M(q) a + h(q, v) = tau + J(q)^T lam,        J a + gamma = a_ref

M comes from the composite rigid body algorithm, h from recursive Newton-Euler, J from joint
Jacobians, gamma from forward kinematics with a = 0: it is Jdot v where J v = 0, and for points and
balls Pinocchio's classical acceleration elsewhere. The errors of an answer use neither M, h nor J:
Newton-Euler with lam as external forces, and forward kinematics with the answer's a.

Rows that are driven follow s(t): what is called c, J v and gamma here is c - s, J v - s' and
gamma - s'', so that all of them are to be zero, as those of rows at rest are.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array, Indices
from condyn_pin.constraints.along import along_at
from condyn_pin.constraints.baumgarte import Baumgarte
from condyn_pin.constraints.loads import Load
from condyn_pin.constraints.rows.any_bound import AnyBound
from condyn_pin.constraints.rows.cancellation import Cancellation, least_of, more_than
from condyn_pin.constraints.rows.groups import Groups
from condyn_pin.constraints.rows.point_ends import PointEnds
from condyn_pin.constraints.rows.terms import Terms

# bound once: these are called in every residuals, which is to cost little more than they do
_rnea, _crba, _bias = pin.rnea, pin.crba, pin.nonLinearEffects
_forward_kinematics, _joint_jacobians = pin.forwardKinematics, pin.computeJointJacobians
_largest, _WORLD = np.maximum.reduceat, pin.Convention.WORLD


class Recursion(Protocol):
    """Newton-Euler's recursion by another's hand: one whose derivatives are asked for next."""

    def newton_euler(self, q: Array, v: Array, a: Array, wrenches: Any, answer: bytes) -> Array:
        """Return M a + h less what wrenches on the joints do, those of an `answer_key`."""

    def mass(self, q: Array) -> Array | None:
        """Return M if that recursion has left it behind at q; it is overwritten by the next."""


def answer_key(q: Array, v: Array, a: Array, lam: Array) -> bytes:
    """Return what tells an answer and its state from all others."""
    return q.tobytes() + v.tobytes() + a.tobytes() + lam.tobytes()


class Equations:
    """The equations of one model with its bound constraints, and the memory to evaluate them.

    Parameters
    ----------
    model : pin.Model
    bounds : sequence of AnyBound
    drift : Baumgarte, optional

    Attributes
    ----------
    wanted : (3, m) array
        s, s' and s'' of rows that are driven; zero of all others.
    answer : bytes
        The `answer_key` of the answer that was evaluated last, while its groups and wrenches stand.
    recursion : Recursion, optional
        What takes the place of rnea and crba in the errors of answers without loads.
    """

    recursion: Recursion | None = None

    def __init__(
        self, model: Any, bounds: Sequence[AnyBound], drift: Baumgarte | None = None
    ) -> None:
        self.model = model
        self.data = model.createData()
        self.bounds, self.drift = tuple(bounds), drift
        self.m = sum(bound.size for bound in bounds)
        self.sign = np.ones(self.m)
        for b in bounds:
            self.sign[b.rows] = b.sign
        self._flipped = bool((self.sign < 0).any())
        self._still = np.zeros(model.nv)
        self._no_rows = np.zeros((0, model.nv)), np.zeros(0)  # J and gamma of a scene without any
        self.answer = b""
        self._drives = [(b.rows, b.drive, b.name) for b in bounds if b.drive]
        self.wanted = np.zeros((3, self.m))
        self.at(None)
        # |dynamics|, |a|, |c|, |J v|, |J a + gamma| and |lam| share one array, so that one call
        # finds the largest of each; the last four end with a zero, so that none is empty.
        n, width = model.nv, self.m + 1
        self._all = np.zeros(2 * n + 4 * width)
        self._starts = np.array([0, n, *(2 * n + k * width for k in range(4))])
        self._dynamics, self._a, self._c, self._velocity, self._acceleration, self._lam = (
            self._all[start : start + size]
            for start, size in zip(self._starts, (n, n, *4 * [self.m]), strict=True)
        )
        motion = self._all[2 * n + width : 2 * n + 3 * width].reshape(2, width)
        self._groups = Groups(model, self.data, self.bounds, motion)
        self._plain, self._couplings = self._groups.plain, self._groups.couplings
        self._evaluators = self._groups.evaluators
        others = self._couplings or self._drives  # which have a part in c too
        self._violations = [] if others else self._groups.violations
        self._cancellation = Cancellation(model, self.data, self.bounds)

    @cached_property
    def driven(self) -> Indices:
        """The rows that follow a path."""
        rows = [np.arange(rows.start, rows.stop) for rows, _, _ in self._drives]
        return np.concatenate(rows) if rows else np.zeros(0, np.int_)

    @property
    def is_driven(self) -> bool:
        """Whether some rows follow a path."""
        return bool(self._drives)

    def at(self, t: float | None) -> None:
        """Take driven rows where their paths are at t [s]; by default at the time of the scene."""
        self._put_wanted(t, self.wanted)

    def wanted_at(self, t: float | None) -> Array:
        """Return `wanted` (3, m) at t [s], wherever rows are now; owned by the caller."""
        wanted = np.zeros((3, self.m))
        self._put_wanted(t, wanted)
        return wanted

    def _put_wanted(self, t: float | None, wanted: Array) -> None:
        for rows, drive, name in self._drives:
            time = t if t is not None else drive.time or 0.0
            wanted[:, rows] = along_at(drive.along, time, rows.stop - rows.start, name)
        if self._drives:
            wanted[0, self._unplaced] = 0.0

    @cached_property
    def _unplaced(self) -> list[int]:
        """Rows without a position: they follow s' alone."""
        return [
            row
            for b in self.bounds
            for row in range(b.rows.start, b.rows.stop)
            if row not in b.positioned
        ]

    @cached_property
    def least(self) -> float:
        """What |J|^2 is at least, if J is more than rounding; to find it, `data` is written to."""
        # of all places of a machine it is least near the origin of the world
        P = self.cancellation(pin.neutral(self.model))
        return least_of(P)

    def terms(self, q: Array, v: Array) -> Terms:
        """Return M, h, J, gamma and a_ref; they are owned by the caller."""
        least = self.least  # before data holds the state
        M, h, J, gamma = self.parts(q, v)
        return Terms(M, h, more_than(least, J), gamma, self.a_ref())

    def parts(self, q: Array, v: Array) -> tuple[Array, Array, Array, Array]:
        """Return M, h, J and gamma for who looks at the rank of J himself; owned by the caller."""
        if not self.m:  # in the axes of the world: it leaves the Jacobians of all joints behind
            M = _crba(self.model, self.data, q, _WORLD)
            return M, _bias(self.model, self.data, q, v), *self._no_rows
        M, h = _crba(self.model, self.data, q), _bias(self.model, self.data, q, v)
        gamma = self._gamma(q, v)
        return M, h, self._raw_jacobian(), gamma

    def jacobian(self, q: Array) -> Array:
        """Return J (m, nv)."""
        return self.position_level(q)[1]

    def cancellation(self, q: Array) -> Array:
        """Return P (m, nv): the sizes of what J is a difference of."""
        return self._cancellation.at(q)

    def mass(self, q: Array) -> Array:
        """Return M (nv, nv); owned by the caller, unless it is a recursion's."""
        M = self.recursion.mass(q) if self.recursion else None
        return np.array(_crba(self.model, self.data, q)) if M is None else M

    def target(self, q: Array, v: Array) -> Array:
        """Return a_ref - gamma (m,): what J a has to be."""
        gamma = self._gamma(q, v)
        return self.a_ref() - gamma

    def violation(self, q: Array) -> Array:
        """Return c(q) (m,)."""
        if not self._violations:
            self.motion(q, self._still, self._still)
            return self._c.copy()
        _forward_kinematics(self.model, self.data, q)
        c = np.empty(self.m)
        for write in self._violations:
            write(c)
        return c * self.sign if self._flipped else c

    def position_level(self, q: Array) -> tuple[Array, Array]:
        """Return c(q) (m,) and J (m, nv)."""
        least = self.least  # before data holds the state
        self.motion(q, self._still, self._still)
        return self._c.copy(), more_than(least, self._raw_jacobian())

    def gaps(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Return c(q) and J v (m,)."""
        self.motion(q, v, self._still)
        return self._c.copy(), self._velocity.copy()

    def open_by(self, q: Array, v: Array) -> tuple[float, float]:
        """Return max abs(c(q)) and max abs(J v)."""
        self.motion(q, v, self._still)
        return (
            float(np.abs(self._c).max(initial=0.0)),
            float(np.abs(self._velocity).max(initial=0.0)),
        )

    def placements(self, q: Array) -> list[tuple[Any, Any] | None]:
        """Return the placements of the frames c1 and c2 in the world; None for a coupling.

        What rolls touches the plane at the origin of c1, and its rows are along the axes of that.
        """
        pin.forwardKinematics(self.model, self.data, q)
        return [b.ends(self.data.oMi) for b in self.bounds]

    def errors(
        self, q: Array, v: Array, tau: Array, a: Array, lam: Array, load: Load | None = None
    ) -> tuple[Array, list[float]]:
        """Return the residuals of an answer (a, lam) to (q, v, tau), and to a load at q.

        Returns
        -------
        dynamics : (nv,) array
            |M a + h - tau - J^T lam - sum J_f^T f|, elementwise; overwritten by the next call.
        largest : list of float
            The largest of |M a + h - tau - J^T lam|, |a|, |c|, |J v|, |J a + gamma - a_ref| and
            |lam|.
        """
        self._evaluate(q, v, tau, a, lam, load)
        self._a[:] = a
        self._lam[:] = lam
        everything = self._all
        np.abs(everything, out=everything)
        return self._dynamics, _largest(everything, self._starts).tolist()

    def residuals(
        self, q: Array, v: Array, tau: Array, a: Array, lam: Array, load: Load | None = None
    ) -> tuple[Array, Array]:
        """Return r = M a + h - tau - J^T lam (nv,) and s = J a + gamma - a_ref (m,).

        A load at q counts beside tau.
        """
        self._evaluate(q, v, tau, a, lam, load)
        return self._dynamics.copy(), self._acceleration.copy()

    def _evaluate(
        self, q: Array, v: Array, tau: Array, a: Array, lam: Array, load: Load | None = None
    ) -> None:
        """Evaluate the residuals of an answer into the memory of this object."""
        self.motion(q, v, a)
        if self.drift:
            self._acceleration += self.drift.Kd * self._velocity + self.drift.Kp * self._c
        wrenches = self.wrenches(lam)
        self.answer = answer_key(q, v, a, lam)
        if load:
            wrenches = load.on_top_of(wrenches)
        if load or self.recursion is None:
            bodies = _rnea(self.model, self.data, q, v, a, wrenches)
        else:
            bodies = self.recursion.newton_euler(q, v, a, wrenches, self.answer)
        np.subtract(bodies, tau, out=self._dynamics)
        if self._couplings:
            self._dynamics -= self._couplings.torque(lam)

    def slips(self, q: Array, a: Array) -> Array:
        """Return J a (m,): the acceleration of the constraints, from rest."""
        self.motion(q, self._still, a)
        return np.asarray(self._acceleration + self.wanted[2])

    def torque(self, lam: Array) -> Array:
        """Return J^T lam of couplings (nv,): what is no wrench on a joint."""
        return self._couplings.torque(lam) if self._couplings else self._still

    def wrenches(self, lam: Array) -> Any:
        """Return lam as a wrench on each joint, in its axes, right after `motion` at the same q.

        They stay in the memory of this object.
        """
        self.answer = b""
        return self._groups.wrenches(lam * self.sign if self._flipped else lam)

    def wrenches_at(self, q: Array, lam: Array) -> Any:
        """Return the same at any q."""
        if not self.m:
            return self.on_joints
        self.motion(q, self._still, self._still)
        return self.wrenches(lam)

    @property
    def on_joints(self) -> Any:
        """The wrenches of the last `answer`."""
        return self._groups.on_joints

    @property
    def ball_ends(self) -> PointEnds | None:
        """The ends of the loops of three rows, at the last `answer`."""
        return self._groups.ball_ends

    def motion(self, q: Array, v: Array, a: Array) -> None:
        """Evaluate c(q), J v and J a + gamma into the memory of this object."""
        self.answer = b""
        _forward_kinematics(self.model, self.data, q, v, a)
        c, velocity, acceleration = rows = self._c, self._velocity, self._acceleration
        for evaluate in self._evaluators:
            evaluate(c, velocity, acceleration)
        if self._couplings:
            self._couplings.evaluate(q, v, a, rows)
        if self._flipped:
            for part in rows:
                part *= self.sign
        if self._drives:
            for part, wanted in zip(rows, self.wanted, strict=True):
                part -= wanted

    def _gamma(self, q: Array, v: Array) -> Array:
        """Return gamma (m,); with drift control c and J v are left behind."""
        if self.drift or self._drives or not self._plain.have_gamma:
            self.motion(q, v, self._still)
            return self._acceleration.copy()
        _forward_kinematics(self.model, self.data, q, v, self._still)
        gamma = np.zeros(self.m)
        self._plain.gamma(gamma)
        return gamma * self.sign if self._flipped else gamma

    def a_ref(self) -> Array:
        """Return a_ref, right after `_gamma` or `parts` at the same q and v."""
        if self.drift is None:
            return np.zeros(self.m)
        return -self.drift.Kd * self._velocity - self.drift.Kp * self._c

    def _raw_jacobian(self) -> Array:
        _joint_jacobians(self.model, self.data)
        J = self._groups.jacobian()
        return self.sign[:, None] * J if self._flipped else J

    def drop_roundoff_rows(self, J: Array) -> Array:
        """Return J (m, nv), or zeros where J is numerically zero."""
        return more_than(self.least, J)
