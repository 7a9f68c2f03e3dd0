"""ControlLimits: what a controller keeps torques and accelerations within.

A joint that is at q and moves at v stays within its limits for a time dt if

    v_lower <= v + dt a <= v_upper,    q_lower <= q + dt v + dt^2 a / 2 <= q_upper.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from condyn_pin._core.arrays import Array, finite
from condyn_pin._core.joints import UNLIMITED
from condyn_pin.constraints.constraint_fields import check_positive
from condyn_pin.control.motion import entry_names
from condyn_pin.errors import InvalidArgument
from condyn_pin.model.limits import Limits
from condyn_pin.model.robot import Robot


@dataclass(frozen=True)
class ControlLimits:
    """Limits of motors and joints, those of the robot's model.

    Parameters
    ----------
    torque : bool
        Whether motors keep to the effort limits of their joints; one that is not positive means
        none, as in files.
    dt : float, optional
        How far joints look ahead to keep within position and velocity limits [s]; by default these
        do not count. Several control ticks: over a single one a joint would have to stop at once.
    acceleration : float or (nv,) array_like, optional
        The largest of each joint that has a motor, or of each entry of v [rad/s^2, m/s^2]; infinite
        by default.

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
            check_positive("time [s]", dt=self.dt)
        if self.acceleration is not None:
            most = finite("acceleration", self.acceleration, np.shape(self.acceleration))
            if most.size and most.min() <= 0:
                raise InvalidArgument(f"acceleration: {most.min():g} is not positive")
            kept = tuple(most.tolist()) if most.ndim else float(most)
            object.__setattr__(self, "acceleration", kept)


class AccelerationBounds:
    """Limits of joints at work on one robot: bounds of the accelerations of some of them.

    Attributes
    ----------
    columns : (k,) int array
        Entries of v that have a bound.
    names : tuple of str
        Of the joints, one an entry.
    most, speed : (nv,) array
        The largest acceleration and velocity of all entries of v; infinite where there is none.
    dt : float or None
        How far joints look ahead [s].
    joints : Limits
        Joints with limits of their positions.
    reach : tuple of (j,) array
        Those limits, the upper and the lower ones.
    """

    def __init__(self, robot: Robot, limits: ControlLimits, motors: NDArray[np.int_]) -> None:
        if limits.dt is not None:
            _check_ranges(robot)
        model, nv = robot.unedited, robot.nv
        self.dt = limits.dt
        self.most = np.full(nv, np.inf)
        if limits.acceleration is not None:
            where = motors if np.ndim(limits.acceleration) == 0 else np.arange(nv)
            shape = np.shape(limits.acceleration) or ()
            if shape not in ((), (nv,)):
                raise InvalidArgument(
                    f"acceleration has shape {shape}: one number, or an array of shape ({nv},)"
                )
            self.most[where] = limits.acceleration
        speed = np.array(model.velocityLimit, dtype=float)
        self.speed = np.where((speed > 0) & (speed < UNLIMITED), speed, np.inf)
        self.joints = Limits.of(model)
        self.reach = _or_infinite(self.joints.upper), _or_infinite(self.joints.lower)
        bounded = np.isfinite(self.most)
        if limits.dt is not None:
            bounded |= np.isfinite(self.speed)
            bounded[self.joints.iv] = True
        self.columns = np.flatnonzero(bounded)
        self.names = entry_names(model, self.columns)

    def at(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Return the bounds (k,) of the accelerations at a state; infinite where there is none."""
        if not len(self.columns):
            return np.zeros(0), np.zeros(0)
        lower, upper = -self.most, self.most.copy()
        if self.dt is not None:
            dt, joints = self.dt, self.joints
            upper = np.minimum(upper, (self.speed - v) / dt)
            lower = np.maximum(lower, (-self.speed - v) / dt)
            ahead = q[joints.iq] + dt * v[joints.iv]
            highest, lowest = self.reach
            upper[joints.iv] = np.minimum(upper[joints.iv], 2.0 * (highest - ahead) / dt**2)
            lower[joints.iv] = np.maximum(lower[joints.iv], 2.0 * (lowest - ahead) / dt**2)
        return lower[self.columns], upper[self.columns]


def torque_limits(robot: Robot, columns: NDArray[np.int_]) -> Array:
    """Return the largest torque on the joints of some entries of v [N m, N]; infinite for none."""
    most = np.array(robot.unedited.effortLimit, dtype=float)[columns]
    return np.where((most > 0) & (most < UNLIMITED), most, np.inf)


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
