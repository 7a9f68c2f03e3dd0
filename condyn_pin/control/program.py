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
from functools import cached_property
from math import isfinite, isinf
from typing import Final

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array, entries
from condyn_pin._core.joints import indices
from condyn_pin.constraints.rows.equations import Equations
from condyn_pin.constraints.rows.redundancy import LeftOut, Redundancy
from condyn_pin.control.actuation import Actuation
from condyn_pin.control.contact_cones import ContactCones
from condyn_pin.control.control_limits import AccelerationBounds, ControlLimits, torque_limits
from condyn_pin.control.elimination import Elimination
from condyn_pin.control.levels import FLOOR, JOINT, LAW, MOTOR, Level, Row, Rows, Stack
from condyn_pin.control.motion import Motion
from condyn_pin.control.qp.elastic import Elastic
from condyn_pin.control.qp.quadratic_program import Constraints, peak
from condyn_pin.control.reduction import Reduction, reduced
from condyn_pin.control.swing import locked
from condyn_pin.control.tasks.base import Home, Task
from condyn_pin.control.tick_constraints import TickConstraints
from condyn_pin.dynamics.at_state import told
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import InvalidArgument
from condyn_pin.model.robot import Robot

# What joints brake less than as well as they can, as a share of what they fall short by, and in
# m/s^2 or rad/s^2: the best alone would leave a program without an inside.
_ROOM: Final = 1e-3

# Constraints that a notice names.
_NAMED: Final = 3


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
    left_out : LeftOut or None
        Combinations of the held rows that were left out in the last tick; None if they were closed,
        and stayed so.
    """

    left_out: LeftOut | None = None
    passive: Array
    _asked: list[tuple[Stack, Rows]]  # by the tasks of the last tick

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
        regularisation: float,
    ) -> None:
        self._scene, robot = scene, scene.robot
        self.cones, self.equations = cones, equations
        self.motion = Motion(scene, equations)
        self.mass = robot.mass
        self._regularisation = regularisation
        self.columns = actuation.columns
        self._motors, self._touching = entries(self.columns), entries(cones.touching)
        self.bounds = AccelerationBounds(robot, limits, self.columns)
        most = torque_limits(robot, self.columns)
        limited = np.flatnonzero(np.isfinite(most)) if limits.torque else np.zeros(0, int)
        self.limited, self.most = limited, most[limited] / self.mass
        self._constraints = TickConstraints(cones, self.bounds, limited, self.most)
        tasks = [task for level in levels for task in level]
        hard = [task for task in tasks if isinf(task.weight)]
        self.hard = Stack(scene, hard, home)
        self.levels = [
            Stack(scene, [task for task in level if task not in hard], home) for level in levels
        ]
        self.inequalities = self._inequality_rows([actuation.motors[i] for i in limited])
        self.rigid = rigid_rows(robot, rigid, self.columns)
        self._rigid_rest = np.zeros(len(self.rigid))
        self._none, self._no_loops = np.zeros((0, 0)), np.zeros((0, robot.nv))
        self._constant: Elimination | None = None
        if not len(cones.held):
            self._constant = Elimination.of(self.rigid, self.columns)
        self._fixed: dict[Stack, tuple[Array, Array]] = {}  # where x has the same meaning always

    def without_swing(self, q: Array, v: Array) -> Array:
        """Return the velocity that is left if joints that are taken for rigid are locked."""
        if not (self.rigid @ v).any() or not isfinite(np.vdot(q, q) + np.vdot(v, v)):
            return v  # what is not finite is refused later
        loops = self._held.consistent_jacobian(q) if self._held else self._no_loops
        return locked(v, self.equations.mass(q), loops, self.rigid)

    @cached_property
    def _held(self) -> Equations | None:
        """The equations of what has no cone: its rows alone are held, and may be redundant."""
        scene, rows = self._scene, self.cones.held
        each = zip(scene.constraints, scene.bounds, strict=True)
        held = [constraint for constraint, bound in each if bound.rows.start in rows]
        if not held:
            return None
        alone = Scene(scene.robot, held)
        return told(Equations(self.equations.model, alone.bounds), alone)

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

    def _left_out(self, gaps: Array) -> LeftOut | None:
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
        """Return the constraints of a tick, and the levels of its tasks.

        They are in the memory of this object: the next tick overwrites them.
        """
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
        """How far redundant contacts are from what they demand (`TickConstraints`)."""
        return self._constraints.unreached

    def _reduced(self) -> Reduction:
        """Return the equations of motion and contacts over z and lam_c / m."""
        terms, held, touching = self.motion.terms, self.cones.held, self._touching
        wanted, E = terms.a_ref - terms.gamma, self._constant
        J_l, r_l = terms.J[held], wanted[held]
        if self.left_out:
            J_l, r_l = self.left_out.kept(J_l), self.left_out.kept(r_l)
        if E is None:
            E = Elimination.of(np.concatenate((J_l, self.rigid)), self.columns)
        r_l = np.concatenate((r_l, self._rigid_rest)) if E.holds else self._rigid_rest
        return reduced(
            terms, terms.h - self.passive, E, r_l, terms.J[touching], wanted[touching], self.mass
        )

    def _rows(self, stack: Stack, t: float) -> Rows:
        """Return the rows of tasks, over x."""
        at = self._at
        if not stack.rows:
            return Rows(self._none, stack.weights)
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
        rows = Rows(G, b)
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
        first, columns = len(self.most), self.bounds.columns
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
        given = at.torque.dot(x)
        given += at.torque_0
        tau[self._motors] = self.mass * given
        if not at.map.holds:
            return a, tau, lam, np.zeros(0)
        left = terms.M @ a + terms.h - self.passive - tau - at.J_c.T @ f
        forces = at.map.forces(left)
        lam[held] = forces[: len(held)]
        return a, tau, lam, forces[len(held) :]

    def errors(self, x: Array) -> dict[str, Array]:
        """Return how far each task of the last tick is from what it wants, by name."""
        found: dict[str, Array] = {}
        for stack, rows in self._asked:
            left = rows.of(x)
            left -= rows.b
            for name, place in stack.tasks.items():
                found[name] = left[place]
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
