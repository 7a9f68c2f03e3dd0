"""Balance: ZMP, capture point, divergent component, and the pushes that a robot can take.

Balance: where a robot presses on the floor, and where it is about to fall.

With m cddot = f + m g and L the angular momentum about the centre of mass c, the contacts exert

    f = m (cddot - g),    n_O = Ldot + c x f          about the origin of the world.

On one plane with normal e through a point p of it, the moment M_p = n_O - p x f leaves

    ZMP = p + e x M_p / (f . e),    a moment along e alone,

which is where the pressure of all contacts has its centre, as long as none pulls. On a plane
below c, at a distance h,

    omega = sqrt(g / h),    DCM = c + cdot / omega,    capture point = its foot on the plane:

where the linear inverted pendulum of constant h comes to rest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf, isfinite, sqrt
from numbers import Real
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import Arguments, check_type, checked_names
from condyn_pin._core.arrays import Array, check_overflow, finite
from condyn_pin._core.linalg import factorise, null_space
from condyn_pin._core.models import whole_data
from condyn_pin._core.threads import one_blas_thread
from condyn_pin.constraints.constraint import check_positive
from condyn_pin.constraints.rows.equations import Equations
from condyn_pin.contact.cones import Cones
from condyn_pin.control.actuation import Actuation, motors_of
from condyn_pin.control.cones import pyramids, wrench_margin
from condyn_pin.control.limits import TorqueLimits
from condyn_pin.control.program import rigid_rows
from condyn_pin.control.support import (
    Pressure,
    SupportPlane,
    SupportPolygon,
    along_plane,
    check_touching,
    floor_pressure,
    hull,
    level_floor,
    margin_within,
    plane_of,
    touching_points,
)
from condyn_pin.dynamics.at_state import with_redundancy
from condyn_pin.dynamics.scene import Scene, check_bilateral, check_not_driven, check_scene
from condyn_pin.dynamics.solution import Sites, upward
from condyn_pin.errors import Infeasible, InvalidArgument
from condyn_pin.mechanism.closing import anchored
from condyn_pin.model.soundness import singular_mass


@dataclass(frozen=True, eq=False, repr=False)
class Balance:
    """Centre of mass, centre of pressure and capture point of a robot, in the axes of the world.

    Quantities that are not defined are NaN: `zmp`, `cop`, `capture_point`, `dcm` and both margins
    if the contacts do not lie in one plane; `zmp` and its margin in the air, where nothing presses;
    the centre of pressure of a contact that carries no load.

    Attributes
    ----------
    com, com_velocity, com_acceleration : (3,) array
        Centre of mass [m], and how it moves [m/s, m/s^2].
    force, moment : (3,) array
        What the motion needs from outside beside gravity, f and n_O [N, N m], about the origin of
        the world.
    missing : (6,) array
        What of these the contacts do not exert [N, N m]: what else acts on the robot. Zero for
        forces that belong to a, where nothing does.
    zmp : (3,) array
        Zero-moment point, from q, v and a alone [m]; on one plane only.
    cop : (3,) array
        Centre of pressure of all contacts, from their forces alone [m]; on one plane only.
    cops : dict of str to (3,) array
        Centre of pressure of each contact by name [m]; valid on any ground.
    dcm : (3,) array
        Divergent component of motion, c + cdot / omega [m]; as long as the height stays.
    capture_point : (3,) array
        Its foot on the plane [m].
    polygon : SupportPolygon or None
        The hull of the contacts, where they are on one plane.
    zmp_margin, capture_margin : float
        How far either point is within the polygon [m]; negative outside.
    wrench_margin : float
        With cones: the largest margin to the cones that forces with this wrench can have [N];
        negative if none has one, and valid on any ground. NaN without cones.
    """

    com: Array
    com_velocity: Array
    com_acceleration: Array
    force: Array
    moment: Array
    missing: Array
    zmp: Array
    cop: Array
    cops: dict[str, Array]
    dcm: Array
    capture_point: Array
    polygon: SupportPolygon | None
    zmp_margin: float  # [m]
    capture_margin: float  # [m]
    wrench_margin: float  # [N]

    def __repr__(self) -> str:
        ground = "one plane" if self.polygon else "uneven ground"
        return (
            f"Balance(on {ground}: ZMP {self.zmp_margin:.4g} m and capture point "
            f"{self.capture_margin:.4g} m within the support)"
        )


def balance(
    scene: Scene,
    q: ArrayLike,
    v: ArrayLike,
    a: ArrayLike,
    lam: ArrayLike,
    *,
    cones: Cones | None = None,
) -> Balance:
    """Return centre of pressure, capture point and stability margins of a robot on the floor.

    zmp = p + e x M_p / (f . e),    dcm = c + cdot / omega,    omega = sqrt(g / h)

    with e the normal of the plane of the contacts, p a point of it, f and M_p what they exert.

    Parameters
    ----------
    scene : Scene
        With contacts that press on a floor.
    q, v, a : (nq,), (nv,), (nv,) array_like
        Configuration, velocity [rad/s, m/s] and acceleration [rad/s^2, m/s^2].
    lam : (m,) array_like
        Constraint forces that belong to a, such as those of a `Solution` or a `ControlAnswer`.
    cones : Cone or dict of str to Cone, optional
        To know how far the wrench is within the contact wrench cone.

    Returns
    -------
    Balance

    Raises
    ------
    InvalidArgument
        If an argument has a wrong size, is not finite or so large that forces overflow, nothing
        presses on a floor, or a contact does not say its size.
    UnsupportedConstraint
        If contacts may open: `scene.closed()` has those that count, `motion_balance` is for a run.

    Notes
    -----
    Costs half a millisecond, and with cones two more for a linear program.

    References
    ----------
    Sardain, Bessonnet. Forces acting on a biped robot: center of pressure, zero moment point. IEEE
    Transactions on Systems, Man, and Cybernetics, 2004. Pratt, Carff, Drakunov, Goswami. Capture
    point: a step toward humanoid push recovery. Humanoids, 2006.
    """
    check_scene(scene)
    check_bilateral(scene)
    model = scene.robot.unedited
    q_, v_, _ = Arguments(model).check(q, v, np.zeros(scene.robot.nv))
    a_ = finite("a", a, scene.robot.nv)
    forces = finite("lam", lam, scene.rows)
    at = Sites(scene, q_)
    with np.errstate(all="ignore"):  # what overflows is refused
        pressure = floor_pressure(at, forces)
        check_touching(pressure.points)
        found = balanced(scene, q_, v_, a_, pressure)
        check_overflow("v", v_, found.com_velocity, found.com_velocity**2)
        check_overflow("a", a_, found.force, found.moment)
        check_overflow("lam", forces, found.missing)
    if cones is None:
        return found
    return replace(found, wrench_margin=wrench_margin(at, cones, found.force, found.moment))


def balanced(scene: Scene, q: Array, v: Array, a: Array, pressure: Pressure) -> Balance:
    """Return the balance of a robot that moves with a and presses on a floor as is said."""
    model = scene.robot.unedited
    data = whole_data(model)
    rate = pin.computeCentroidalMomentumTimeVariation(model, data, q, v, a)
    c, velocity = np.array(data.com[0]), np.array(data.vcom[0])
    gravity = np.array(model.gravity.linear)
    f = np.array(rate.linear) - scene.robot.mass * gravity
    n = np.array(rate.angular) + np.cross(c, f)
    points = pressure.points
    plane = plane_of(points, upward(scene)) if len(points) else None
    zmp = cop = dcm = foot = np.full(3, np.nan)
    polygon = None
    if plane is not None:
        polygon = hull(plane, points)
        size = scene.robot.mass * float(np.linalg.norm(gravity)) + float(
            np.linalg.norm(rate.linear)
        )
        zmp = _zero_moment_point(plane, f, n, tolerances.SOLVED * size)
        cop = _middle(plane, pressure.cops, pressure.forces)
        dcm, foot = _captured(plane, c, velocity, float(np.linalg.norm(gravity)))
    return Balance(
        com=c,
        com_velocity=velocity,
        com_acceleration=np.array(rate.linear) / scene.robot.mass,
        force=f,
        moment=n,
        missing=np.concatenate((f, n)) - pressure.exerted,
        zmp=zmp,
        cop=cop,
        cops=pressure.cops,
        dcm=dcm,
        capture_point=foot,
        polygon=polygon,
        zmp_margin=margin_within(polygon, zmp),
        capture_margin=margin_within(polygon, foot),
        wrench_margin=np.nan,
    )


def _middle(plane: SupportPlane, cops: dict[str, Array], pressing: dict[str, Array]) -> Array:
    """Return the centre of pressure of all contacts on one plane."""
    loads = {name: float(f @ plane.axes[2]) for name, f in pressing.items()}
    whole = sum(loads.values())
    if not whole > 0:
        return np.full(3, np.nan)
    return np.asarray(sum(load * cops[name] for name, load in loads.items()) / whole)


def _zero_moment_point(plane: SupportPlane, f: Array, n: Array, noise: float) -> Array:
    """Return the point of the plane about which f and n leave a moment along the normal alone."""
    # NaN where the load is no more than `noise` [N]: in the air it is what rounding leaves.
    p, normal = plane.origin, plane.axes[2]
    load = float(f @ normal)
    if not load > noise:
        return np.full(3, np.nan)
    return np.asarray(p + np.cross(normal, n - np.cross(p, f)) / load)


def _captured(plane: SupportPlane, c: Array, velocity: Array, g: float) -> tuple[Array, Array]:
    """Return the divergent component of motion, and its foot on the plane."""
    normal = plane.axes[2]
    height = float((c - plane.origin) @ normal)
    if not (height > 0 and g > 0):
        return np.full(3, np.nan), np.full(3, np.nan)
    dcm = c + velocity / np.sqrt(g / height)
    return dcm, dcm - normal * float((dcm - plane.origin) @ normal)


# Capturability: how fast a robot may move towards an edge and yet stop without a step.
#
# The linear inverted pendulum of constant height h, whose pressure p is no further than the edge,
# at a distance d ahead of c, and whose force leans no more than friction lets it,
#
#     cddot = omega^2 (c - p),    omega = sqrt(g / h),    p <= c + d,    |p - c| <= mu h,
#
# brakes best with p as far ahead as it may be, and comes to rest at the edge from
#
#     v = omega d                         where d <= mu h: the capture point is at the edge,
#     v = sqrt(mu g (2 d - mu h))         beyond: it brakes by mu g until the edge is at mu h.


def capturable_speed(
    reach: float, height: float, *, friction: float = inf, gravity: float = tolerances.GRAVITY
) -> float:
    """Return the largest speed from which an inverted pendulum stops without a step [m/s].

    v = omega d,    or sqrt(mu g (2 d - mu h)) where d > mu h

    An impulse of m v through the centre of mass is the largest that a robot at rest can withstand
    at constant height and without angular momentum; by swinging arms and trunk it may withstand a
    little more.

    Parameters
    ----------
    reach : float
        From the centre of mass to the edge of its support, along the motion: d [m]. None is left
        where it is negative.
    height : float
        Of the centre of mass over the floor, h [m].
    friction : float
        Of the floor, mu [1]; infinite by default.
    gravity : float
        Acceleration of gravity [m/s^2].

    Returns
    -------
    float
        The speed [m/s]; zero where nothing is left to reach, or without friction.

    Raises
    ------
    InvalidArgument
        If the height or gravity is not positive, or friction is negative.

    References
    ----------
    Koolen, de Boer, Rebula, Goswami, Pratt. Capturability-based analysis and control of legged
    locomotion, part 1. International Journal of Robotics Research, 2012.
    """
    check_positive("length [m]", height=height)
    check_positive("acceleration [m/s^2]", gravity=gravity)
    d = max(float(finite("reach", reach, ())), 0.0)
    if isinstance(friction, bool) or not isinstance(friction, Real) or not friction >= 0:
        raise InvalidArgument(f"friction = {friction!r}: a number >= 0 is needed")
    leans = friction * height
    speed = sqrt(gravity / height) * d if d <= leans else sqrt(friction * gravity * (2 * d - leans))
    if not isfinite(speed):
        raise InvalidArgument(f"reach = {reach!r}: the speed overflows; a smaller one is needed")
    return speed


# Braking: how a robot stops its mass along one direction, posture by posture.
#
# At each posture on the way the farthest pressure is one linear program,
#
#     max p   with   M (x a + Y y) + h = B u + J^T lam,    a = omega^2 (s - p),
#                    A lam <= 0,    |u| <= u_max,
#
# and x the motion that takes the mass along and nothing else (`push_bound`).


_POSTURES = 20  # on the way to the edge of the support; the speed is right to 0.1 %
_FASTEST = 1e3  # [rad/s^2, m/s^2]: of motions that the mass does not notice, or so they would
_NOTICED = 1e-3  # [m]: what a motor of twice the torque has to give to be said to hold back
_CORRECTIONS = 20  # of a posture by Newton's method


class _Posture(NamedTuple):
    """Posture with the mass moved along, and the joint motion that moves it on."""

    s: float  # how far it has moved [m]
    q: Array  # (nq,)
    x: Array  # (nv,) of the joints, for one metre of the mass
    Y: Array  # (nv, k) motions that neither the contacts nor the mass notice


class _PressureAhead(NamedTuple):
    """Farthest pressure ahead [m], and the motors that hold it back."""

    p: float
    motors: set[str]


class BrakingRobot:
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
        self._limits = TorqueLimits.of(self._actuation, count=torque)
        names = checked_names("rigid", rigid, robot.joints, "joint")
        self._stiff = rigid_rows(robot, names, self._actuation.columns)
        self._cones = pyramids(scene, cones)
        for contact, bound in zip(scene.constraints, scene.bounds, strict=True):
            if contact.presses and bound.rows.start not in self._cones.touching:
                raise InvalidArgument(f"cones: none for {contact.name}, which then pulls as well")
        self._equations = with_redundancy(Equations(self._model, scene.bounds), scene)
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
        motors = tuple(name for name in self._limits.names if name in holding)
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

    def _farthest(self, at: _Posture) -> _PressureAhead | None:
        """Return the farthest pressure ahead; None if nothing holds the robot."""
        # imported here: scipy.optimize takes as long to import as Pinocchio
        from scipy.optimize import linprog

        terms = self._equations.consistent_terms(at.q, self._still)
        A, J = self._cones.rows(self._equations.data.oMi), terms.J
        M, h = terms.M / self._mass, terms.h / self._mass
        inertia = self.gravity / self.height * (M @ at.x)
        E, L = self._actuation.E, self._limits.L
        most = np.concatenate((self._limits.most, -self._limits.least)) / self._mass
        ends = np.flatnonzero(np.isfinite(most))
        # unknowns: torques of motors over the mass, p, and what has no limit
        law = np.hstack((E, inertia[:, None], J.T, self._stiff.T, -M @ at.Y))
        sizes = np.abs(law).max(axis=1)  # HiGHS leaves out what is below 1e-9
        first = E.shape[1] + 1
        limits, cost = np.zeros((len(A) + len(ends), law.shape[1])), np.zeros(law.shape[1])
        limits[: len(A), first + self._cones.touching], cost[first - 1] = A, -1.0
        limits[len(A) :, : first - 1] = np.vstack((L, -L))[ends]
        fastest = np.full(len(cost), np.inf)
        fastest[len(cost) - at.Y.shape[1] :] = _FASTEST
        found = linprog(
            cost, limits, np.concatenate((np.zeros(len(A)), most[ends])), law / sizes[:, None],
            (h + at.s * inertia) / sizes, bounds=np.column_stack((-fastest, fastest)),
            method="highs",
        )  # fmt: skip
        if found.status != 0:
            return None
        gain = np.abs(found.ineqlin.marginals[len(A) :]) * np.abs(most[ends])
        held = ends[gain > _NOTICED] % len(L)
        return _PressureAhead(float(found.x[first - 1]), {self._limits.names[i] for i in held})

    def _center(self, q: Array) -> Array:
        return np.array(pin.centerOfMass(self._model, whole_data(self._model), q))


def _until_rest(s: Array, p: Array) -> tuple[Array, Array]:
    """Return travel and pressure up to where the pressure is no longer ahead."""
    if len(s) == 1 or p[-1] > s[-1]:
        return s, np.maximum(p, s)
    before, after = p[-2] - s[-2], p[-1] - s[-1]
    rest = s[-2] + (s[-1] - s[-2]) * before / (before - after)
    return np.append(s[:-1], rest), np.append(p[:-1], rest)


# The verb push_bound: how hard a robot may be pushed and yet stop without a step, with its motors.
#
# The mass is moved by s along a direction of the floor, at constant height h over it. The pressure
# is as far ahead as motors and floor let it be at that posture,
#
#     p(s) = max p   with   M (x a + Y y) + h = B u + J^T lam,    a = omega^2 (s - p),
#                           A lam <= 0,    |u| <= u_max,
#
# one linear program a posture. x is the motion of the joints that moves the mass along and nothing
# else: J x = 0, no angular momentum about horizontal axes, and of these the least kinetic energy.
# Braked like that, the mass comes to rest where the pressure is no longer ahead of it, from
#
#     v^2 = 2 omega^2 int_0^s* (p(s) - s) ds,    p(s*) = s*.
#
# With motors of any strength it is the inverted pendulum of `capturable_speed`, p = min(d, s + mu
# h).
#
# References
# ----------
# Orsolino, Focchi, Caron, Raiola, Barasuol, Caldwell, Semini. Feasible region: an actuation-aware
# extension of the support region. IEEE Transactions on Robotics, 2020.


@dataclass(frozen=True, eq=False, repr=False)
class PushBound:
    """The largest push that a robot stands without a step, along one direction.

    v^2 = 2 omega^2 int_0^s* (p(s) - s) ds,    omega^2 = gravity / height

    Attributes
    ----------
    way : (3,) array
        The direction of the push, along the floor [1].
    travel : (k,) array
        How far the mass has moved along it, to where it comes to rest at last: s [m].
    pressure : (k,) array
        How far ahead of where the mass was the centre of pressure can be then: p [m].
    motors : tuple of str
        The motors that hold the pressure back somewhere on the way, by name; the joint where the
        limit is that of a joint on which several act.
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
        """Return the largest speed from which it stops where its mass has moved by s [m/s].

        Parameters
        ----------
        s : float
            Along the way, from where it was at rest [m]; zero beyond its end.

        Raises
        ------
        InvalidArgument
            If s is negative: postures on that side have another bound.
        """
        s = float(finite("s", s, ()))
        if s < 0:
            raise InvalidArgument(f"s = {s:g} m: behind the start; the way back has its own bound")
        rest = np.append(s, self.travel[self.travel > s])
        ahead = np.interp(rest, self.travel, self.pressure) - rest
        area = float((np.diff(rest) * (ahead[1:] + ahead[:-1])).sum() / 2.0)  # by trapezia
        return float(np.sqrt(2.0 * self.gravity / self.height * max(area, 0.0)))

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
        If contacts may open: `scene.closed()` has those that count. If constraints are driven.

    Notes
    -----
    Costs 0.1 s: twenty postures and as many linear programs. Velocity products along the way are
    neglected. It ends where a leg is stretched: contacts hold even if they would have to open
    there. Springs in `rigid` may throw a lightly loaded foot off the floor; the bound holds if it
    lands where it stood.

    References
    ----------
    Orsolino, Focchi, Caron, Raiola, Barasuol, Caldwell, Semini. Feasible region: an actuation-aware
    extension of the support region. IEEE Transactions on Robotics, 2020. Koolen, de Boer, Rebula,
    Goswami, Pratt. Capturability-based analysis and control of legged locomotion, part 1.
    International Journal of Robotics Research, 2012.
    """
    check_scene(scene)
    check_bilateral(scene)
    check_not_driven(scene, "push_bound")
    check_type("torque", torque, bool, "True or False is needed")
    q_ = scene.robot.arguments.configuration("q", q)
    floor = level_floor(Sites(scene, q_))
    along = floor.axes[:2].T @ along_plane(floor.axes[:2], way)
    brake = BrakingRobot(
        scene=anchored(scene, q_),
        q=q_,
        floor=floor,
        way=along,
        cones=cones,
        actuation=actuation,
        torque=torque,
        rigid=rigid,
    )
    travel, pressure, motors = brake.stop(q_)
    return PushBound(along, travel, pressure, motors, brake.height, scene.robot.mass, brake.gravity)
