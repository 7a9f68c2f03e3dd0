"""Braking: how a robot stops its mass along one direction, posture by posture.

At each posture on the way the farthest pressure is one linear program,

    max p   with   M (x a + Y y) + h = B u + J^T lam,    a = omega^2 (s - p),
                   A lam <= 0,    |u| <= u_max,

and x the motion that takes the mass along and nothing else (`push_bound`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import checked
from condyn_pin._core.arrays import Array
from condyn_pin._core.linalg import factorise, null_space
from condyn_pin._core.trees import whole_data
from condyn_pin.constraints.rows.equations import Equations
from condyn_pin.contact.cones import Cones
from condyn_pin.control.actuation import Actuation, motors_of
from condyn_pin.control.contact_cones import ContactCones
from condyn_pin.control.control_limits import torque_limits
from condyn_pin.control.program import rigid_rows
from condyn_pin.control.support import SupportPlane, hull, touching_points
from condyn_pin.dynamics.at_state import told
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.solution import Sites
from condyn_pin.errors import Infeasible, InvalidArgument
from condyn_pin.model.soundness import singular_mass

_POSTURES = 20  # on the way to the edge of the support; the speed is right to 0.1 %
_FASTEST = 1e3  # [rad/s^2, m/s^2]: of motions that the mass does not notice, or so they would
_NOTICED = 1e-3  # [m]: what a motor of twice the torque has to give to be said to hold back
_CORRECTIONS = 20  # of a posture by Newton's method


class _Posture(NamedTuple):
    """Where the mass has moved to, and how the joints move it on.

    Attributes
    ----------
    s : float
        How far it has moved [m].
    q : (nq,) array
    x : (nv,) array
        Of the joints, for one metre of the mass.
    Y : (nv, k) array
        Motions that neither the contacts nor the mass notice.
    """

    s: float
    q: Array
    x: Array
    Y: Array


class _Ahead(NamedTuple):
    """How far ahead the pressure can be [m], and the motors that hold it back."""

    p: float
    motors: set[str]


class Brake:
    """A robot that brakes its mass along one direction as well as it can."""

    def __init__(
        self,
        scene: Scene,
        q: Array,
        floor: SupportPlane,
        way: Array,
        cones: Cones,
        actuation: Actuation | None,
        torque: bool,
        rigid: Sequence[str],
    ) -> None:
        robot = scene.robot
        self._model, self._mass = robot.unedited, robot.mass
        self._still = np.zeros(robot.nv)
        self._way, self._level = way, floor.axes[:2]
        self._actuation = motors_of(scene, actuation)
        self._most = torque_limits(robot, self._actuation.columns) / self._mass
        if not torque:
            self._most[:] = np.inf
        names = checked("rigid", rigid, robot.joints, "joint")
        self._stiff = rigid_rows(robot, names, self._actuation.columns)
        self._cones = ContactCones(scene, cones)
        for contact, bound in zip(scene.constraints, scene.bounds, strict=True):
            if contact.presses and bound.rows.start not in self._cones.touching:
                raise InvalidArgument(f"cones: none for {contact.name}, which then pulls as well")
        self._equations = told(Equations(self._model, scene.bounds), scene)
        self._start = self._center(q)
        points = touching_points(Sites(scene, q))
        self._reach = hull(floor, points).reach(self._start, way)
        self.height = float((self._start - floor.origin) @ floor.axes[2])
        self.gravity = float(np.linalg.norm(self._model.gravity.linear))
        if not self.height > 0:
            raise InvalidArgument("q: the centre of mass is not above the floor")

    def stop(self, q: Array) -> tuple[Array, Array, tuple[str, ...]]:
        """Return travel, pressure, and the motors that hold it back, until the mass is at rest."""
        at: _Posture | None = self._moved(0.0, q)
        if at is None:
            raise InvalidArgument(
                "scene: the centre of mass cannot move along the floor while the contacts hold"
            )
        step = self._reach / _POSTURES
        travel, pressure, holding = [], [], set()
        while at is not None and (ahead := self._farthest(at)) is not None:
            travel.append(at.s)
            pressure.append(ahead.p)
            if ahead.p <= at.s or step <= 0:
                break
            holding |= ahead.motors
            at = self._moved(at.s + step, pin.integrate(self._model, at.q, step * at.x))
        if not travel:
            raise Infeasible("no forces of motors and floor hold the robot at rest at q")
        motors = tuple(name for name in self._actuation.motors if name in holding)
        return *_until_rest(np.array(travel), np.array(pressure)), motors

    def _moved(self, s: float, guess: Array) -> _Posture | None:
        """Return the posture near a guess with the mass moved by s; None if there is none."""
        q, target = guess, self._start + s * self._way
        held = np.zeros(len(self._stiff))
        for _ in range(_CORRECTIONS):
            c, J = self._equations.consistent_position_level(q)
            A = pin.ccrba(self._model, whole_data(self._model), q, self._still) / self._mass
            A = A.reshape(6, -1)  # a single column comes as a vector
            D = np.vstack((J, self._stiff, A[:3], self._level @ A[3:]))
            M, why = self._equations.mass(q), singular_mass(self._model, q)
            factors = factorise(M, D, tolerances.RANK, why=why)
            off = np.concatenate((-c, held, target - self._center(q), (0, 0)))
            if np.abs(off).max() < tolerances.CLOSED:
                wanted = np.concatenate((0.0 * c, held, self._way, (0, 0)))
                x = factors.solve(self._still, wanted)[0]
                moves = np.abs(D @ x - wanted).max() < tolerances.SOLVED
                return _Posture(s, q, x, null_space(D).T) if moves else None
            q = pin.integrate(self._model, q, factors.solve(self._still, off)[0])
        return None

    def _farthest(self, at: _Posture) -> _Ahead | None:
        """Return how far ahead the pressure can be; None if nothing holds the robot."""
        # imported here: scipy.optimize takes as long to import as Pinocchio
        from scipy.optimize import linprog

        terms = self._equations.consistent_terms(at.q, self._still)
        A, J = self._cones.rows(self._equations.data.oMi), terms.J
        M, h = terms.M / self._mass, terms.h / self._mass
        inertia = self.gravity / self.height * (M @ at.x)
        E = np.eye(len(h))[:, self._actuation.columns]
        # unknowns: torques of motors over the mass, p, and what has no limit
        law = np.hstack((E, inertia[:, None], J.T, self._stiff.T, -M @ at.Y))
        sizes = np.abs(law).max(axis=1)  # HiGHS leaves out what is below 1e-9
        first = E.shape[1] + 1
        limits, cost = np.zeros((len(A), law.shape[1])), np.zeros(law.shape[1])
        limits[:, first + self._cones.touching], cost[first - 1] = A, -1.0
        most = np.full(len(cost), np.inf)
        most[: first - 1], most[len(cost) - at.Y.shape[1] :] = self._most, _FASTEST
        found = linprog(
            cost, limits, np.zeros(len(A)), law / sizes[:, None],
            (h + at.s * inertia) / sizes, bounds=np.column_stack((-most, most)), method="highs",
        )  # fmt: skip
        if found.status != 0:
            return None
        gain = np.abs(found.lower.marginals - found.upper.marginals)[: first - 1]
        held = np.flatnonzero(gain * np.where(gain > 0, self._most, 0.0) > _NOTICED)
        return _Ahead(float(found.x[first - 1]), {self._actuation.motors[i] for i in held})

    def _center(self, q: Array) -> Array:
        return np.array(pin.centerOfMass(self._model, whole_data(self._model), q))


def _until_rest(s: Array, p: Array) -> tuple[Array, Array]:
    """Return travel and pressure up to where the pressure is no longer ahead."""
    if len(s) == 1 or p[-1] > s[-1]:
        return s, np.maximum(p, s)
    before, after = p[-2] - s[-2], p[-1] - s[-1]
    rest = s[-2] + (s[-1] - s[-2]) * before / (before - after)
    return np.append(s[:-1], rest), np.append(p[:-1], rest)
