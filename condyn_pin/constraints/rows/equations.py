"""The equations of a scene at a state, from Pinocchio's primitives.

    M(q) a + h(q, v) = tau + J(q)^T lam,        J a + gamma = a_ref

M comes from the composite rigid body algorithm, h from recursive Newton-Euler, J from joint
Jacobians, gamma from forward kinematics with a = 0: it is Jdot v where J v = 0, and for points and
balls Pinocchio's classical acceleration elsewhere. The errors of an answer use neither M, h nor J:
Newton-Euler with lam as external forces, and forward kinematics with the answer's a.

The rows themselves, and how they follow a path, are those of `ConstraintRows`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property
from math import isnan
from typing import TYPE_CHECKING, Any, Final, Protocol

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core._pin import LOCAL, pin
from condyn_pin._core.arrays import Array, Indices
from condyn_pin._core.linalg import cholesky_pivots
from condyn_pin._core.models import algorithms, axes, data_of, joints_with_turning_axes, whole_data
from condyn_pin.constraints.drift import Baumgarte, gains
from condyn_pin.constraints.forces import Load
from condyn_pin.constraints.path import along_at
from condyn_pin.constraints.rows.bound import BoundConstraint, Terms, TwoFrameConstraint, length
from condyn_pin.constraints.rows.frames import AXES, MOVING, Balls, CutJoints, Ends, PointEnds, Rods
from condyn_pin.constraints.rows.functions import BoundFunctions
from condyn_pin.constraints.rows.groups import Groups, sorted_by_rows
from condyn_pin.constraints.rows.special import BoundCoupling, Rolling

if TYPE_CHECKING:
    from condyn_pin.constraints.rows.redundancy import Redundancy, RedundantRows


# The rows of a scene at a state: c, J v, J a + gamma and J, and the wrenches that they transmit.
#
# From forward kinematics and joint Jacobians alone; `Equations` has M and h to them.
#
# Rows that are driven follow s(t): what is called c, J v and gamma here is c - s, J v - s' and
# gamma - s'', so that all of them are to be zero, as those of rows at rest are.


class ConstraintRows:
    """Rows of one model's bound constraints, and the memory to evaluate them.

    memory (3, m + 1): where c, J v and J a + gamma are written, each followed by one more number
    wanted (3, m): s, s' and s'' of rows that are driven; 0, b and b' of rows of functions with time
        in them, at the last `motion`; zero of all others
    answer: what tells which answer was evaluated last (`answer_key`), while its groups and wrenches
        stand
    redundancy: finds the redundancy of the rows, or None where all rows count that are not zero
    digits: finds it if digits of a file make rows count, which are left out on closed loops too
    """

    redundancy: Callable[[], Redundancy | None] | None = None
    digits: Callable[[], Redundancy | None] | None = None
    _c: Array
    _velocity: Array
    _acceleration: Array

    def __init__(self, model: Any, bounds: Sequence[BoundConstraint], memory: Array) -> None:
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
        self._c, self._velocity, self._acceleration = memory[:, : self.m]
        self._groups = Groups(model, self.data, self.bounds, memory[1:])
        self.at(None)
        self._on_coordinates = self._groups.on_coordinates
        self._evaluators = self._groups.evaluators
        others = self._on_coordinates or self._drives  # which have a part in c too
        self._violations = [] if others else self._groups.violations
        self._leaning = [
            b for b in self.bounds if isinstance(b, TwoFrameConstraint) and b.has_computed_axes
        ]
        self._cancellation = Cancellation(model, self.data, self.bounds)

    @cached_property
    def driven(self) -> Indices:
        """Indices of the rows that follow a path."""
        rows = [np.arange(rows.start, rows.stop) for rows, _, _ in self._drives]
        return np.concatenate(rows) if rows else np.zeros(0, np.int_)

    @property
    def is_driven(self) -> bool:
        """True if some rows follow a path."""
        return bool(self._drives)

    def at(self, t: float | None) -> None:
        """Set driven rows to their paths at t [s]; by default at the time of the scene."""
        self._put_wanted(t, self.wanted)
        if self._groups.functions:
            self._groups.functions.t = t

    def wanted_at(self, t: float | None) -> Array:
        """Array `wanted` (3, m) at t [s], owned by the caller; the rows stay at their time."""
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
        """Rows without a position, which follow s' alone."""
        return [
            row
            for b in self.bounds
            for row in range(b.rows.start, b.rows.stop)
            if row not in b.positioned
        ]

    @cached_property
    def least(self) -> float:
        """Smallest |J|^2 above rounding error; to find it, `data` is written to."""
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
        """Cancellation P (m, nv): sizes of the terms whose difference is J."""
        return self._cancellation.at(q)

    def uncertainty(self, q: Array) -> Array:
        """Rounding error of J over eps (m, nv): P, and errors of computed directions."""
        return self._cancellation.at(q, leaning=True)

    def lean(self) -> float:
        """Largest rounding error of a direction over eps, at the last evaluation; 0 without any."""
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

    def left_out(self, J: Array, c: Array) -> RedundantRows | None:
        """Combinations of rows that are left out where rows are J, open by c."""
        # None on closed loops, unless digits of a file make rows count there.
        if self.redundancy is None:
            return None
        if np.abs(c).max(initial=0.0) > tolerances.AJAR:
            found = self.redundancy()
            return found.left_out(J, c) if found else None
        return self.left_out_by_digits(J)

    def left_out_by_digits(self, J: Array) -> RedundantRows | None:
        """Combinations of rows J that digits of a file alone make count; None without any."""
        rounded = self.digits and self.digits()
        return rounded.left_out_by_digits(J) if rounded else None

    def left_out_at(self, q: Array) -> RedundantRows | None:
        """Combinations of rows that are left out at q."""
        return None if self.redundancy is None else self.left_out(*self.position_level(q)[::-1])

    def consistent_jacobian(self, q: Array) -> Array:
        """J (m, nv) without the combinations that are left out at q."""
        if self.redundancy is None:
            return self.jacobian(q)
        return self.consistent_position_level(q)[1]

    def consistent_position_level(self, q: Array) -> tuple[Array, Array]:
        """Violation c(q) (m,) and J (m, nv) without the combinations left out at q."""
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
        """Return the placements of the frames c1 and c2 in the world; None for a coupling."""
        # What rolls touches the plane at the origin of c1, and its rows are along the axes of that.
        self._run.forwardKinematics(self.model, self.data, q)
        return [b.ends(self.data.oMi) for b in self.bounds]

    def jacobian_product(self, q: Array, a: Array) -> Array:
        """Return J a (m,): the acceleration of the constraints, from rest."""
        self.motion(q, self._still, a)
        return np.asarray(self._acceleration + self.wanted[2])

    def torque(self, lam: Array) -> Array:
        """Torques J^T lam (nv,) of rows on coordinates, which are no wrenches on joints."""
        if not self._on_coordinates:
            return self._still
        return np.asarray(sum(group.torque(lam) for group in self._on_coordinates))

    def wrenches(self, lam: Array) -> Any:
        """Wrenches of lam on each joint, in its axes, right after `motion` at the same q."""
        # They stay in the memory of this object.
        self.answer = b""
        return self._groups.wrenches(lam * self.sign if self._flipped else lam)

    def wrenches_at(self, q: Array, lam: Array) -> Any:
        """Wrenches of lam on each joint, in its axes, at any q."""
        if not self.m:
            return self.on_joints
        self.motion(q, self._still, self._still)
        return self.wrenches(lam)

    @property
    def on_joints(self) -> Any:
        """Wrenches of the last `answer`."""
        return self._groups.on_joints

    @property
    def ball_ends(self) -> PointEnds | None:
        """Ends of the loops of three rows, at the last `answer`."""
        return self._groups.ball_ends

    def motion(self, q: Array, v: Array, a: Array) -> None:
        """Evaluate c(q), J v and J a + gamma into the memory of this object."""
        self.answer = b""
        self._run.forwardKinematics(self.model, self.data, q, v, a)
        c, velocity, acceleration = rows = self._c, self._velocity, self._acceleration
        for evaluate in self._evaluators:
            evaluate(c, velocity, acceleration)
        for group in self._on_coordinates:
            group.evaluate(q, v, a, rows)
        if self._groups.functions and self._drives:
            self._groups.functions.demand(q, v, self.wanted)
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


# Gaps of many states at once, for what is measured after a motion.
#
# Forward kinematics takes one state after the other, and what it leaves of the ends of each loop is
# copied. Then the rows of all states are evaluated as those of one scene with so many loops: numpy
# takes as long for a dozen of them as for one.


# States at once: what a call of numpy costs is spread over so many.
MANY: Final = 16


class BatchedGaps:
    """Violations and constraint velocities of up to `MANY` states of one scene.

    Contacts, welds, relations, couplings and what is driven are evaluated by its equations, state
    by state, and so are all others of a scene that has any.
    """

    def __init__(self, equations: Equations) -> None:
        self._equations, self._run = equations, algorithms(equations.data)
        self._gaps = np.zeros((2, MANY, equations.m))
        self._accelerations = np.zeros(MANY * equations.m)  # not asked for
        found = sorted_by_rows(equations.bounds)
        self._at_once = not (found.held or found.welds or found.related)
        self._at_once &= not (found.coupled or found.of_functions)
        self._at_once &= not equations.is_driven  # each state has a time of its own
        self._ends: list[ManyEnds] = []
        self._groups: list[Balls | CutJoints | Rods | Rolling] = []
        for group, bounds in (
            (Balls, found.balls), (CutJoints, found.cut), (Rods, found.rods),
            (Rolling, found.rolled),
        ):  # fmt: skip
            if self._at_once and bounds:
                ends = ManyEnds(equations.data, bounds)
                self._ends.append(ends)
                self._groups.append(group(ends, _repeated(bounds, equations.m)))

    def look(self, i: int, q: Array, v: Array, t: float | None = None) -> None:
        """Record (q, v) at t as state i; forward kinematics stays in the data of the equations."""
        equations = self._equations
        equations.at(t)
        if not self._at_once:
            self._gaps[:, i] = equations.gaps(q, v)
            return
        self._run.forwardKinematics(equations.model, equations.data, q, v)
        for ends in self._ends:
            ends.read(i)

    def gaps(self, count: int) -> Array:
        """Return c(q) and J v (2, count, m) of the first states; overwritten by the next call."""
        if not self._at_once:
            return self._gaps[:, :count]
        c, velocity = self._gaps.reshape(2, -1)
        for group in self._groups:
            group.evaluate(c, velocity, self._accelerations)
        return np.asarray(self._gaps[:, :count] * self._equations.sign)


class ManyEnds(Ends):
    """Ends of k loops in each of `MANY` states, as the ends of MANY k loops.

    Accelerations are left out: they are zero.
    """

    def __init__(self, data: Any, bounds: Sequence[TwoFrameConstraint]) -> None:
        super().__init__(data, bounds)
        self._velocities = self._joints.sources[: len(self._joints.numbers)]
        self._placed = np.zeros((MANY, *self._of_joints.shape))
        self._moved = np.zeros((MANY, self._joints.size))
        # rows of each end, axes, (0, 1), (v, 0) and 0: with its placement, axes, p, p' and p''
        self._rows = np.zeros((2, MANY * self.k, 6, 4))
        self._rows[:, :, :4] = np.eye(4)

    def read(self, i: int) -> None:
        """Copy the results of forward kinematics, as state i."""
        np.concatenate(self._sources, out=self._placed[i].reshape(-1, 3))
        np.concatenate(self._velocities, out=self._moved[i])

    def placements(self) -> Array:
        """Placements E (2, MANY k, 4, 3), as `Ends.placements` has them."""
        E = self._in_joints @ self._placed
        return np.asarray(E.swapaxes(0, 1).reshape(2, -1, 4, 3))

    def evaluate(self) -> tuple[Array, Array]:
        """Axes R1, and p, p' and zeros for p'' of c1 less those of c2, as `PointEnds` does."""
        self._rows[:, :, 4, :3] = self.linear()[0]
        one, two = self._rows @ self.placements()
        return one[:, AXES].swapaxes(1, 2), one[:, MOVING] - two[:, MOVING]

    def linear(self) -> Array:
        """Linear velocities, and zeros for accelerations (2, 2, MANY k, 3)."""
        return self._of_ends(self._linearT)

    def angular(self) -> Array:
        """Angular velocities, and zeros for accelerations (2, 2, MANY k, 3)."""
        return self._of_ends(self._angularT)

    def _of_ends(self, mapT: Array) -> Array:
        both = np.zeros((2, 2, MANY * self.k, 3))
        each = (self._moved @ mapT).reshape(MANY, 2, self.k, 3)
        both[0] = each.swapaxes(0, 1).reshape(2, -1, 3)
        return both


def _repeated(bounds: Sequence[Any], rows: int) -> list[Any]:
    """Constraints repeated for each state, their rows shifted by the rows of a state."""
    return [
        replace(b, rows=slice(b.rows.start + i * rows, b.rows.stop + i * rows))
        for i in range(MANY)
        for b in bounds
    ]


# Cancellation: what the two bodies of a row bring to J before they cancel.
#
# J = J1 - X J2 is rounded to eps (|J1| + |X J2|), however small it is itself. Pinocchio forms
# either from columns at the origin of the world, so that each is rounded to eps times its distance
# from there at least: far away that is what counts.
#
# A row along a direction that is computed is off by as much as that: of a rod, n = (p2 - p1) / |r|
# turns by eps (|p1| + |p2|) / |r|, however well the two bodies agree.


# What is rounding of a row, as a share of what its two bodies bring to it.
ROUNDED: Final = 1e-13


class Cancellation:
    """Sizes of both bodies' terms in J, row by row; it writes to `data`."""

    def __init__(self, model: Any, data: Any, bounds: Sequence[BoundConstraint]) -> None:
        self._model, self._data = model, data
        self._couplings = np.zeros((sum(b.size for b in bounds), model.nv))
        self._bent: list[BoundCoupling] = []
        self._own: list[BoundFunctions] = []
        self._ends: list[tuple[int, Any]] = []  # joint and placement of those that move
        self._arms: list[TwoFrameConstraint | None] = []  # what has an arm from c1 to c2
        self._shares = np.zeros((len(self._couplings), 2, 1))  # of shifts and of turns in each row
        self._leaning: list[TwoFrameConstraint] = []  # along directions that are computed
        rows: tuple[list[Any], list[Any]] = [], []  # of c1 and of c2: row, end
        for b in bounds:
            if isinstance(b, BoundCoupling):
                self._couplings[b.rows, b.columns] = np.abs(b.weights)
                self._bent += [b] if b.bends else []
                continue
            if isinstance(b, BoundFunctions):
                self._own.append(b.at_work())
                continue
            assert isinstance(b, TwoFrameConstraint)
            turns = b.turns(model)
            self._shares[b.rows, :, 0] = np.array([~turns, turns]).T
            if b.has_computed_axes:
                self._leaning.append(b)
            ends = (b.joint1, b.placement1, b), (b.joint2, b.placement2, None)
            for its_rows, (joint, placement, arm) in zip(rows, ends, strict=True):
                if joint:
                    its_rows.extend(
                        (row, len(self._ends)) for row in range(b.rows.start, b.rows.stop)
                    )
                    self._ends.append((joint, placement))
                    self._arms.append(arm)
        self._origins = [data.oMi[joint] for joint, _ in self._ends]
        self._rows = [np.array(each, dtype=int).T for each in rows if each]

    def at(self, q: Array, *, leaning: bool = False) -> Array:
        """Sizes of the terms whose difference is J (m, nv)."""
        # The same for all shifts of a constraint, and for all its turns. Of all places of a machine
        # it is least near the origin of the world. With `leaning` also what directions that are
        # computed are off by, over eps.
        model, data, found = self._model, self._data, self._couplings.copy()
        for curve in self._bent:
            found[curve.rows, curve.columns] += np.abs(curve.bent(q, 1))
        for own in self._own:
            found[own.rows] = np.abs(own.J(q, own.time))
        algorithms(data).computeJointJacobians(model, data, q)
        if not self._ends:
            return found
        sixes = [pin.getFrameJacobian(model, data, *end, LOCAL) for end in self._ends]
        # by end, linear or angular, component and column
        shift, turn = np.abs(sixes).reshape(len(sixes), 2, 3, -1).max(axis=2).swapaxes(0, 1)
        away = np.array([[length(origin.translation)] for origin in self._origins])
        arms = np.array([[b.arm(data.oMi) if b else 0.0] for b in self._arms])
        shift = np.maximum(shift + arms * turn, away * turn)
        shares = self._shares
        if leaning and self._leaning:
            shares = shares.copy()
            for b in self._leaning:
                shares[b.rows, :, 0] = b.shares(data.oMi)
        for rows, ends in self._rows:
            of_shifts, of_turns = shares[rows].swapaxes(0, 1)
            found[rows] += of_shifts * shift[ends] + of_turns * turn[ends]
        return found


def least_of(P: Array) -> float:
    """Smallest |J|^2 above rounding error."""
    return ROUNDED**2 * float(np.vdot(P, P))


def more_than(least: float, J: Array) -> Array:
    """Jacobian J, or zeros where |J|^2 is no more than `least`."""
    # The rank is relative to the largest singular value: such rows would hold what they cannot.
    entries = J.ravel()
    return np.zeros_like(J) if entries.dot(entries) <= least else J


# The equations of a scene at a state, from Pinocchio's primitives.


# bound once: this is called in every residuals
_largest, _WORLD = np.maximum.reduceat, pin.Convention.WORLD


class NewtonEuler(Protocol):
    """Newton-Euler recursion of another object, which is asked for its derivatives next."""

    def newton_euler(self, q: Array, v: Array, a: Array, wrenches: Any, answer: bytes) -> Array:
        """Torques M a + h less those of wrenches on the joints, those of an `answer_key`."""

    def mass(self, q: Array) -> Array | None:
        """Mass matrix of that recursion at q, or None; the next one overwrites it."""


def answer_key(q: Array, v: Array, a: Array, lam: Array) -> bytes:
    """Key of a solution and its state: the bytes of their numbers."""
    return q.tobytes() + v.tobytes() + a.tobytes() + lam.tobytes()


class Equations(ConstraintRows):
    """Equations of one model with its bound constraints, and the memory to evaluate them.

    recursion: what takes the place of rnea and crba in the errors of answers without loads
    """

    recursion: NewtonEuler | None = None

    def __init__(
        self, model: Any, bounds: Sequence[BoundConstraint], drift: Baumgarte | None = None
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
        self.stabilise(drift)
        self._plain = self._groups.plain
        self._no_rows = np.zeros((0, n)), np.zeros(0)  # J and gamma of a scene without any

    def stabilise(self, drift: Baumgarte | None) -> None:
        """Take other gains of drift control, for the constraints that have none of their own."""
        self.drift = drift
        if drift:
            self._Kp, self._Kd = gains(self.bounds, drift)

    def terms(self, q: Array, v: Array) -> Terms:
        """Return M, h, J, gamma and a_ref; they are owned by the caller."""
        least = self.least  # before data holds the state
        M, h, J, gamma = self.parts(q, v)
        return Terms(M, h, more_than(least, J), gamma, self.a_ref())

    def consistent_terms(self, q: Array, v: Array) -> Terms:
        """Terms M, h, J, gamma and a_ref without the combinations left out at q."""
        # On closed loops they are left out too where J v is not 0, and gamma contradicts itself.
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
        """Terms M, h, J and gamma without the combinations of rows left out at q."""
        M, h, J, gamma = self.parts(q, v)
        left = None if self.redundancy is None else self.left_out(J, self.violation(q))
        return (M, h, J, gamma) if left is None else (M, h, left.kept(J), left.kept(gamma))

    def mass(self, q: Array) -> Array:
        """Mass matrix M (nv, nv); owned by the caller, unless it is a recursion's."""
        M = self.recursion.mass(q) if self.recursion else None
        return np.array(self._run.crba(self.model, self.data, q)) if M is None else M

    def target(self, q: Array, v: Array) -> Array:
        """Wanted J a: a_ref - gamma (m,)."""
        gamma = self._gamma(q, v)
        return self.a_ref() - gamma

    def errors(
        self, q: Array, v: Array, tau: Array, a: Array, lam: Array, load: Load | None = None
    ) -> tuple[Array, list[float]]:
        """Residuals of a solution (a, lam) at (q, v, tau), and at a load at q."""
        # |M a + h - tau - J^T lam - sum J_f^T f| (nv,), overwritten by the next call, and the
        # largest of |M a + h - tau - J^T lam|, |a|, |c|, |J v|, |J a + gamma - a_ref| and |lam|.
        self._evaluate(q, v, tau, a, lam, load)
        self._a[:] = a
        self._lam[:] = lam
        everything = self._all
        np.abs(everything, out=everything)
        return self._dynamics, _largest(everything, self._starts).tolist()

    def residuals(
        self, q: Array, v: Array, tau: Array, a: Array, lam: Array, load: Load | None = None
    ) -> tuple[Array, Array]:
        """Residuals r = M a + h - tau - J^T lam (nv,) and s = J a + gamma - a_ref (m,)."""
        # A load at q counts beside tau.
        self._evaluate(q, v, tau, a, lam, load)
        return self._dynamics.copy(), self._acceleration.copy()

    def _evaluate(
        self, q: Array, v: Array, tau: Array, a: Array, lam: Array, load: Load | None = None
    ) -> None:
        """Evaluate the residuals of a solution into the memory of this object."""
        self.motion(q, v, a)
        if self.drift:
            self._acceleration += self._Kd * self._velocity + self._Kp * self._c
        wrenches = self.wrenches(lam)
        self.answer = answer_key(q, v, a, lam)
        if load:
            wrenches = load.added_to(wrenches)
        if load or self.recursion is None:
            bodies = self._run.rnea(self.model, self.data, q, v, a, wrenches)
        else:
            bodies = self.recursion.newton_euler(q, v, a, wrenches, self.answer)
        np.subtract(bodies, tau, out=self._dynamics)
        for group in self._on_coordinates:
            self._dynamics -= group.torque(lam)

    def _gamma(self, q: Array, v: Array) -> Array:
        """Drift gamma (m,); with drift control c and J v are left in memory."""
        if self.drift or self._drives or not self._plain.have_gamma:
            self.motion(q, v, self._still)
            return self._acceleration.copy()
        self._run.forwardKinematics(self.model, self.data, q, v, self._still)
        gamma = np.zeros(self.m)
        self._plain.gamma(gamma)
        return gamma * self.sign if self._flipped else gamma

    def a_ref(self) -> Array:
        """Wanted acceleration a_ref, right after `_gamma` or `parts` at the same q and v."""
        if self.drift is None:
            return np.zeros(self.m)
        return -self._Kd * self._velocity - self._Kp * self._c


# Pivots of M: whether it is much closer to singular at a state than where a scene was measured.
#
#     M = U D U^T,    U unit upper triangular
#
# eliminates the tips of the tree first, so that D_j is the inertia that coordinate j feels while
# all that it carries moves freely. That is at least what its own body and its armature have about
# its own axis: where these are enough, D_j cannot fall, and nothing has to be looked at again. It
# falls where links without inertia hold hinges in the place of a ball, and two of the axes meet.


# A pivot that cannot fall below this share of its nominal value is not watched: an estimate of the
# error that is too small by less than the inverse of it is within the margin of most answers.
_SHARE: Final = 1e-2


class MassConditioning:
    """Pivots of M that may fall from their `nominal` values, to `least` at any q.

    `watched` are their numbers, and `nominal` those of them alone.
    """

    def __init__(self, least: Array, nominal: Array) -> None:
        self.watched = np.flatnonzero(~(least > _SHARE * nominal))
        self.nominal = nominal[self.watched]

    @property
    def may_fall(self) -> bool:
        """True if any pivot may fall."""
        return bool(self.watched.size)

    def holds(self, bound: float, M: Array) -> bool:
        """True if an error bound of the nominal state is within tolerance at M (nv, nv) too."""
        return bound <= tolerances.SOLVED * self.left(M)

    def left(self, M: Array) -> float:
        """Smallest share of the nominal pivots that is left in M (nv, nv), at most 1."""
        # The error of accelerations is the estimate at the nominal state over this share.
        shares = (cholesky_pivots(M).take(self.watched) / self.nominal).tolist()
        least: float = min([*shares, 1.0])  # of nothing but NaN, or of none
        return 0.0 if isnan(least) else least


def least_pivots(model: Any) -> Array:
    """Lower bounds of the pivots of M at any q (nv,): zero where axes turn with q."""
    q, found, turn = pin.neutral(model), np.zeros(model.nv), joints_with_turning_axes(model)
    for i in range(1, model.njoints):
        joint = model.joints[i]
        if joint.nv <= 0 or joint.idx_v < 0 or i in turn:
            continue
        its = slice(joint.idx_v, joint.idx_v + joint.nv)
        S = axes(joint, q)
        own = S.T @ model.inertias[i].matrix() @ S + np.diag(model.armature[its])
        found[its] = np.nan_to_num(cholesky_pivots(own))
    return found
