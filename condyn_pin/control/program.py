"""The quadratic program of a tick, its held rows and torques eliminated.

Program: the quadratic program of one control tick, with a name for each of its rows.

    M a + h = passive + E t + J_l^T lam_l + J_c^T lam_c,     J_l a = r_l,     J_c a = r_c

    r = a_ref - gamma,    r = s'' - gamma of rows that are driven along s(t)

E puts the torques t = gears u of the motors into the equation; l are the rows that are held, loops
above all and joints that are taken for rigid, and c those of contacts with a cone. Held rows and
torques are eliminated (`elimination`): with m the mass of the robot, so that all unknowns are
accelerations,

    x = (z, lam_c / m, w / m),     a = a_0 + N z,     t / m = T x + t_0,

    min   sum_tasks w |J a - b|^2 + eps |x|^2
    with  what no motor reaches, and the contacts: equations
          torques, joints, cones: inequalities.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import isfinite, isinf
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array, entries
from condyn_pin._core.models import indices
from condyn_pin.constraints.rows.bound import Terms
from condyn_pin.constraints.rows.equations import Equations
from condyn_pin.constraints.rows.redundancy import Redundancy, RedundantRows
from condyn_pin.control.actuation import Actuation
from condyn_pin.control.cones import ContactCones
from condyn_pin.control.hierarchy import FLOOR, JOINT, LAW, MOTOR, Level, Stack, TaskRow, TaskRows
from condyn_pin.control.limits import (
    AccelerationBounds,
    ControlLimits,
    TorqueLimits,
    locked_velocity,
)
from condyn_pin.control.qp.qp_solver import Constraints, Elastic, peak
from condyn_pin.control.tasks.task import DefaultReference, RobotMotion, Task
from condyn_pin.dynamics.at_state import with_redundancy
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import InvalidArgument
from condyn_pin.model.robot import Robot

# What joints brake less than as well as they can, as a share of what they fall short by, and in
# m/s^2 or rad/s^2: the best alone would leave a program without an inside.
_ROOM: Final = 1e-3

# Constraints that a notice names.
_NAMED: Final = 3


class Program:
    """The program of a scene and its tasks; memory that changes from tick to tick."""

    # combinations of the held rows that were left out in the last tick; None if they were closed,
    # and stayed so
    left_out: RedundantRows | None = None
    passive: Array  # (nv,) torques that act anyway, in the last tick
    _asked: list[tuple[Stack, TaskRows]]  # by the tasks of the last tick

    def __init__(
        self,
        scene: Scene,
        levels: Sequence[Sequence[Task]],
        cones: ContactCones,
        limits: ControlLimits,
        actuation: Actuation,
        equations: Equations,
        home: DefaultReference,
        rigid: Sequence[str],
        regularisation: float,
    ) -> None:
        self._scene, robot = scene, scene.robot
        self.cones, self.equations = cones, equations
        self.motion = RobotMotion(scene, equations)  # at the state of the last tick
        self.mass = robot.mass  # of the robot [kg]
        self._regularisation = regularisation
        self.actuation, self._touching = actuation, entries(cones.touching)
        self.bounds = AccelerationBounds(limits, actuation)
        # limits of the motors that count
        self.torque = TorqueLimits.of(actuation, count=limits.torque)
        self._constraints = TickConstraints(cones, self.bounds, self.torque, self.mass)
        tasks = [task for level in levels for task in level]
        hard = [task for task in tasks if isinf(task.weight)]
        self.hard = Stack(scene, hard, home)  # tasks that are equations
        # the others
        self.levels = [
            Stack(scene, [task for task in level if task not in hard], home) for level in levels
        ]
        self.inequalities = self._inequality_rows()
        # (k, nv) A row of the identity for each joint that is taken for rigid
        self.rigid = rigid_rows(robot, rigid, actuation.columns)
        self._rigid_rest = np.zeros(len(self.rigid))
        self._none, self._no_loops = np.zeros((0, 0)), np.zeros((0, robot.nv))
        self._constant: Elimination | None = None
        if not len(cones.held):
            self._constant = Elimination.of(self.rigid, actuation.E)
        self._fixed: dict[Stack, tuple[Array, Array]] = {}  # where x has the same meaning always

    def locked_velocity(self, q: Array, v: Array) -> Array:
        """Return the velocity that is left if joints that are taken for rigid are locked."""
        if not (self.rigid @ v).any() or not isfinite(np.vdot(q, q) + np.vdot(v, v)):
            return v  # what is not finite is refused later
        loops = self._held.consistent_jacobian(q) if self._held else self._no_loops
        return locked_velocity(v, self.equations.mass(q), loops, self.rigid)

    @cached_property
    def _held(self) -> Equations | None:
        """The equations of what has no cone: its rows alone are held, and may be redundant."""
        scene, rows = self._scene, self.cones.held
        each = zip(scene.constraints, scene.bounds, strict=True)
        held = [constraint for constraint, bound in each if bound.rows.start in rows]
        if not held:
            return None
        alone = Scene(scene.robot, held)
        return with_redundancy(Equations(self.equations.model, alone.bounds), alone)

    @cached_property
    def _redundancy(self) -> Redundancy | None:
        """Redundancy of the held rows, if any look independent where they are open."""
        of = self._held and self._held.redundancy
        return of() if of else None

    def gaps(self, q: Array, t: float) -> Array:
        """Gaps (l,) of the held rows at q; none where nothing can be redundant beside them."""
        if self._redundancy is None:
            return self._rigid_rest[:0]
        self.equations.at(t)
        return self.equations.violation(q)[self.cones.held]

    def _left_out(self, gaps: Array) -> RedundantRows | None:
        """Combinations of held rows that are left out, or contradict the others as they move."""
        if self._redundancy is None:
            return None
        held = self.cones.held
        J = self.motion.terms.J[held]
        is_open = np.abs(gaps).max() > tolerances.OPEN
        rates = J @ self.motion.v - self.equations.wanted[1, held]
        if not (is_open or np.abs(rates).max() > tolerances.OPEN):
            return None
        return self._redundancy.left_out(J, gaps if is_open else 0.0 * gaps)

    def assemble(
        self, q: Array, v: Array, t: float, passive: Array
    ) -> tuple[Constraints, list[Level]]:
        """Return the constraints of a tick, and the levels of its tasks."""
        # They are in the memory of this object: the next tick overwrites them.
        gaps = self.gaps(q, t)  # before the motion, whose velocities it overwrites
        self.equations.at(t)
        self.motion.move(q, v)
        self.left_out = self._left_out(gaps)
        self.passive = passive
        self._at = self._reduced()
        self._asked = []
        levels = [self._level(stack, t) for stack in self.levels]
        wished = self._rows(self.hard, t)
        load = self.motion.terms.h - passive
        return self._constraints.of(self._at, wished, self.motion, load), levels

    @property
    def unreached(self) -> float:
        """Distance of redundant contacts from the accelerations they demand (`TickConstraints`)."""
        return self._constraints.unreached

    def _reduced(self) -> Reduction:
        """Return the equations of motion and contacts over z and lam_c / m."""
        terms, held, touching = self.motion.terms, self.cones.held, self._touching
        wanted, E = terms.a_ref - terms.gamma, self._constant
        J_l, r_l = terms.J[held], wanted[held]
        if self.left_out:
            J_l, r_l = self.left_out.kept(J_l), self.left_out.kept(r_l)
        if E is None:
            E = Elimination.of(np.concatenate((J_l, self.rigid)), self.actuation.E)
        r_l = np.concatenate((r_l, self._rigid_rest)) if E.holds else self._rigid_rest
        return reduced_equations(
            terms, terms.h - self.passive, E, r_l, terms.J[touching], wanted[touching], self.mass
        )

    def _rows(self, stack: Stack, t: float) -> TaskRows:
        """Return the rows of tasks, over x."""
        at = self._at
        if not stack.rows:
            return TaskRows(self._none, stack.weights)
        J, F, b = stack.at(self.motion, t)
        if len(F) and F[:, self.cones.held].any():
            raise InvalidArgument(
                f"tasks: one of {', '.join(stack.tasks)} is about the force of a contact that has "
                "no cone; cones={name: FrictionCone(...)} gives it one"
            )
        G = at.map.along(J)
        if at.map.holds:
            b[: len(J)] -= J @ at.a_0
        if len(F):
            k, m = at.touch.shape[1], len(at.touch)
            G = np.vstack((np.hstack((G, np.zeros((len(J), m)))), np.zeros((len(F), k + m))))
            G[len(J) :, k:] = self.mass * F[:, self.cones.touching]
        rows = TaskRows(G, b)
        self._asked.append((stack, rows))
        return rows

    def _level(self, stack: Stack, t: float) -> Level:
        """Return the rows of tasks, over x, and what they count."""
        W, H = self._fixed.get(stack) or self._unchanging(stack)
        return Level(self._rows(stack, t), stack.weights, stack.changing, W, H)

    def _unchanging(self, stack: Stack) -> tuple[Array, Array]:
        """Return the weights of the rows that change, and H of the others (`Level`)."""
        n, k, _ = self._at.sizes
        H = self._regularisation * np.eye(n)
        H[:k, :k] += self._at.map.within(stack.H)
        found = np.repeat(stack.weights[stack.changing, None], n, axis=1), H
        if self._constant:
            self._fixed[stack] = found
        return found

    def unkept(self, q: Array, v: Array, a: Array, lam: Array, size: float) -> tuple[str, ...]:
        """Notice of constraints that accelerate, by name, beside accelerations of this size."""
        _, s = self.equations.residuals(q, v, 0.0 * v, a, lam)
        rates = self.equations.jacobian(q) @ v - self.equations.wanted[1]
        by = {bound.name: peak(s[bound.rows]) for bound in self._scene.bounds}
        found = sorted((x, name) for name, x in by.items() if x > tolerances.SOLVED * size)
        if not found:
            return ()
        worst = ", ".join(f"{name} by {x:.2g}" for x, name in found[: -_NAMED - 1 : -1])
        more = f" and {len(found) - _NAMED} more" if len(found) > _NAMED else ""
        text = f"no acceleration keeps all constraints: {worst} m/s^2 or rad/s^2{more}"
        if peak(rates) > tolerances.CONSISTENT * max(1.0, peak(v)):
            text += (
                f"; they move at up to {peak(rates):.2g} m/s or rad/s, which "
                "mechanism.project_velocity takes off"
            )
        return (text,)

    def unviable(self) -> tuple[str, ...]:
        """Notices of joints that are beyond their limits, or too fast to be stopped before them."""
        terms = self.motion.terms
        load = terms.h - self.passive
        return self.bounds.unviable(self.motion.q, self.motion.v, terms.M.diagonal(), load)

    def relaxed(self, given: Constraints, gives: Elastic) -> tuple[Constraints, str] | None:
        """Constraints in which joints brake as well as motors and floor allow, and a notice of it.

        None if anything else has to give, or an acceleration would exceed its own limit.
        """
        first, columns = len(self.torque.names), self.bounds.columns
        rows = slice(first, first + len(columns))
        given_by, others = gives.of_inequalities[rows], gives.of_inequalities.copy()
        others[rows] = 0.0
        if self.bounds.dt is None or max(peak(others), peak(gives.of_equations)) > tolerances.GIVES:
            return None
        a = given.C[rows] @ gives.x
        room = _ROOM * (1.0 + given_by) * (given_by > tolerances.GIVES)
        lower = np.minimum(given.lower[rows], a - room)
        upper = np.maximum(given.upper[rows], a + room)
        most = self.bounds.most[columns] + 2.0 * room
        a_0 = self._at.a_0[columns]
        if (upper + a_0 > most).any() or (lower + a_0 < -most).any():
            return None
        bounds = given.lower.copy(), given.upper.copy()
        bounds[0][rows], bounds[1][rows] = lower, upper
        i = int(given_by.argmax())
        text = (
            f"{self.bounds.names[i]}: motors and floor cannot brake it as its limits demand, by "
            f"{given_by[i]:.3g} m/s^2 or rad/s^2: it is braked as well as they can"
        )
        return given._replace(lower=bounds[0], upper=bounds[1]), text

    def equation_rows(self, given: Constraints) -> list[TaskRow]:
        """Return the rows of the equations of a tick: name, unit, scale and cost."""
        laws = len(given.b) - len(self.hard.rows)
        return [TaskRow("equation of motion", "m/s^2", 1.0, LAW)] * laws + self.hard.rows

    def recover(self, x: Array) -> tuple[Array, Array, Array, Array, Array]:
        """Return a, u, tau, lam of all rows, and the torques of rigid joints, that belong to x."""
        at, terms, held = self._at, self.motion.terms, self.cones.held
        m, k = at.touch.shape
        a = at.a_0 + at.map.N @ x[:k] if at.map.holds else x[:k].copy()
        lam = np.zeros(len(terms.J))
        f = lam[self._touching] = self.mass * x[k : k + m]
        given = at.torque.dot(x)
        given += at.torque_0
        given *= self.mass
        u, tau = given / self.actuation.gears, self.actuation.E @ given
        if not at.map.holds:
            return a, u, tau, lam, np.zeros(0)
        left = terms.M @ a + terms.h - self.passive - tau - at.J_c.T @ f
        forces = at.map.forces(left)
        lam[held] = forces[: len(held)]
        return a, u, tau, lam, forces[len(held) :]

    def errors(self, x: Array) -> dict[str, Array]:
        """Return the residual of each task of the last tick, by name."""
        found: dict[str, Array] = {}
        for stack, rows in self._asked:
            left = rows.of(x)
            left -= rows.b
            for name, place in stack.tasks.items():
                found[name] = left[place]
        return found

    def _inequality_rows(self) -> list[TaskRow]:
        rows = [
            TaskRow(f"{name}: torque", "N m, N", self.mass, MOTOR) for name in self.torque.names
        ]
        unit = "rad/s^2, m/s^2"
        rows += [TaskRow(f"{name}: acceleration", unit, 1.0, JOINT) for name in self.bounds.names]
        return rows + [TaskRow(name, "N", self.mass, FLOOR) for name in self.cones.names]


def rigid_rows(robot: Robot, joints: Sequence[str], motors: NDArray[np.int_]) -> Array:
    """Return a row of the identity for each degree of freedom of joints that have no motor."""
    columns = indices(robot.model, joints)[1]
    if np.isin(columns, motors).any():
        raise InvalidArgument(f"rigid = {list(joints)}: one of them has a motor")
    return np.eye(robot.nv)[columns]


# TickConstraints: equations and inequalities of a control tick, in memory that is kept.
#
#     A x = b                  what no motor reaches, contacts, tasks that are equations
#     lower <= C x <= upper    torques, accelerations of joints, cones
#
# Zeros, and cones that do not turn with the robot, are written once for all ticks of one size.


class TickConstraints:
    """The constraints of one program, and their memory.

    mass: of the robot [kg]
    unreached: how far contacts with redundant rows are from what they demand, whatever moves, in
        the last tick: zero where their velocity is [m/s^2, rad/s^2]
    """

    unreached: float = 0.0
    _sizes: tuple[int, int, int] | None = None  # of the reductions that there is memory for
    _redundant: bool | None = None  # not known before the first tick

    def __init__(
        self, cones: ContactCones, bounds: AccelerationBounds, limits: TorqueLimits, mass: float
    ) -> None:
        self._cones, self._bounds, self._L = cones, bounds, limits.L
        self._least, self._most = limits.least / mass, limits.most / mass

    def of(self, at: Reduction, wished: TaskRows, motion: RobotMotion, load: Array) -> Constraints:
        """Return the constraints of a tick; overwritten by the next call."""
        # `wished` are rows of the tasks that are equations, `motion` is the state, for joints near
        # their limits and cones that turn, and `load` (nv,) is h - passive [N m, N].
        if at.sizes != self._sizes:
            self._sizes, self._memory = at.sizes, self._blank(at, wished)
        A, b, _, _, _ = self._memory
        first, m = len(at.unreached_0), len(at.touch)
        A[:first, : at.unreached.shape[1]] = at.unreached
        A[first : first + m, : at.touch.shape[1]] = at.touch
        A[first + m :, : wished.G.shape[1]] = wished.G
        np.negative(at.unreached_0, out=b[:first])
        b[first : first + m] = self._within_reach(at.touch, at.wanted)
        b[first + m :] = wished.b
        self._limit(at, motion, load)
        return self._memory

    def _blank(self, at: Reduction, wished: TaskRows) -> Constraints:
        """Return memory for as many unknowns and equations."""
        n, k, law = at.sizes
        m, cones = len(at.touch), self._cones
        p, first_cone = law + m + len(wished.b), len(self._most) + len(self._bounds.columns)
        r = first_cone + len(cones.names)
        made = Constraints(
            np.zeros((p, n)), np.zeros(p), np.zeros((r, n)), np.zeros(r), np.zeros(r)
        )
        made.lower[first_cone:], made.upper[first_cone:] = cones.lower, cones.upper
        if cones.constant is not None:
            made.C[first_cone:, k : k + m] = cones.constant
        return made

    def _limit(self, at: Reduction, motion: RobotMotion, load: Array) -> None:
        """Write the inequalities."""
        _, _, C, lower, upper = self._memory
        k, columns, first = at.touch.shape[1], self._bounds.columns, len(self._most)
        last = first + len(columns)
        given = self._L @ at.torque_0
        C[:first] = self._L @ at.torque
        np.subtract(self._least, given, out=lower[:first])
        np.subtract(self._most, given, out=upper[:first])
        if len(columns):
            C[first:last, :k] = at.map.N[columns]
            least, most = self._bounds.at(motion.q, motion.v, motion.terms.M.diagonal(), load)
            lower[first:last], upper[first:last] = least - at.a_0[columns], most - at.a_0[columns]
        if self._cones.constant is None:
            C[last:, k : k + len(at.touch)] = self._cones.rows(motion.data.oMi)

    def _within_reach(self, touch: Array, wanted: Array) -> Array:
        """Return the accelerations that contacts demand, or the nearest that their rows reach."""
        # Two points of a foot that turns cannot both keep their places: equations that contradict
        # each other would leave no torques at all.
        if self._redundant is False:
            return wanted
        best, rank = nearest_reachable(touch, wanted)
        if self._redundant is None:
            self._redundant = rank < len(touch)
        self.unreached = float(np.abs(best - wanted).max(initial=0.0))
        return best


# Elimination: accelerations that keep the loops, and torques that the motors then give.
#
# With J_l the rows that are held, J_l a = r, Q_1 R P^T = J_l^T by pivoted QR,
#
#     a = a_0 + N z,    a_0 = Q_1 R^-T (P^T r),    N = Q_2,
#
# and with the columns of the motors, of length 1, S = N^T E = X_1 s Y_1^T, of what the motors have
# to give
#
#     N^T E t = N^T f    is    t = (Y_1 s^-1 X_1^T) N^T f + Y_2 w,    X_2^T N^T f = 0.
#
# w is there where motors work against each other, through the loops or as cables on one joint.
# Without loops N = 1; if each motor has its joint, what motors have to give, and what none reaches,
# are then entries of f.


@dataclass(frozen=True, eq=False)
class Elimination:
    """The maps of one configuration."""

    N: Array  # (nv, k) orthonormal basis of the accelerations that the held rows leave
    inner: Array  # (motors, w) torques that do nothing: Y_2
    _drive: Any  # Y_1 s^-1 X_1^T; or the entries that it takes
    _undriven: Any  # X_2^T, likewise
    _Q: Array
    _R: Array
    _rest: Array  # R', of rows that are redundant
    _pivots: NDArray[np.int_]

    @property
    def holds(self) -> bool:
        """True if anything is eliminated: without held rows z is a, and a_0 = 0."""
        return len(self._pivots) > 0

    def along(self, rows: Array) -> Array:
        """Return rows over accelerations (..., nv), one or many, as rows over z: times N."""
        return rows @ self.N if self.holds else rows

    def within(self, M: Array) -> Array:
        """Return a symmetric matrix over accelerations (nv, nv), over z: N^T M N."""
        return self.N.T @ M @ self.N if self.holds else M

    def torques(self, f: Array) -> Array:
        """Return the torques of the motors for N^T f (k, ...)."""
        return np.asarray(self._drive @ f if _is_matrix(self._drive) else f[self._drive])

    def unreached(self, f: Array) -> Array:
        """Return the part of N^T f (k, ...) that no motor reaches."""
        return np.asarray(self._undriven @ f if _is_matrix(self._undriven) else f[self._undriven])

    @classmethod
    def free(cls, E: Array) -> Elimination:
        """Return the maps without held rows, for motors E (nv, k)."""
        nothing, none, nv = np.zeros((0, 0)), np.zeros(0, np.int_), len(E)
        columns = E.argmax(axis=0)
        if not np.array_equal(E, np.eye(nv)[:, columns]) or len({*columns}) < len(columns):
            return cls(np.eye(nv), *_driven(E), nothing, nothing, nothing, none)
        others = np.setdiff1d(np.arange(nv), columns)
        inner = np.zeros((len(columns), 0))
        drive, undriven = entries(columns), entries(others)
        return cls(np.eye(nv), inner, drive, undriven, nothing, nothing, nothing, none)

    @classmethod
    def of(cls, J: Array, E: Array) -> Elimination:
        """Return the maps of held rows J (m, nv) and motors E (nv, k), with columns of length 1."""
        if not len(J):
            return cls.free(E)
        Q, R, pivots, rank = _pivoted_qr(J.T, J.shape[1])
        if not rank:
            return cls.free(E)
        N = Q[:, rank:]
        R, rest = R[:rank, :rank], R[:rank, rank:]
        return cls(N, *_driven(N.T @ E), Q[:, :rank], R, rest, pivots)

    def particular(self, r: Array) -> Array:
        """Return a_0, the smallest acceleration with J a = r (m,)."""
        if not self.holds:
            return np.zeros(len(self.N))
        # imported here: scipy.linalg takes as long to import as Pinocchio
        from scipy.linalg.lapack import dtrtrs

        independent = self._pivots[: len(self._R)]
        return np.asarray(self._Q @ dtrtrs(self._R, r[independent], trans=1)[0])

    def forces(self, f: Array) -> Array:
        """Return lam (m,) of the held rows with J^T lam = f, the smallest if many."""
        # Where rows are redundant, J^T P = Q_1 (R, R'), it is, with W = R^-1 R',
        #     P^T lam = (y, W^T y),    (1 + W W^T) y = R^-1 Q_1^T f.
        from scipy.linalg.lapack import dtrtrs

        rank = len(self._R)
        y, lam = dtrtrs(self._R, self._Q.T @ f)[0], np.empty(len(self._pivots))
        if self._rest.size:
            W = dtrtrs(self._R, self._rest)[0]
            y = np.linalg.solve(np.eye(rank) + W @ W.T, y)
            lam[self._pivots[rank:]] = W.T @ y
        lam[self._pivots[:rank]] = y
        return lam


def _driven(S: Array) -> tuple[Array, Array, Array]:
    """Y_2, Y_1 s^-1 X_1^T and X_2^T of S = N^T E."""
    X, s, Yt = np.linalg.svd(S)
    reached = int(np.count_nonzero(s > tolerances.RANK))
    drive = (Yt[:reached].T / s[:reached]) @ X[:, :reached].T
    return Yt[reached:].T, drive, X[:, reached:].T


def _is_matrix(places: Any) -> bool:
    """True of a matrix, and not of entries to take."""
    return isinstance(places, np.ndarray) and places.ndim == 2


def nearest_reachable(J: Array, r: Array) -> tuple[Array, int]:
    """Return the J z nearest to r (m,), and the rank of J (m, k)."""
    if not J.size:
        return r, 0
    Q, _, _, rank = _pivoted_qr(J, min(J.shape))
    return (Q[:, :rank] @ (Q[:, :rank].T @ r) if rank < len(J) else r), rank


def _pivoted_qr(A: Array, columns: int) -> tuple[Array, Array, NDArray[np.int_], int]:
    """Return Q (m, columns), R, pivots and rank of A (m, n) with Q R = A[:, pivots]."""
    # R is in the upper triangle; what is below is no part of it. LAPACK is asked itself: for
    # matrices of this size what `scipy.linalg.qr` does around it takes as long.
    # imported here: scipy.linalg takes as long to import as Pinocchio
    from scipy.linalg.lapack import dgeqp3, dorgqr

    R, order, reflectors, _, _ = dgeqp3(A)
    start = np.zeros((len(A), columns), order="F")
    kept = min(A.shape[1], columns)
    start[:, :kept] = R[:, :kept]
    Q = dorgqr(start, reflectors, overwrite_a=1)[0]
    sizes = np.abs(R.diagonal())
    return Q, R, order - 1, int(np.count_nonzero(sizes > tolerances.RANK * sizes[0]))


# The equations of one control tick, with what is held and the torques eliminated.
#
#     M a + h = passive + E t + J_l^T lam_l + J_c^T lam_c,     J_l a = r_l,     J_c a = r_c
#
# become, with f = lam_c / m over the mass of the robot, a = a_0 + N z (`elimination`), and w
# torques that do nothing,
#
#     X_2^T N^T (M a + h - passive - J_c^T lam_c) / m = 0,     J_c N z = r_c - J_c a_0,
#     t / m = T x + t_0,     x = (z, f, w / m).


class Reduction(NamedTuple):
    """The equations of a tick over z and f = lam_c / m."""

    map: Elimination
    a_0: Array  # (nv,) what the held rows alone demand [rad/s^2, m/s^2]
    # J_c (m_c, nv), touch (m_c, k): rows of contacts with a cone, over a and over z
    J_c: Array
    touch: Array
    wanted: Array  # (m_c,) what they demand of z [m/s^2, rad/s^2]
    # unreached (p, k + m_c), unreached_0 (p,): what no motor reaches of N^T (M a + h - passive -
    # J_c^T lam_c) / m, over (z, f) and with both zero
    unreached: Array
    unreached_0: Array
    # torque (motors, n), torque_0 (motors,): T and t_0: what motors give, over x and with x = 0
    torque: Array
    torque_0: Array

    @property
    def sizes(self) -> tuple[int, int, int]:
        """Numbers of unknowns, of those in z, and of equations that no motor reaches."""
        return self.torque.shape[1], self.touch.shape[1], len(self.unreached_0)


def reduced_equations(
    terms: Terms, given: Array, E: Elimination, held: Array, J_c: Array, r_c: Array, mass: float
) -> Reduction:
    """Return the equations over z and lam_c / m, with the held rows eliminated by E."""
    # `given` (nv,) is h - passive [N m, N]; `held` (l,) and r_c (m_c,) are what the held rows and
    # those of the contacts J_c (m_c, nv) have to be, J_l a and J_c a [m/s^2, rad/s^2].
    a_0 = E.particular(held)
    if E.holds:
        given, r_c = given + terms.M @ a_0, r_c - J_c @ a_0
    touch = E.along(J_c)
    force = np.concatenate((E.within(terms.M) * (1.0 / mass), -touch.T), axis=1)
    force_0 = E.along(given) / mass
    torque = E.torques(force)
    if E.inner.shape[1]:
        torque = np.hstack((torque, E.inner))
    law = E.unreached(force), E.unreached(force_0)
    return Reduction(E, a_0, J_c, touch, r_c, *law, torque, E.torques(force_0))
