"""Program: the quadratic program of one control tick, with a name for each of its rows.

    M a + h = passive + E t + J_l^T lam_l + J_c^T lam_c,     J_l a = r_l,     J_c a = r_c

    r = a_ref - gamma,    r = s'' - gamma of rows that are driven along s(t)

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
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core.arrays import Array, entries
from condyn_pin._core.joints import indices
from condyn_pin.constraints.rows.equations import Equations
from condyn_pin.control.actuation import Actuation
from condyn_pin.control.contact_cones import ContactCones
from condyn_pin.control.control_limits import AccelerationBounds, ControlLimits, torque_limits
from condyn_pin.control.elimination import Elimination, reached
from condyn_pin.control.levels import FLOOR, JOINT, LAW, MOTOR, Level, Row, Stack
from condyn_pin.control.motion import Motion
from condyn_pin.control.qp.quadratic_program import Constraints
from condyn_pin.control.tasks.base import Home, Task
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import InvalidArgument
from condyn_pin.model.robot import Robot


class _Eliminated(NamedTuple):
    """The equations of a tick over z and f = lam_c / m.

    Attributes
    ----------
    map : Elimination
    a_0 : (nv,) array
        What the held rows alone demand [rad/s^2, m/s^2].
    J_c, touch : (m_c, nv), (m_c, k) array
        Rows of contacts with a cone, over a and over z.
    wanted : (m_c,) array
        What they demand of z [m/s^2, rad/s^2].
    unreached, unreached_0 : (p, k + m_c), (p,) array
        What no motor reaches of N^T (M a + h - passive - J_c^T lam_c) / m, over (z, f) and with
        both zero.
    torque, torque_0 : (motors, n), (motors,) array
        T and t_0: what motors give, over x and with x = 0.
    """

    map: Elimination
    a_0: Array
    J_c: Array
    touch: Array
    wanted: Array
    unreached: Array
    unreached_0: Array
    torque: Array
    torque_0: Array


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
    mass : float
        Of the robot [kg].
    columns : (k,) int array
        Entries of v that have a motor.
    limited, most : (l,) int array, (l,) array
        Which motors have a limit, and that limit over the mass.
    bounds : AccelerationBounds
    hard : Stack
        Tasks that are equations.
    levels : list of Stack
        The others.
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
        self.columns = actuation.columns
        self._motors, self._touching = entries(self.columns), entries(cones.touching)
        self.bounds = AccelerationBounds(robot, limits, self.columns)
        most = torque_limits(robot, self.columns)
        limited = np.flatnonzero(np.isfinite(most)) if limits.torque else np.zeros(0, int)
        self.limited, self._limited = limited, entries(limited)
        self.most = most[limited] / self.mass
        tasks = [task for level in levels for task in level]
        hard = [task for task in tasks if isinf(task.weight)]
        self.hard = Stack(scene, hard, home)
        self.levels = [
            Stack(scene, [task for task in level if task not in hard], home) for level in levels
        ]
        self.inequalities = self._inequality_rows([actuation.motors[i] for i in limited])
        self._redundant: bool | None = None  # not known before the first tick
        self.rigid = rigid_rows(robot, rigid, self.columns)
        self._nothing = np.zeros(len(cones.names))
        self._endless = self._nothing - np.inf
        self._constant: Elimination | None = None
        if not len(cones.held):
            self._constant = Elimination.of(self.rigid, self.columns)

    def assemble(
        self, q: Array, v: Array, t: float, passive: Array
    ) -> tuple[Constraints, list[Level]]:
        """Return the constraints of a tick, and the levels of its tasks."""
        self.equations.at(t)
        self.motion.move(q, v)
        self.passive = passive
        at = self._at = self._eliminated()
        hard = self._wished = self._level(self.hard, t)
        first = len(at.unreached)
        last = first + len(at.touch)
        A = np.zeros((last + len(hard.b), self._size))
        A[:first, : at.unreached.shape[1]] = at.unreached
        A[first:last, : at.touch.shape[1]] = at.touch
        A[last:] = hard.G
        b = np.concatenate((-at.unreached_0, self._within_reach(at.touch, at.wanted), hard.b))
        given = Constraints(A, b, *self._inequalities(q, v))
        return given, [self._level(stack, t) for stack in self.levels]

    def _eliminated(self) -> _Eliminated:
        """Return the equations of motion and contacts over z and lam_c / m."""
        terms, held, touching = self.motion.terms, self.cones.held, self._touching
        rows, E = self.rigid, self._constant
        wanted = terms.a_ref - terms.gamma
        if E is None:
            rows = np.concatenate((terms.J[held], rows))
            E = Elimination.of(rows, self.columns)
        J_c, h = terms.J[touching], terms.h - self.passive
        a_0, r_c = np.zeros(len(h)), wanted[touching]
        if E.holds:
            a_0 = E.particular(np.concatenate((wanted[held], np.zeros(len(self.rigid)))))
            h, r_c = h + terms.M @ a_0, r_c - J_c @ a_0
        touch = E.along(J_c)
        k = E.N.shape[1]
        force, force_0 = np.empty((k, k + len(touch))), E.along(h) / self.mass
        np.multiply(E.within(terms.M), 1.0 / self.mass, out=force[:, :k])
        np.negative(touch.T, out=force[:, k:])
        torque = E.torques(force)
        if E.inner.shape[1]:
            torque = np.hstack((torque, E.inner))
        law = E.unreached(force), E.unreached(force_0)
        return _Eliminated(E, a_0, J_c, touch, r_c, *law, torque, E.torques(force_0))

    @property
    def _size(self) -> int:
        """How many unknowns x has."""
        return int(self._at.torque.shape[1])

    def _level(self, stack: Stack, t: float) -> Level:
        """Return the rows of tasks, over x."""
        if not stack.rows:
            return Level(np.zeros((0, self._size)), np.zeros(0), stack.weights)
        J, F, b = stack.at(self.motion, t)
        if len(F) and F[:, self.cones.held].any():
            raise InvalidArgument(
                f"tasks: one of {', '.join(stack.tasks)} is about the force of a contact that has "
                "no cone; cones={name: FrictionCone(...)} gives it one"
            )
        at = self._at
        k, m = at.map.N.shape[1], len(at.touch)
        G = np.zeros((len(b), self._size))
        G[: len(J), :k] = at.map.along(J)
        if len(F):
            G[len(J) :, k : k + m] = self.mass * F[:, self.cones.touching]
        if at.map.holds:
            b[: len(J)] -= J @ at.a_0
        return Level(G, b, stack.weights)

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
        at, k, columns = self._at, self._at.map.N.shape[1], self.bounds.columns
        first = len(self.most)
        last = first + len(columns)
        C = np.zeros((len(self.inequalities), self._size))
        C[:first] = at.torque[self._limited]
        C[last:, k : k + len(at.touch)] = self.cones.rows(self.motion.data.oMi)
        given = at.torque_0[self._limited]
        lower, upper = [-self.most - given], [self.most - given]
        if len(columns):
            C[first:last, :k] = at.map.N[columns]
            least, most = self.bounds.at(q, v)
            lower, upper = [*lower, least - at.a_0[columns]], [*upper, most - at.a_0[columns]]
        return (
            C,
            np.concatenate((*lower, self._endless)),
            np.concatenate((*upper, self._nothing)),
        )

    def equation_rows(self, given: Constraints) -> list[Row]:
        """Return what the equations of a tick are."""
        laws = len(given.b) - len(self.hard.rows)
        return [Row("equation of motion", "m/s^2", 1.0, LAW)] * laws + self.hard.rows

    def recover(self, x: Array) -> tuple[Array, Array, Array, Array]:
        """Return a, tau, lam of all rows, and the torques of rigid joints, that belong to x."""
        at, terms, held = self._at, self.motion.terms, self.cones.held
        m, k = at.touch.shape
        a = at.a_0 + at.map.N @ x[:k] if at.map.holds else x[:k].copy()
        lam, tau = np.zeros(len(terms.J)), np.zeros(len(a))
        f = lam[self._touching] = self.mass * x[k : k + m]
        tau[self._motors] = self.mass * (at.torque @ x + at.torque_0)
        if not at.map.holds:
            return a, tau, lam, np.zeros(0)
        left = terms.M @ a + terms.h - self.passive - tau - at.J_c.T @ f
        forces = at.map.forces(left)
        lam[held] = forces[: len(held)]
        return a, tau, lam, forces[len(held) :]

    def errors(self, levels: Sequence[Level], x: Array) -> dict[str, Array]:
        """Return how far each task is from what it wants, by name."""
        found: dict[str, Array] = {}
        stacks = zip((*self.levels, self.hard), (*levels, self._wished), strict=True)
        for stack, level in stacks:
            if not stack.tasks:
                continue
            left = level.G @ x - level.b
            found |= {name: left[rows] for name, rows in stack.tasks.items()}
        return found

    def _inequality_rows(self, limited: Sequence[str]) -> list[Row]:
        rows = [Row(f"{name}: torque", "N m, N", self.mass, MOTOR) for name in limited]
        unit = "rad/s^2, m/s^2"
        rows += [Row(f"{name}: acceleration", unit, 1.0, JOINT) for name in self.bounds.names]
        return rows + [Row(name, "N", self.mass, FLOOR) for name in self.cones.names]


def rigid_rows(robot: Robot, joints: Sequence[str], motors: NDArray[np.int_]) -> Array:
    """Return a row of the identity for each degree of freedom of joints that have no motor."""
    columns = indices(robot.model, joints)[1]
    if np.isin(columns, motors).any():
        raise InvalidArgument(f"rigid = {list(joints)}: one of them has a motor")
    return np.eye(robot.nv)[columns]
