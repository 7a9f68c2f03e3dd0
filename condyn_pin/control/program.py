"""Program: the quadratic program of one control tick, with a name for each of its rows.

    M a + h = passive + E t + J_l^T lam_l + J_c^T lam_c,     J_l a = r_l,     J_c a = r_c

E puts the torques t of the motors into the equation; l are the rows that are held, loops above all
and joints that are taken for rigid, and c those of contacts with a cone. Held rows and torques are
eliminated (`elimination`): with m the mass of the robot, so that all unknowns are accelerations,

    x = (z, lam_c / m, w / m),     a = a_0 + N z,     t / m = T x + t_0,

    min   sum_tasks w |J a - b|^2 + eps |x|^2
    with  what no motor reaches, and the contacts: equations
          torques, joints, cones: inequalities.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import isinf

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array
from condyn_pin._core.joints import indices
from condyn_pin.constraints.rows.equations import Equations
from condyn_pin.control.actuation import Actuation
from condyn_pin.control.contact_cones import ContactCones
from condyn_pin.control.control_limits import AccelerationBounds, ControlLimits, torque_limits
from condyn_pin.control.elimination import Elimination, reached
from condyn_pin.control.levels import FLOOR, JOINT, LAW, MOTOR, Level, Row, Stack
from condyn_pin.control.motion import Motion
from condyn_pin.control.qp.quadratic_program import QuadraticProgram
from condyn_pin.control.tasks.base import Home, Task
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import InvalidArgument
from condyn_pin.model.robot import Robot


class Program:
    """The program of a scene and its tasks; memory that changes from tick to tick.

    Attributes
    ----------
    equations : Equations
    cones : ContactCones
    motion : Motion
        At the state of the last tick.
    passive : (nv,) array
        Torques that act anyway, in the last tick.
    rigid : (k, nv) array
        A row of the identity for each joint that is taken for rigid.
    unreached : float
        How far contacts with redundant rows are from what they demand, whatever moves, in the last
        tick: zero where their velocity is [m/s^2, rad/s^2].
    """

    passive: Array
    unreached: float = 0.0

    def __init__(
        self,
        scene: Scene,
        levels: Sequence[Sequence[Task]],
        cones: ContactCones,
        limits: ControlLimits,
        actuation: Actuation,
        equations: Equations,
        home: Home,
        rigid: Sequence[str],
    ) -> None:
        robot = scene.robot
        self.cones, self.equations = cones, equations
        self.motion = Motion(scene, equations)
        self.mass = robot.mass
        self._columns = actuation.columns
        self._bounds = AccelerationBounds(robot, limits, self._columns)
        most = torque_limits(robot, self._columns)
        self._limited = np.flatnonzero(np.isfinite(most)) if limits.torque else np.zeros(0, int)
        self._most = most[self._limited] / self.mass
        tasks = [task for level in levels for task in level]
        hard = [task for task in tasks if isinf(task.weight)]
        self._hard = Stack(scene, hard, home)
        self._levels = [
            Stack(scene, [task for task in level if task not in hard], home) for level in levels
        ]
        self.inequalities = self._inequality_rows(actuation)
        self._redundant: bool | None = None  # not known before the first tick
        self.rigid = _rigid_rows(robot, rigid, self._columns)
        self._nothing = np.zeros(len(cones.names))
        self._endless = self._nothing - np.inf
        self._constant: Elimination | None = None
        if not len(cones.held):
            self._constant = Elimination.of(self.rigid, self._columns)

    def assemble(
        self, q: Array, v: Array, t: float, passive: Array
    ) -> tuple[QuadraticProgram, list[Level]]:
        """Return the constraints of a tick, without an objective, and the levels of its tasks."""
        self.motion.move(q, v)
        self.passive = passive
        terms, held, touching = self.motion.terms, self.cones.held, self.cones.touching
        E = self._constant or Elimination.of(self._held_rows, self._columns)
        r = terms.a_ref - terms.gamma
        a_0 = E.particular(np.concatenate((r[held], np.zeros(len(self.rigid)))))
        J_c = terms.J[touching] if len(held) else terms.J
        touch = E.along(J_c)
        k = E.N.shape[1]
        force = np.empty((k, k + len(touch)))  # N^T (M a - J_c^T lam) / m
        np.divide(E.along(E.along(terms.M).T), self.mass, out=force[:, :k])
        np.negative(touch.T, out=force[:, k:])
        force_0 = E.along(terms.M @ a_0 + terms.h - passive) / self.mass
        T, t_0 = E.torques(force), E.torques(force_0)
        if E.inner.shape[1]:
            T = np.hstack((T, E.inner))
        self._at = E, a_0, J_c, T, t_0

        hard, n = self._level(self._hard, t), T.shape[1]
        self._wished = hard
        unreached, unreached_0 = E.unreached(force), E.unreached(force_0)
        first = len(unreached)
        last = first + len(touch)
        A = np.zeros((last + len(hard.b), n))
        A[:first, : force.shape[1]] = unreached
        A[first:last, : touch.shape[1]] = touch
        A[last:] = hard.G
        wanted = self._within_reach(touch, r[touching] - J_c @ a_0)
        b = np.concatenate((-unreached_0, wanted, hard.b))
        C, lower, upper = self._inequalities(q, v)
        program = QuadraticProgram(np.zeros((n, n)), np.zeros(n), A, b, C, lower, upper)
        return program, [self._level(stack, t) for stack in self._levels]

    def _level(self, stack: Stack, t: float) -> Level:
        """Return the rows of tasks, over x."""
        if not stack.rows:
            return Level(self.over_x(*stack.none), np.zeros(0), stack.weights)
        J, F, b = stack.at(self.motion, t)
        if F[:, self.cones.held].any():
            raise InvalidArgument(
                f"tasks: one of {', '.join(stack.tasks)} is about the force of a contact that has "
                "no cone; cones={name: FrictionCone(...)} gives it one"
            )
        b[: len(J)] -= J @ self.a_0
        return Level(self.over_x(J, F), b, stack.weights)

    def _within_reach(self, touch: Array, wanted: Array) -> Array:
        """Return what contacts demand, as near as their rows can come to it.

        Two points of a foot that turns cannot both keep their places: equations that contradict
        each other would leave no torques at all.
        """
        if self._redundant is False:
            return wanted
        best, rank = reached(touch, wanted)
        if self._redundant is None:
            self._redundant = rank < len(touch)
        self.unreached = float(np.abs(best - wanted).max(initial=0.0))
        return best

    def _inequalities(self, q: Array, v: Array) -> tuple[Array, Array, Array]:
        """Return C and its bounds: torques, accelerations of joints, cones."""
        E, a_0, _, T, t_0 = self._at
        columns, k = self._bounds.columns, E.N.shape[1]
        first = len(self._limited)
        last = first + len(columns)
        C = np.zeros((len(self.inequalities), T.shape[1]))
        C[:first] = T[self._limited]
        C[first:last, :k] = E.N[columns]
        C[last:, k : k + len(self.cones.touching)] = self.cones.rows(self.motion.data.oMi)
        least, most = self._bounds.at(q, v)
        given = t_0[self._limited]
        lower = np.concatenate((-self._most - given, least - a_0[columns], self._endless))
        upper = np.concatenate((self._most - given, most - a_0[columns], self._nothing))
        return C, lower, upper

    def equation_rows(self, program: QuadraticProgram) -> list[Row]:
        """Return what the equations of a program are."""
        laws = len(program.b) - len(self._hard.rows)
        return [Row("equation of motion", "m/s^2", 1.0, LAW)] * laws + self._hard.rows

    def over_x(self, J: Array, F: Array) -> Array:
        """Return rows of accelerations (r, nv), and of forces (s, m), as rows over x."""
        E = self._at[0]
        k, m = E.N.shape[1], len(self.cones.touching)
        G = np.zeros((len(J) + len(F), k + m + E.inner.shape[1]))
        G[: len(J), :k] = E.along(J)
        if len(F):
            G[len(J) :, k : k + m] = self.mass * F[:, self.cones.touching]
        return G

    @property
    def _held_rows(self) -> Array:
        return np.vstack((self.motion.terms.J[self.cones.held], self.rigid))

    @property
    def a_0(self) -> Array:
        """What the held rows alone demand (nv,) [rad/s^2, m/s^2]."""
        return self._at[1]

    def recover(self, x: Array) -> tuple[Array, Array, Array, Array]:
        """Return a, tau, lam of all rows, and the torques of rigid joints, that belong to x."""
        E, a_0, J_c, T, t_0 = self._at
        terms, k, m = self.motion.terms, E.N.shape[1], len(self.cones.touching)
        a, held = a_0 + E.N @ x[:k], self.cones.held
        lam, tau = np.zeros(len(terms.J)), np.zeros(len(a))
        lam[self.cones.touching] = self.mass * x[k : k + m]
        tau[self._columns] = self.mass * (T @ x + t_0)
        rows = self._held_rows
        if not len(rows):
            return a, tau, lam, np.zeros(0)
        left = terms.M @ a + terms.h - self.passive - tau - J_c.T @ lam[self.cones.touching]
        forces = np.linalg.lstsq(rows.T, left, rcond=tolerances.RANK)[0]
        lam[held] = forces[: len(held)]
        return a, tau, lam, np.asarray(forces[len(held) :], dtype=float)

    def errors(self, levels: Sequence[Level], x: Array) -> dict[str, Array]:
        """Return how far each task is from what it wants, by name."""
        found: dict[str, Array] = {}
        stacks = zip((*self._levels, self._hard), (*levels, self._wished), strict=True)
        for stack, level in stacks:
            left = level.G @ x - level.b
            found |= {name: left[rows] for name, rows in stack.tasks.items()}
        return found

    def _inequality_rows(self, actuation: Actuation) -> list[Row]:
        motors = actuation.motors
        rows = [Row(f"{motors[i]}: torque", "N m, N", self.mass, MOTOR) for i in self._limited]
        unit = "rad/s^2, m/s^2"
        rows += [Row(f"{name}: acceleration", unit, 1.0, JOINT) for name in self._bounds.names]
        return rows + [Row(name, "N", self.mass, FLOOR) for name in self.cones.names]


def _rigid_rows(robot: Robot, joints: Sequence[str], motors: NDArray[np.int_]) -> Array:
    """Return a row of the identity for each degree of freedom of joints that have no motor."""
    columns = indices(robot.model, joints)[1]
    if np.isin(columns, motors).any():
        raise InvalidArgument(f"rigid = {list(joints)}: one of them has a motor")
    return np.eye(robot.nv)[columns]
