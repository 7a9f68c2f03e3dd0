"""The verb push_bound: how hard a robot may be pushed and yet stop without a step, with its motors.

The mass is moved by s along a direction of the floor, at constant height h over it. The pressure is
as far ahead as motors and floor let it be at that posture,

    p(s) = max p   with   M (x a + Y y) + h = B u + J^T lam,    a = omega^2 (s - p),
                          A lam <= 0,    |u| <= u_max,

one linear program a posture. x is the motion of the joints that moves the mass along and nothing
else: J x = 0, no angular momentum about horizontal axes, and of these the least kinetic energy.
Braked like that, the mass comes to rest where the pressure is no longer ahead of it, from

    v^2 = 2 omega^2 int_0^s* (p(s) - s) ds,    p(s*) = s*.

With motors of any strength it is the inverted pendulum of `capturable_speed`, p = min(d, s + mu h).

References
----------
Orsolino, Focchi, Caron, Raiola, Barasuol, Caldwell, Semini. Feasible region: an actuation-aware
extension of the support region. IEEE Transactions on Robotics, 2020.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import normalised
from condyn_pin._core.arrays import Array, finite
from condyn_pin._core.blas_threads import one_blas_thread
from condyn_pin._core.linalg.minimum_norm import factorise
from condyn_pin._core.linalg.numerical_rank import null_space
from condyn_pin._core.names import checked
from condyn_pin.constraints.rows.equations import Equations
from condyn_pin.contact.scene_cones import Cones
from condyn_pin.control.actuation import Actuation, motors_of
from condyn_pin.control.contact_cones import ContactCones
from condyn_pin.control.control_limits import torque_limits
from condyn_pin.control.program import rigid_rows
from condyn_pin.control.support import SupportPlane, check_touching, hull, plane_of, touching_points
from condyn_pin.dynamics.force import Sites, upward
from condyn_pin.dynamics.scene import Scene, check_bilateral, check_scene
from condyn_pin.errors import Infeasible, InvalidArgument
from condyn_pin.mechanism.anchoring import anchored
from condyn_pin.model.soundness import singular_mass

_POSTURES = 20  # on the way to the edge of the support; the speed is right to 0.1 %
_FASTEST = 1e3  # [rad/s^2, m/s^2]: of motions that the mass does not notice, or so they would
_NOTICED = 1e-3  # [m]: what a motor of twice the torque has to give to be said to hold back
_CORRECTIONS = 20  # of a posture by Newton's method


@dataclass(frozen=True, eq=False, repr=False)
class PushBound:
    """The largest push that a robot stands without a step, along one direction.

    Attributes
    ----------
    way : (3,) array
        The direction of the push, along the floor [1].
    travel : (k,) array
        How far the mass has moved along it, to where it comes to rest at last: s [m].
    pressure : (k,) array
        How far ahead of where the mass was the centre of pressure can be then: p [m].
    motors : tuple of str
        The motors that hold the pressure back somewhere on the way, by name.
    height : float
        Of the centre of mass over the floor, h [m].
    mass : float
        Of the robot [kg].
    gravity : float
        Acceleration of gravity [m/s^2].
    """

    way: Array
    travel: Array
    pressure: Array
    motors: tuple[str, ...]
    height: float  # [m]
    mass: float  # [kg]
    gravity: float  # [m/s^2]

    @property
    def speed(self) -> float:
        """The largest speed of the centre of mass from which it stops [m/s]."""
        return self.speed_at(0.0)

    @property
    def impulse(self) -> float:
        """The largest impulse through the centre of mass [N s]."""
        return self.mass * self.speed

    def speed_at(self, s: float) -> float:
        """Return the largest speed from which it stops where its mass has moved by s [m/s]."""
        rest = np.append(s, self.travel[self.travel > s])
        ahead = np.interp(rest, self.travel, self.pressure) - rest
        return float(np.sqrt(2.0 * self.gravity / self.height * max(_area(rest, ahead), 0.0)))

    def __repr__(self) -> str:
        held = f", held back by {', '.join(self.motors)}" if self.motors else ""
        return f"PushBound({self.impulse:.4g} N s through the centre of mass{held})"


@one_blas_thread
def push_bound(
    scene: Scene,
    q: ArrayLike,
    way: ArrayLike,
    *,
    cones: Cones,
    actuation: Actuation | None = None,
    torque: bool = True,
    rigid: Sequence[str] = (),
) -> PushBound:
    """Return the largest push that a robot at rest stands without a step, with its motors.

    v^2 = 2 omega^2 int_0^s* (p(s) - s) ds,    p the farthest pressure that motors and floor allow

    A bound for robots that keep the height of their centre of mass and use no angular momentum: by
    swinging arms and trunk one may stand a little more.

    Parameters
    ----------
    scene : Scene
        With contacts that press on a level floor. They are held where they are at q.
    q : (nq,) array_like
        Where the robot stands [rad, m]; quaternions x y z w.
    way : (3,) array_like
        Direction of the push in the world [1]; what it has across the floor is left out.
    cones : Cone or dict of str to Cone
        Of the floor: one for all contacts that press on it, or one each by name.
    actuation : Actuation, optional
        The motors; those of the robot by default.
    torque : bool
        Whether motors keep to the effort limits of their joints.
    rigid : sequence of str
        Joints without a motor that are taken for rigid, such as stiff springs.

    Returns
    -------
    PushBound

    Raises
    ------
    InvalidArgument
        If nothing presses on a floor, it is not level, there is no gravity, or the centre of mass
        cannot move along the floor while the contacts hold.
    Infeasible
        If motors and floor cannot even hold the robot at rest.
    UnsupportedConstraint
        If contacts may open: `scene.closed()` has those that count.

    Notes
    -----
    Costs 0.1 s: twenty postures and as many linear programs. The velocity products of the way there
    are left out. The way ends where a leg is stretched: contacts that would have to let go there
    are not let go.

    References
    ----------
    Orsolino, Focchi, Caron, Raiola, Barasuol, Caldwell, Semini. Feasible region: an actuation-aware
    extension of the support region. IEEE Transactions on Robotics, 2020. Koolen, de Boer, Rebula,
    Goswami, Pratt. Capturability-based analysis and control of legged locomotion, part 1.
    International Journal of Robotics Research, 2012.
    """
    check_scene(scene)
    check_bilateral(scene)
    if not isinstance(torque, bool):
        raise InvalidArgument(f"torque = {torque!r}: True or False is needed")
    q_ = normalised(scene.robot.unedited, "q", q)
    floor = _level_floor(Sites(scene, q_))
    along = floor.axes[:2].T @ (floor.axes[:2] @ finite("way", way, 3))
    if not np.linalg.norm(along) > 0:
        raise InvalidArgument("way: it is across the floor; a direction along it is needed")
    along /= np.linalg.norm(along)
    brake = _Brake(anchored(scene, q_), q_, floor, along, cones, actuation, torque, rigid)
    travel, pressure, motors = brake.stop(q_)
    return PushBound(along, travel, pressure, motors, brake.height, scene.robot.mass, brake.gravity)


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


class _Brake:
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
        self._equations = Equations(self._model, scene.bounds)
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
            c, J = self._equations.position_level(q)
            A = pin.ccrba(self._model, self._model.createData(), q, self._still) / self._mass
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

        terms = self._equations.terms(at.q, self._still)
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
        return np.array(pin.centerOfMass(self._model, self._model.createData(), q))


def _level_floor(at: Sites) -> SupportPlane:
    """Return the floor under a robot; it has to be level."""
    points, up = touching_points(at), upward(at.scene)
    check_touching(points)
    if not up.any():
        raise InvalidArgument("scene: without gravity nothing stands")
    floor = plane_of(points, up)
    if floor is None or floor.axes[2] @ up < 1.0 - tolerances.COPLANAR:
        raise InvalidArgument("the contacts are not on one level plane: the bound is for one")
    return floor


def _until_rest(s: Array, p: Array) -> tuple[Array, Array]:
    """Return travel and pressure up to where the pressure is no longer ahead."""
    if len(s) == 1 or p[-1] > s[-1]:
        return s, np.maximum(p, s)
    before, after = p[-2] - s[-2], p[-1] - s[-1]
    rest = s[-2] + (s[-1] - s[-2]) * before / (before - after)
    return np.append(s[:-1], rest), np.append(p[:-1], rest)


def _area(x: Array, y: Array) -> float:
    """Return the integral of y over x by trapezia."""
    return float((np.diff(x) * (y[1:] + y[:-1])).sum() / 2.0)
