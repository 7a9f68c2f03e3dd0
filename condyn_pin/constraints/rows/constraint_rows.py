"""The rows of a scene at a state: c, J v, J a + gamma and J, and the wrenches that they transmit.

From forward kinematics and joint Jacobians alone; `Equations` has M and h to them.

Rows that are driven follow s(t): what is called c, J v and gamma here is c - s, J v - s' and
gamma - s'', so that all of them are to be zero, as those of rows at rest are.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array, Indices
from condyn_pin._core.trees import algorithms, data_of, whole_data
from condyn_pin.constraints.along import along_at
from condyn_pin.constraints.rows.any_bound import AnyBound, OnFrames
from condyn_pin.constraints.rows.cancellation import Cancellation, least_of, more_than
from condyn_pin.constraints.rows.groups import Groups
from condyn_pin.constraints.rows.point_ends import PointEnds

if TYPE_CHECKING:
    from condyn_pin.constraints.rows.redundancy import LeftOut, Redundancy


class ConstraintRows:
    """The rows of one model's bound constraints, and the memory to evaluate them.

    Parameters
    ----------
    model : pin.Model
    bounds : sequence of AnyBound
    memory : (3, m + 1) array
        Where c, J v and J a + gamma are written, each followed by one more number.

    Attributes
    ----------
    wanted : (3, m) array
        s, s' and s'' of rows that are driven; zero of all others.
    answer : bytes
        What tells which answer was evaluated last (`answer_key`), while its groups and wrenches
        stand.
    redundancy : callable, optional
        Finds the redundancy of the rows, or None where all rows count that are not zero.
    digits : callable, optional
        Finds it if digits of a file make rows count, which are left out on closed loops too.
    """

    redundancy: Callable[[], Redundancy | None] | None = None
    digits: Callable[[], Redundancy | None] | None = None
    _c: Array
    _velocity: Array
    _acceleration: Array

    def __init__(self, model: Any, bounds: Sequence[AnyBound], memory: Array) -> None:
        self.model = model
        # bodies that nothing holds together have memory for each tree, if there are many
        self.data = whole_data(model) if bounds else data_of(model)
        self._run = algorithms(self.data)
        self.bounds = tuple(bounds)
        self.m = memory.shape[1] - 1
        self.sign = np.ones(self.m)
        for b in bounds:
            self.sign[b.rows] = b.sign
        self._flipped = bool((self.sign < 0).any())
        self._still = np.zeros(model.nv)
        self.answer = b""
        self._drives = [(b.rows, b.drive, b.name) for b in bounds if b.drive]
        self.wanted = np.zeros((3, self.m))
        self.at(None)
        self._c, self._velocity, self._acceleration = memory[:, : self.m]
        self._groups = Groups(model, self.data, self.bounds, memory[1:])
        self._couplings, self._evaluators = self._groups.couplings, self._groups.evaluators
        others = self._couplings or self._drives  # which have a part in c too
        self._violations = [] if others else self._groups.violations
        self._leaning = [b for b in self.bounds if isinstance(b, OnFrames) and b.leans]
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

    def jacobian(self, q: Array) -> Array:
        """Return J (m, nv)."""
        if not (self.m and self._groups.plain.are_all):
            return self.position_level(q)[1]
        least = self.least  # before data holds the state
        self.answer = b""
        self._run.computeJointJacobians(
            self.model, self.data, q
        )  # with placements, all that these rows read
        return more_than(least, self._oriented(self._groups.jacobian()))

    def cancellation(self, q: Array) -> Array:
        """Return P (m, nv): the sizes of what J is a difference of."""
        return self._cancellation.at(q)

    def uncertainty(self, q: Array) -> Array:
        """Error of J over eps (m, nv): P, and what rounding does to directions."""
        return self._cancellation.at(q, leaning=True)

    def lean(self) -> float:
        """Largest error of a direction over eps, at the last evaluation; 0 without any."""
        oMi = self.data.oMi
        return float(np.max([b.shares(oMi).max() for b in self._leaning], initial=0.0))

    def violation(self, q: Array) -> Array:
        """Return c(q) (m,)."""
        if not self._violations:
            self.motion(q, self._still, self._still)
            return self._c.copy()
        self._run.forwardKinematics(self.model, self.data, q)
        c = np.empty(self.m)
        for write in self._violations:
            write(c)
        return c * self.sign if self._flipped else c

    def position_level(self, q: Array) -> tuple[Array, Array]:
        """Return c(q) (m,) and J (m, nv)."""
        least = self.least  # before data holds the state
        self.motion(q, self._still, self._still)
        return self._c.copy(), more_than(least, self._raw_jacobian())

    def left_out(self, J: Array, c: Array) -> LeftOut | None:
        """Combinations of rows that are left out where rows are J, open by c.

        None on closed loops, unless digits of a file make rows count there.
        """
        if self.redundancy is None:
            return None
        if np.abs(c).max(initial=0.0) > tolerances.AJAR:
            found = self.redundancy()
            return found.left_out(J, c) if found else None
        return self.left_out_by_digits(J)

    def left_out_by_digits(self, J: Array) -> LeftOut | None:
        """Combinations of rows J that digits of a file alone make count; None without any."""
        rounded = self.digits and self.digits()
        return rounded.left_out_by_digits(J) if rounded else None

    def left_out_at(self, q: Array) -> LeftOut | None:
        """Combinations of rows that are left out at q."""
        return None if self.redundancy is None else self.left_out(*self.position_level(q)[::-1])

    def consistent_jacobian(self, q: Array) -> Array:
        """J (m, nv) without the combinations that are left out at q."""
        if self.redundancy is None:
            return self.jacobian(q)
        return self.consistent_position_level(q)[1]

    def consistent_position_level(self, q: Array) -> tuple[Array, Array]:
        """C(q) (m,) and J (m, nv) without the combinations that are left out at q."""
        c, J = self.position_level(q)
        left = self.left_out(J, c)
        return (c, J) if left is None else (left.kept(c), left.kept(J))

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
        self._run.forwardKinematics(self.model, self.data, q)
        return [b.ends(self.data.oMi) for b in self.bounds]

    def jacobian_product(self, q: Array, a: Array) -> Array:
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
        self._run.forwardKinematics(self.model, self.data, q, v, a)
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

    def _raw_jacobian(self) -> Array:
        self._run.computeJointJacobians(self.model, self.data)
        return self._oriented(self._groups.jacobian())

    def _oriented(self, J: Array) -> Array:
        return self.sign[:, None] * J if self._flipped else J

    def drop_roundoff_rows(self, J: Array) -> Array:
        """Return J (m, nv), or zeros where J is numerically zero."""
        return more_than(self.least, J)
