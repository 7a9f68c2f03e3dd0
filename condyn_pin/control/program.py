"""Program: the quadratic program of one control tick, with a name for each of its rows.

    M a + h = passive + E t + J_l^T lam_l + J_c^T lam_c,     J_l a = r_l,     J_c a = r_c

E puts the torques t of the motors into the equation; l are the rows that are held, loops above all,
and c those of contacts with a cone. Held rows and torques are eliminated (`elimination`): with m
the mass of the robot, so that all unknowns are accelerations,

    x = (z, lam_c / m, w / m),     a = a_0 + N z,     t / m = T x + t_0,

    min   sum_tasks w |J a - b|^2 + eps |x|^2
    with  what no motor reaches, and the contacts: equations
          torques, joints, cones: inequalities.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import isinf

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.rows.equations import Equations
from condyn_pin.control.actuation import Actuation
from condyn_pin.control.contact_cones import ContactCones
from condyn_pin.control.control_limits import AccelerationBounds, ControlLimits, torque_limits
from condyn_pin.control.elimination import Elimination
from condyn_pin.control.motion import Motion
from condyn_pin.control.qp.quadratic_program import QuadraticProgram
from condyn_pin.control.tasks.base import Home, Task
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import InvalidArgument

# What it costs that a row gives: wishes before limits of joints, those before motors, and the floor
# last. Equations of motion and contacts never give.
_WISH, _JOINT, _MOTOR, _FLOOR, _LAW = 1.0, 1e1, 1e2, 1e3, np.inf


@dataclass(frozen=True, eq=False)
class Row:
    """What a row of the program is.

    Attributes
    ----------
    name : str
    unit : str
    scale : float
        What a number of the program is in its unit.
    cost : float
        Of giving, where rows contradict each other.
    """

    name: str
    unit: str
    scale: float
    cost: float


@dataclass(frozen=True, eq=False)
class Level:
    """Rows of tasks over x: w |G x - b|^2.

    Attributes
    ----------
    G, b, weights : (r, n), (r,), (r,) array
    """

    G: Array
    b: Array
    weights: Array


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
    """

    passive: Array

    def __init__(
        self,
        scene: Scene,
        levels: Sequence[Sequence[Task]],
        cones: ContactCones,
        limits: ControlLimits,
        actuation: Actuation,
        equations: Equations,
        home: Home,
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
        self._hard = _Stack(scene, hard, self, home)
        self._levels = [
            _Stack(scene, [task for task in level if task not in hard], self, home)
            for level in levels
        ]
        self.inequalities = self._inequality_rows(actuation)
        self._nothing = np.zeros(len(cones.names))
        self._endless = self._nothing - np.inf
        no_loops = not len(cones.held)
        self._constant = Elimination.free(robot.nv, self._columns) if no_loops else None

    def assemble(
        self, q: Array, v: Array, t: float, passive: Array
    ) -> tuple[QuadraticProgram, list[Level]]:
        """Return the constraints of a tick, without an objective, and the levels of its tasks."""
        self.motion.move(q, v)
        self.passive = passive
        terms, held, touching = self.motion.terms, self.cones.held, self.cones.touching
        E = self._constant or Elimination.of(terms.J[held], self._columns)
        r = terms.a_ref - terms.gamma
        a_0 = E.particular(r[held])
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

        hard, n = self._hard.level(self.motion, t, self), T.shape[1]
        self._wished = hard
        unreached, unreached_0 = E.unreached(force), E.unreached(force_0)
        first = len(unreached)
        last = first + len(touch)
        A = np.zeros((last + len(hard.b), n))
        A[:first, : force.shape[1]] = unreached
        A[first:last, : touch.shape[1]] = touch
        A[last:] = hard.G
        b = np.concatenate((-unreached_0, r[touching] - J_c @ a_0, hard.b))
        C, lower, upper = self._inequalities(q, v)
        program = QuadraticProgram(np.zeros((n, n)), np.zeros(n), A, b, C, lower, upper)
        return program, [stack.level(self.motion, t, self) for stack in self._levels]

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
        return [Row("equation of motion", "m/s^2", 1.0, _LAW)] * laws + self._hard.rows

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
    def a_0(self) -> Array:
        """What the held rows alone demand (nv,) [rad/s^2, m/s^2]."""
        return self._at[1]

    def recover(self, x: Array) -> tuple[Array, Array, Array]:
        """Return a, tau and lam, the forces of all rows, that belong to x."""
        E, a_0, J_c, T, t_0 = self._at
        terms, k, m = self.motion.terms, E.N.shape[1], len(self.cones.touching)
        a = a_0 + E.N @ x[:k]
        lam, tau = np.zeros(len(terms.J)), np.zeros(len(a))
        lam[self.cones.touching] = self.mass * x[k : k + m]
        tau[self._columns] = self.mass * (T @ x + t_0)
        if len(self.cones.held):
            left = terms.M @ a + terms.h - self.passive - tau
            left -= J_c.T @ lam[self.cones.touching]
            of_held = terms.J[self.cones.held].T
            lam[self.cones.held] = np.linalg.lstsq(of_held, left, rcond=tolerances.RANK)[0]
        return a, tau, lam

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
        rows = [Row(f"{motors[i]}: torque", "N m, N", self.mass, _MOTOR) for i in self._limited]
        unit = "rad/s^2, m/s^2"
        rows += [Row(f"{name}: acceleration", unit, 1.0, _JOINT) for name in self._bounds.names]
        return rows + [Row(name, "N", self.mass, _FLOOR) for name in self.cones.names]


class _Stack:
    """Tasks whose rows stand below each other: accelerations first, then forces."""

    def __init__(self, scene: Scene, tasks: Sequence[Task], program: Program, home: Home) -> None:
        bound = [(task, task.bind(scene, home)) for task in tasks]
        self.tasks: dict[str, slice] = {}
        self._over_a = [each for _, each in bound if each.over == "accelerations"]
        self._over_f = [each for _, each in bound if each.over == "forces"]
        self.rows: list[Row] = []
        weights: list[float] = []
        for over in ("accelerations", "forces"):
            for task, each in bound:
                if each.over != over:
                    continue
                start = len(self.rows)
                self.rows += [Row(name, each.unit, 1.0, _WISH) for name in each.names]
                weights += [task.weight] * len(each.names)
                self.tasks[task.name] = slice(start, len(self.rows))
        self._weights = np.array(weights)
        self._none = np.zeros((0, scene.robot.nv)), np.zeros((0, scene.rows))

    def level(self, motion: Motion, t: float, program: Program) -> Level:
        """Return the rows at a state, over x."""
        if not self.rows:
            return Level(program.over_x(*self._none), np.zeros(0), self._weights)
        of_a = [each.rows(motion, t) for each in self._over_a]
        of_f = [each.rows(motion, t) for each in self._over_f]
        J = np.vstack([rows for rows, _ in of_a]) if of_a else self._none[0]
        F = np.vstack([rows for rows, _ in of_f]) if of_f else self._none[1]
        if len(F) and F[:, program.cones.held].any():
            raise InvalidArgument(
                f"tasks: one of {', '.join(self.tasks)} is about the force of a contact that has "
                "no cone; cones={name: FrictionCone(...)} gives it one"
            )
        b = np.concatenate([*(b for _, b in of_a), *(b for _, b in of_f), np.zeros(0)])
        b[: len(J)] -= J @ program.a_0
        return Level(program.over_x(J, F), b, self._weights)
