"""Limits of a controller's tick: joints, torques, settings, rigid springs.

ControlLimits: what a controller keeps torques and accelerations within.

A joint that moves at v towards a stop at a distance d can be stopped there if v <= sqrt(2 A d),
with A what it brakes with at most: such a state is viable. An acceleration that is kept for a time
dt, or for any shorter tick, leads to viable states if it does at its end, with w = v + dt a,

    w^2 <= 2 A (d - dt (v + w) / 2),    w >= 0,

or if the joint stops on the way, a <= -v^2 / (2 d). Where A is not known it is infinite: the joint
then brakes as it has to within dt. Velocities keep to |v + dt a| <= v_max.

At a state that is not viable a = -A is the fastest return, or less if it is back within dt.

References
----------
Del Prete. Joint position and velocity bounds in discrete-time acceleration/torque control of robot
arms. IEEE Robotics and Automation Letters, 2018.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from condyn_pin._core import tolerances
from condyn_pin._core.arguments import check_accuracy, check_type, step_size
from condyn_pin._core.arrays import Array, finite
from condyn_pin._core.compiled import Engine, is_compiled
from condyn_pin._core.linalg import factorise_mass, least_change
from condyn_pin._core.models import UNLIMITED
from condyn_pin.constraints.drift import Baumgarte
from condyn_pin.contact.cones import Cones
from condyn_pin.control.actuation import Actuation
from condyn_pin.control.qp.qp_solver import QPSolver
from condyn_pin.control.tasks.task import entry_names
from condyn_pin.errors import InvalidArgument
from condyn_pin.model.joints import Limits
from condyn_pin.model.robot import Robot

# What a joint brakes with at least, as a share of what its motor does without a load: one that its
# load overcomes is held by others.
_WEAKEST: Final = 0.1

# Share of what a motor brakes with that is counted on: it changes on the way to the stop.
_KEPT: Final = 0.9

# How much more than what a motor brakes with is demanded of it and of the other joints together
# before a stop; what needs more is passed.
_TRIED: Final = 1.5

# Share by which a joint may be too fast for its stop: rounding of what is left of its way.
_ROUNDED: Final = 1e-6


@dataclass(frozen=True)
class ControlLimits:
    """Limits of motors and joints, those of the robot's model.

    Parameters
    ----------
    torque : bool
        Whether motors keep to their limits: those of each `CoupledMotor`, and the effort limit of
        every joint for all motors that act on it together. One that is not positive means none, as
        in files.
    dt : float, optional
        How far joints look ahead to keep within position and velocity limits [s]; by default these
        do not count. A control tick or more: joints brake the more gently, the longer it is. They
        stop at their ends, never behind: a state from which none can is told by a notice, and
        answered by the fastest return.
    acceleration : float or (nv,) array_like, optional
        The largest of each joint that has a motor, or of each entry of v [rad/s^2, m/s^2]; infinite
        by default. Joints brake with it before their ends, or with nine tenths of what their motor
        does if all others stand still, whichever is less.

    Raises
    ------
    InvalidArgument
        If dt or an acceleration is not positive.
    """

    torque: bool = True
    dt: float | None = None  # [s]
    acceleration: ArrayLike | None = None  # [rad/s^2, m/s^2]

    def __post_init__(self) -> None:
        if not isinstance(self.torque, bool):
            raise InvalidArgument(
                f"torque = {self.torque!r}: True or False is needed; limits in N m are those of "
                "the robot: model = robot.model.copy(), model.effortLimit[:] = 5.0, and "
                "dataclasses.replace(robot, model=model)"
            )
        if self.dt is not None:
            step_size(self.dt)
        if self.acceleration is not None:
            most = finite("acceleration", self.acceleration, np.shape(self.acceleration))
            if most.size and most.min() <= 0:
                raise InvalidArgument(f"acceleration: {most.min():g} is not positive")
            kept = tuple(most.tolist()) if most.ndim else float(most)
            object.__setattr__(self, "acceleration", kept)


class AccelerationBounds:
    """Limits of joints at work on one robot: bounds of the accelerations of some of them.

    columns (k,): entries of v that have a bound
    names: of the joints, one an entry
    most, speed (nv,): the largest acceleration and velocity of all entries of v; infinite where
        there is none
    against: the largest torque of motors against motion upwards (1) and downwards (-1) [N m, N];
        infinite where there is none
    dt: how far joints look ahead [s]
    joints: joints with limits of their positions
    reach: those limits, the upper and the lower ones
    """

    def __init__(self, limits: ControlLimits, actuation: Actuation) -> None:
        robot = actuation.robot
        if limits.dt is not None:
            _check_ranges(robot)
        model, nv = robot.unedited, robot.nv
        self.dt = limits.dt
        self.most = np.full(nv, np.inf)
        if limits.acceleration is not None:
            where = actuation.columns if np.ndim(limits.acceleration) == 0 else np.arange(nv)
            shape = np.shape(limits.acceleration) or ()
            if shape not in ((), (nv,)):
                raise InvalidArgument(
                    f"acceleration has shape {shape}: one number, or an array of shape ({nv},)"
                )
            self.most[where] = limits.acceleration
        speed = np.array(model.velocityLimit, dtype=float)
        self.speed = np.where((speed > 0) & (speed < UNLIMITED), speed, np.inf)
        self.against = {side: np.full(nv, np.inf) for side in (1.0, -1.0)}
        if limits.torque:
            self.against = {side: _largest_torque(actuation, -side) for side in self.against}
        self.joints = Limits.of(model)
        self.reach = _or_infinite(self.joints.upper), _or_infinite(self.joints.lower)
        bounded = np.isfinite(self.most)
        if limits.dt is not None:
            bounded |= np.isfinite(self.speed)
            bounded[self.joints.iv] = True
        self.columns = np.flatnonzero(bounded)
        self.names = entry_names(model, self.columns)

    def at(self, q: Array, v: Array, inertia: Array, load: Array) -> tuple[Array, Array]:
        """Bounds (k,) of the accelerations at a state; infinite where there is none."""
        # `inertia` (nv,) is what each entry of v feels if the others stand still, the diagonal of
        # M, and `load` (nv,) what motors have to give for a = 0, h - passive [N m, N].
        if self.dt is None:
            return -self.most[self.columns], self.most[self.columns]
        joints, (highest, lowest) = self.joints, self.reach
        upper = self._towards(1.0, v, inertia, load, self.dt)
        lower = self._towards(-1.0, v, inertia, load, self.dt)
        iv, x, speed = joints.iv, q[joints.iq], v[joints.iv]
        for bound, d, sign in ((upper, highest - x, 1.0), (lower, x - lowest, -1.0)):
            brake = self.braking(sign, inertia, load)[iv]
            kept = np.minimum(self.most[iv], _KEPT * brake)
            found = stopping(d, sign * speed, kept, brake, self.dt)
            bound[iv] = np.minimum(bound[iv], np.maximum(found, -self.most[iv]))
        lower = -lower
        # between two stops so near that neither lookahead fits: the one ahead comes first
        np.minimum(lower, upper, out=lower, where=v >= 0)
        np.maximum(lower, upper, out=upper, where=v < 0)
        return lower[self.columns], upper[self.columns]

    def braking(self, side: float, inertia: Array, load: Array) -> Array:
        """Largest deceleration of each joint as it moves upwards (1) or downwards (-1) (nv,)."""
        effort, other = self.against[side], self.against[-side]
        alone = np.maximum(effort + side * load, _WEAKEST * np.maximum(effort, other)) / inertia
        return np.asarray(np.minimum(self.most, alone))

    def _towards(self, side: float, v: Array, inertia: Array, load: Array, dt: float) -> Array:
        """Largest accelerations to one side (nv,) within those of velocities that are v."""
        fastest = np.maximum((self.speed - side * v) / dt, -self.braking(side, inertia, load))
        return np.asarray(np.minimum(self.most, fastest))

    def unviable(self, q: Array, v: Array, inertia: Array, load: Array) -> tuple[str, ...]:
        """Sentences on joints that are beyond a limit, or come to it too fast to be stopped."""
        if self.dt is None:
            return ()
        joints, said = self.joints, []
        x, speed = q[joints.iq], v[joints.iv]
        sides = (("upper", 1.0, joints.upper), ("lower", -1.0, joints.lower))
        for side, sign, limit in sides:
            brake = self.braking(sign, inertia, load)[joints.iv]
            for i in np.flatnonzero(_is_lost(sign * (limit - x), sign * speed, brake)).tolist():
                unit = "m" if joints.length[i] else "rad"
                where = f"{joints.joints[i]} is at {x[i]:.6g} {unit} and {speed[i]:.3g} {unit}/s"
                end = f"its {side} limit {limit[i]:.6g} {unit}"
                if sign * (limit[i] - x[i]) < 0:
                    said.append(f"{where}, beyond {end}: it returns as fast as it may")
                else:
                    said.append(
                        f"{where}, too fast for {end}: the {brake[i]:.3g} {unit}/s^2 that it "
                        "brakes with here do not stop it before that"
                    )
        for i in np.flatnonzero(np.abs(v) > (1 + tolerances.SOLVED) * self.speed).tolist():
            name = self.names[int(np.flatnonzero(self.columns == i)[0])]
            limit_ = f"its limit of velocity {self.speed[i]:.6g}"
            said.append(f"{name} moves at {v[i]:.6g} rad/s or m/s, beyond {limit_}: it is braked")
        return tuple(said)


def stopping(d: Array, v: Array, brake: Array, most: Array, dt: float) -> Array:
    """Largest accelerations (k,) from which a stop ahead is not passed, kept for dt [s] or less."""
    # d (k,) are distances to the stop, negative beyond it, and v the velocities towards it; `brake`
    # is counted on to stop the joint, `most` returns it where it can no longer be stopped
    # [rad/s^2].
    far = np.minimum(2.0 * d - dt * v, UNLIMITED)  # what w has, to brake and for its way within dt
    w = 2.0 * far / (dt + np.sqrt(dt**2 + 4.0 * np.maximum(far, 0.0) / brake))
    ahead = np.maximum((w - v) / dt, -most)
    on_the_way = -(v**2) / (2.0 * np.where(d > 0, d, np.inf))
    on_the_way = np.where(on_the_way < -_TRIED * most, -most, on_the_way)
    found = np.where((far >= 0) | (d <= 0), ahead, on_the_way)
    return np.where(d < UNLIMITED, found, np.inf)


def _is_lost(d: Array, v: Array, brake: Array) -> NDArray[np.bool_]:
    """True for joints beyond a stop, or too fast to be stopped before it (k,)."""
    way = np.maximum(v, 0.0) ** 2 / (2.0 * brake)
    return np.asarray((d < -tolerances.CLOSED) | (way > (1 + _ROUNDED) * d + tolerances.CLOSED))


class TorqueLimits(NamedTuple):
    """Limits of the torques t = gears u of motors, least <= L t <= most."""

    # of the joints on which motors act, then of motors on several joints, if they have a limit
    names: tuple[str, ...]
    L: Array  # (l, k)
    # least, most (l,): [N m, N]
    least: Array
    most: Array

    @classmethod
    def of(cls, actuation: Actuation, *, count: bool = True) -> TorqueLimits:
        """Return the limits of joints and motors; none where they do not count."""
        model, (least, most) = actuation.robot.model, actuation.limits
        of_motors = np.diag(1.0 / actuation.gears)
        efforts, joints = _efforts(actuation.robot), actuation.columns
        joints = joints[np.isfinite(efforts[joints]) & count]
        motors = np.flatnonzero((np.isfinite(least) | np.isfinite(most)) & count)
        return cls(
            (*entry_names(model, joints), *(actuation.motors[k] for k in motors)),
            np.vstack((actuation.E[joints], of_motors[motors])),
            np.concatenate((-efforts[joints], least[motors])),
            np.concatenate((efforts[joints], most[motors])),
        )


def _efforts(robot: Robot) -> Array:
    """Largest torque on each entry of v (nv,) [N m, N]; infinite for none."""
    most = np.array(robot.unedited.effortLimit, dtype=float)
    return np.where((most > 0) & (most < UNLIMITED), most, np.inf)


def _largest_torque(actuation: Actuation, side: float) -> Array:
    """Largest torque of the motors upwards (1) or downwards (-1) on each entry of v (nv,)."""
    # Infinite where none acts.
    B, (least, most) = side * actuation.B, actuation.limits
    with np.errstate(invalid="ignore"):  # of zero times infinity
        found = np.where(B == 0.0, 0.0, np.maximum(B * least, B * most)).sum(axis=1)
    found[~B.any(axis=1)] = np.inf
    found[actuation.columns] = np.minimum(found, _efforts(actuation.robot))[actuation.columns]
    return np.asarray(found)


def _check_ranges(robot: Robot) -> None:
    """Refuse joints whose lower limit is above the upper one: no position is within."""
    model = robot.unedited
    for name, joint in zip(list(model.names)[1:], list(model.joints)[1:], strict=True):
        for i in range(joint.idx_q, joint.idx_q + joint.nq):
            lower, upper = model.lowerPositionLimit[i], model.upperPositionLimit[i]
            if lower > upper:
                raise InvalidArgument(
                    f"limits: {name} has positions from {lower:g} to {upper:g}: the lower limit is "
                    "above the upper one"
                )


def _or_infinite(limit: Array) -> Array:
    return np.where(np.abs(limit) < UNLIMITED, limit, np.copysign(np.inf, limit))


# Settings: what stays of a controller when its contacts and tasks are switched.


@dataclass(frozen=True)
class ControllerSettings:
    """Arguments of a `Controller` but for scene and tasks; each is as its docstring says."""

    cones: Cones
    qp: QPSolver | None
    limits: ControlLimits
    actuation: Actuation | None
    drift: Baumgarte | None
    regularisation: float
    rigid: tuple[str, ...]
    engine: Engine

    def __post_init__(self) -> None:
        check_accuracy("regularisation", self.regularisation)
        if self.regularisation == 0:
            raise InvalidArgument("regularisation = 0: the program may then have many solutions")
        object.__setattr__(self, "regularisation", float(self.regularisation))
        if self.qp is not None and not isinstance(self.qp, QPSolver):
            raise InvalidArgument(f"qp = {self.qp!r}: a solver such as ProxQP() is needed")
        check_type("limits", self.limits, ControlLimits, "ControlLimits(...) is needed")
        check_type(
            "drift", self.drift, Baumgarte | None, "Baumgarte(alpha, beta) or None is needed"
        )
        is_compiled(self.engine)  # raises unless it is one


# Swing: of springs that a controller takes for rigid, and does not answer.
#
# A mass m_1 with a motor, a spring, and a mass m_2, whose place is to decay as x'' + 2 alpha x' +
# beta^2 x = 0. What a rigid spring asks for, u = -(m_1 + m_2) (2 alpha x_2' + beta^2 x_2), gives
#
#     p^4 + Omega^2 (p^2 + 2 alpha p + beta^2) = 0,    Omega^2 = k (m_1 + m_2) / (m_1 m_2).
#
# The sum of the roots is zero: what the place decays with, the spring swings up with. A foot in the
# air rattles on its spring until it comes down where it did not stand. With the velocity that the
# robot would have if its springs were locked at once, which keeps its momentum,
#
#     min (w - v)^T M (w - v)    with    J_l w = J_l v,    w = 0 of what is rigid,
#
# here (m_1 x_1' + m_2 x_2') / (m_1 + m_2), it is
#
#     p^4 + 2 alpha p^3 + Omega^2 (p^2 + 2 alpha p + beta^2) = 0,
#
# and the swing grows with alpha (beta / Omega)^2 only: little beside what springs lose.


def locked_velocity(v: Array, M: Array, J: Array, rigid: Array) -> Array:
    """Velocity (nv,) after joints were locked at once; rows J (m, nv) keep theirs."""
    # `rigid` has a row of the identity for each of the joints.
    rows = np.vstack((J, rigid))
    change = np.concatenate((np.zeros(len(J)), -(rigid @ v)))
    # what is added is the same for all that keep the rows: springs may carry links without mass
    mass = factorise_mass(M + M.diagonal().mean() * (rows.T @ rows))
    return np.asarray(v + least_change(mass, rows, change, tolerances.RANK))
