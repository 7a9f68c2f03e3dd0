"""The equations of a scene at a state, from Pinocchio's primitives.

    M(q) a + h(q, v) = tau + J(q)^T lam,        J a + gamma = a_ref

M comes from the composite rigid body algorithm, h from recursive Newton-Euler, J from joint
Jacobians, gamma from forward kinematics with a = 0: it is Jdot v where J v = 0, and for points and
balls Pinocchio's classical acceleration elsewhere. The errors of an answer use neither M, h nor J:
Newton-Euler with lam as external forces, and forward kinematics with the answer's a.

The rows themselves, and how they follow a path, are those of `ConstraintRows`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.baumgarte import Baumgarte
from condyn_pin.constraints.loads import Load
from condyn_pin.constraints.rows.any_bound import AnyBound
from condyn_pin.constraints.rows.cancellation import more_than
from condyn_pin.constraints.rows.constraint_rows import ConstraintRows
from condyn_pin.constraints.rows.terms import Terms

# bound once: this is called in every residuals
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


class Equations(ConstraintRows):
    """The equations of one model with its bound constraints, and the memory to evaluate them.

    Parameters
    ----------
    model : pin.Model
    bounds : sequence of AnyBound
    drift : Baumgarte, optional

    Attributes
    ----------
    recursion : Recursion, optional
        What takes the place of rnea and crba in the errors of answers without loads.
    """

    recursion: Recursion | None = None

    def __init__(
        self, model: Any, bounds: Sequence[AnyBound], drift: Baumgarte | None = None
    ) -> None:
        # |dynamics|, |a|, |c|, |J v|, |J a + gamma| and |lam| share one array, so that one call
        # finds the largest of each; the last four end with a zero, so that none is empty.
        n, width = model.nv, sum(bound.size for bound in bounds) + 1
        self._all = np.zeros(2 * n + 4 * width)
        self._starts = np.array([0, n, *(2 * n + k * width for k in range(4))])
        self._dynamics, self._a = self._all[: 2 * n].reshape(2, n)
        memory = self._all[2 * n :].reshape(4, width)
        self._lam = memory[3, :-1]
        super().__init__(model, bounds, memory[:3])
        self.drift = drift
        self._plain = self._groups.plain
        self._no_rows = np.zeros((0, n)), np.zeros(0)  # J and gamma of a scene without any

    def terms(self, q: Array, v: Array) -> Terms:
        """Return M, h, J, gamma and a_ref; they are owned by the caller."""
        least = self.least  # before data holds the state
        M, h, J, gamma = self.parts(q, v)
        return Terms(M, h, more_than(least, J), gamma, self.a_ref())

    def consistent_terms(self, q: Array, v: Array) -> Terms:
        """M, h, J, gamma and a_ref without the combinations of rows that are left out at q.

        On closed loops they are left out too where J v is not 0, and gamma contradicts itself.
        """
        terms = self.terms(q, v)
        if self.redundancy is None:
            return terms
        c, rate = self.gaps(q, v)
        left = self.left_out(terms.J, c)
        if left is None and np.abs(rate).max(initial=0.0) > tolerances.OPEN:
            found = self.redundancy()
            left = found.left_out(terms.J, c) if found else None
        return terms if left is None else terms.kept(left)

    def parts(self, q: Array, v: Array) -> tuple[Array, Array, Array, Array]:
        """Return M, h, J and gamma, the rank of J unchecked; owned by the caller."""
        if not self.m:  # in the axes of the world: it leaves the Jacobians of all joints behind
            M = self._run.crba(self.model, self.data, q, _WORLD)
            return M, self._run.nonLinearEffects(self.model, self.data, q, v), *self._no_rows
        M = self._run.crba(self.model, self.data, q)
        h = self._run.nonLinearEffects(self.model, self.data, q, v)
        gamma = self._gamma(q, v)
        return M, h, self._raw_jacobian(), gamma

    def consistent_parts(self, q: Array, v: Array) -> tuple[Array, Array, Array, Array]:
        """M, h, J and gamma without the combinations of rows that are left out at q."""
        M, h, J, gamma = self.parts(q, v)
        left = None if self.redundancy is None else self.left_out(J, self.violation(q))
        return (M, h, J, gamma) if left is None else (M, h, left.kept(J), left.kept(gamma))

    def mass(self, q: Array) -> Array:
        """Return M (nv, nv); owned by the caller, unless it is a recursion's."""
        M = self.recursion.mass(q) if self.recursion else None
        return np.array(self._run.crba(self.model, self.data, q)) if M is None else M

    def target(self, q: Array, v: Array) -> Array:
        """Return a_ref - gamma (m,): what J a has to be."""
        gamma = self._gamma(q, v)
        return self.a_ref() - gamma

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
            bodies = self._run.rnea(self.model, self.data, q, v, a, wrenches)
        else:
            bodies = self.recursion.newton_euler(q, v, a, wrenches, self.answer)
        np.subtract(bodies, tau, out=self._dynamics)
        if self._couplings:
            self._dynamics -= self._couplings.torque(lam)

    def _gamma(self, q: Array, v: Array) -> Array:
        """Return gamma (m,); with drift control c and J v are left behind."""
        if self.drift or self._drives or not self._plain.have_gamma:
            self.motion(q, v, self._still)
            return self._acceleration.copy()
        self._run.forwardKinematics(self.model, self.data, q, v, self._still)
        gamma = np.zeros(self.m)
        self._plain.gamma(gamma)
        return gamma * self.sign if self._flipped else gamma

    def a_ref(self) -> Array:
        """Return a_ref, right after `_gamma` or `parts` at the same q and v."""
        if self.drift is None:
            return np.zeros(self.m)
        return -self.drift.Kd * self._velocity - self.drift.Kp * self._c
