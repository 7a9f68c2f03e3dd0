"""Joints of a robot, their limits, and motors that act on several of them.

The numbers of q, v and tau by the names of joints.

q[joint]            nq numbers: one for a hinge or a slider, (cos, sin) for a joint without
                    limits, x y z and a quaternion x y z w for a free-flyer
v[joint], tau[joint]   nv numbers

tau_i = w_i u,    speed of the motor = sum w_i v_i
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import inf
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import check_type
from condyn_pin._core.arrays import Array, finite, text_of
from condyn_pin._core.models import UNLIMITED, algorithms, data_of, lengths, whole_data
from condyn_pin.constraints.constraint import floats, text
from condyn_pin.constraints.places import FrameLike
from condyn_pin.constraints.rows.bound import ConstraintViolation
from condyn_pin.errors import InvalidArgument, UnknownName, unknown_name

if TYPE_CHECKING:
    from condyn_pin.model.robot import Robot

Values = Mapping[str, ArrayLike]


def joint_of(model: Any, name: str) -> Any:
    """Return the joint of a name, or raise UnknownName with the nearest names."""
    check_type("joint", name, str, "the name of a joint is needed")
    index = model.getJointId(name)
    if not 0 < index < model.njoints:  # the world, or no joint
        carrying = [f.parentJoint for f in model.frames if f.name == name and f.parentJoint]
        if carrying:
            joint = model.names[carrying[0]]
            raise UnknownName(
                f"no joint named {name!r}, a frame on the body that {joint!r} moves; did you mean "
                f"{joint!r}?"
            )
        raise unknown_name("joint", name, tuple(model.names)[1:])
    return model.joints[index]


def coordinate_names(model: Any, of: Literal["q", "v"]) -> Iterator[str]:
    """Yield a name for each entry of q or v: the joint, with a number if it has several."""
    for name, joint in list(zip(model.names, model.joints, strict=True))[1:]:
        size = joint.nq if of == "q" else joint.nv
        yield from [name] if size == 1 else (f"{name}[{i}]" for i in range(size))


def by_joint(model: Any, arrays: dict[str, Array]) -> dict[str, Array]:
    """Columns of q (N, nq) and of arrays (N, nv) by name, such as "q elbow"; each (N,)."""
    table: dict[str, Array] = {}
    for kind, values in arrays.items():
        names = coordinate_names(model, "q" if kind == "q" else "v")
        table |= {f"{kind} {name}": each for name, each in zip(names, values.T, strict=True)}
    return table


def index(robot: Robot, name: str, of: Literal["q", "v"]) -> int:
    """Index of a joint with one coordinate in q or in v; see `Robot.index_q`."""
    joint = joint_of(robot.model, name)
    start, size = (joint.idx_q, joint.nq) if of == "q" else (joint.idx_v, joint.nv)
    if size != 1:
        by_name = "configuration" if of == "q" else "joint_vector"
        raise InvalidArgument(
            f"joint {name!r} has {size} numbers in {of}, {of}[{start}:{start + size}]; "
            f"robot.{by_name}({{{name!r}: ...}}) sets them by name"
        )
    return int(start)


def with_values(model: Any, q: Array, values: Values) -> Array:
    """Configuration q with the values of some joints."""
    # A joint that is (cos, sin) also takes its angle [rad].
    q = np.array(q)
    for name, value in _pairs(values):
        joint = joint_of(model, name)
        if joint.nq == 2 and joint.nv == 1 and _is_one(value):
            angle = finite(name, value, ())
            value = [np.cos(angle), np.sin(angle)]
        q[joint.idx_q : joint.idx_q + joint.nq] = _numbers(name, value, joint.nq)
    return q


def configuration(robot: Robot, values: Values, start: ArrayLike | None) -> Array:
    """Return a configuration by joint names; see `Robot.configuration`."""
    if start is None:
        first = next(iter(robot.postures.values()), None)
        start = pin.neutral(robot.model) if first is None else first
    q = with_values(robot.model, finite("start", start, robot.nq), values)
    return _checked_configuration(robot, q)


def joint_values(robot: Robot, q: ArrayLike) -> dict[str, float | Array]:
    """Return the values of all joints; see `Robot.joint_values`."""
    q_ = finite("q", q, robot.nq)
    found: dict[str, float | Array] = {}
    for name, joint in zip(robot.joints, robot.model.joints[1:], strict=True):
        numbers = q_[joint.idx_q : joint.idx_q + joint.nq]
        if joint.nv > 1:
            found[name] = numbers.copy()
        else:
            found[name] = float(numbers[0] if joint.nq == 1 else np.arctan2(numbers[1], numbers[0]))
    return found


def joint_vector(robot: Robot, values: Values) -> Array:
    """Return a vector along v by joint names; see `Robot.joint_vector`."""
    vector = np.zeros(robot.nv)
    for name, value in _pairs(values):
        joint = joint_of(robot.model, name)
        vector[joint.idx_v : joint.idx_v + joint.nv] = _numbers(name, value, joint.nv)
    return vector


def frame_pose(robot: Robot, q: ArrayLike, frame: FrameLike) -> Any:
    """Return the pose of a frame in the world; see `Robot.frame_pose`."""
    joint, placement = robot.frame(frame)
    data = data_of(robot.model)
    algorithms(data).forwardKinematics(robot.model, data, _checked_configuration(robot, q))
    return data.oMi[joint] * placement


def center_of_mass(robot: Robot, q: ArrayLike) -> Array:
    """Return the centre of mass in the world; see `Robot.center_of_mass`."""
    return np.array(
        pin.centerOfMass(robot.model, whole_data(robot.model), _checked_configuration(robot, q))
    )


def _checked_configuration(robot: Robot, q: ArrayLike) -> Array:
    """Configuration (nq,), checked for size and norms."""
    still = np.zeros(robot.nv)
    return robot.arguments.check(q, still, still)[0]


def _pairs(values: Values) -> list[tuple[str, Any]]:
    check_type("values", values, Mapping, "values by joint are needed, such as {'knee': 0.3}")
    return list(values.items())


def _numbers(name: str, value: Any, size: int) -> Array:
    return finite(name, [value] if size == 1 and _is_one(value) else value, size)


def _is_one(value: Any) -> bool:
    """True if a value is a single number; lists are none, even where numpy cannot convert them."""
    return not isinstance(value, (list, tuple)) and np.ndim(value) == 0


def model_with_limits(robot: Robot, limits: Mapping[str, tuple[float, float]]) -> Any:
    """Return a model with other joint limits; see `Robot.with_limits`."""
    changed = pin.Model(robot.model)
    for name, ends in _pairs(limits):
        place, words = index(robot, name, "q"), f"limits of {name}"
        if np.isnan(ends).any() or np.shape(ends) != (2,) or not ends[0] <= ends[1]:
            raise InvalidArgument(f"{words} = {ends!r}: a lower and an upper one are needed")
        changed.lowerPositionLimit[place], changed.upperPositionLimit[place] = ends
    return changed


def model_with_masses(model: Any, masses: Mapping[str, float]) -> Any:
    """Return a model with other masses, inertias in proportion; see `Robot.with_masses`."""
    changed = pin.Model(model)
    for name, value in _pairs(masses):
        joint = joint_of(model, name)
        mass, old = float(finite(f"mass of {name}", value, ())), model.inertias[joint.id]
        if not mass > 0.0:
            raise InvalidArgument(f"mass of {name} = {mass:g}: a positive mass is needed [kg]")
        if not old.mass > 0.0:
            raise InvalidArgument(
                f"{name} moves a body without mass, and its inertia cannot grow in proportion: "
                "change `inertias` of a copy of the model, and make a robot of that"
            )
        changed.inertias[joint.id] = pin.Inertia(mass, old.lever, old.inertia * (mass / old.mass))
    return changed


# Limits of joints: who has some, who is beyond them, who is pushed through them.


@dataclass(frozen=True, eq=False)
class Limits:
    """Joint limits of the joints whose coordinates are plain numbers."""

    joints: tuple[str, ...]  # names, one for each limited coordinate
    # iv, iq (k,): where the coordinate is in v and in q
    iv: NDArray[np.int_]
    iq: NDArray[np.int_]
    length: NDArray[np.bool_]  # (k,) whether the coordinate is a length
    # lower, upper (k,): [rad, m]
    lower: Array
    upper: Array

    @classmethod
    def of(cls, model: Any) -> Limits:
        """Return the finite limits of a model; free-flyers, balls and the like have none here."""
        lowest, highest = np.array(model.lowerPositionLimit), np.array(model.upperPositionLimit)
        found = []
        for name, joint in zip(list(model.names)[1:], list(model.joints)[1:], strict=True):
            plain = lengths(joint) if joint.nq == joint.nv else ()
            for k, length in enumerate(plain):
                iv, iq = joint.idx_v + k, joint.idx_q + k
                is_limited = lowest[iq] > -UNLIMITED or highest[iq] < UNLIMITED
                if is_limited and lowest[iq] <= highest[iq]:
                    found.append((name, iv, iq, length))
        iq_of = np.array([iq for _, _, iq, _ in found], dtype=np.int_)
        return cls(
            tuple(name for name, *_ in found),
            np.array([iv for _, iv, *_ in found], dtype=np.int_),
            iq_of,
            np.array([length for *_, length in found], dtype=np.bool_),
            lowest[iq_of],
            highest[iq_of],
        )

    def clip(self, q: Array) -> None:
        """Clip q to the joint limits, in place."""
        q[self.iq] = np.minimum(np.maximum(q[self.iq], self.lower), self.upper)

    def beyond(self, q: Array) -> dict[str, ConstraintViolation]:
        """Violation of the joint limits, by joint; the largest of each joint's coordinates."""
        x = q[self.iq]
        out = np.maximum(self.lower - x, x - self.upper)
        found: dict[str, ConstraintViolation] = {}
        for i in np.flatnonzero(out > 0):
            by, most = float(out[i]), found.get(self.joints[i], ConstraintViolation(0.0, 0.0))
            found[self.joints[i]] = (
                ConstraintViolation(max(by, most.length), most.angle)
                if self.length[i]
                else ConstraintViolation(most.length, max(by, most.angle))
            )
        return found

    def pushed(self, q: Array, step: Array) -> NDArray[np.int_]:
        """Indices in v of coordinates at a limit that a step would violate."""
        x, dx = q[self.iq], step[self.iv]
        through = ((x <= self.lower) & (dx < 0)) | ((x >= self.upper) & (dx > 0))
        return self.iv[through]


_NONE = np.zeros(0, dtype=np.int_)
NO_LIMITS = Limits((), _NONE, _NONE, np.zeros(0, dtype=np.bool_), np.zeros(0), np.zeros(0))


@dataclass(frozen=True)
class CoupledMotor:
    """A motor that acts on several joints: through a differential, a belt, or a cable.

    tau_i = w_i u,    its speed is sum w_i v_i

    ``CoupledMotor("left", {"yaw": 1.0, "pitch": 1.0})`` and ``CoupledMotor("right", {"yaw": 1.0,
    "pitch": -1.0})`` are the motors of a differential.

    Parameters
    ----------
    name : str
        Name of the motor, which no joint of the robot has.
    joints : mapping of str to float
        Weight w_i of each joint, all with one degree of freedom: turns of the motor for a turn of
        the joint [1], and of a cable its lever arm [m].
    limits : (float, float)
        Least and largest u [N m, N]; ``(0.0, 80.0)`` of a cable that only pulls. None by default.

    Raises
    ------
    InvalidArgument
        If there is no joint, a weight is zero, or the least u is not below the largest.
    """

    name: str
    joints: Mapping[str, float]
    limits: Sequence[float] = (-inf, inf)  # [N m, N]

    def __post_init__(self) -> None:
        text("name", self.name, "motor")
        object.__setattr__(self, "joints", _weights(self.joints))
        object.__setattr__(self, "limits", _limits(self.limits))

    @property
    def weights(self) -> dict[str, float]:
        """Weight w_i of each joint."""
        return dict(self.joints)


def check_coupled(model: Any, motors: Sequence[CoupledMotor]) -> None:
    """Raise UnknownName or InvalidArgument unless motors have joints, and names of their own."""
    names = [motor.name for motor in motors]
    for motor in motors:
        if names.count(motor.name) > 1:
            raise InvalidArgument(f"motors: two are named {motor.name!r}; rename one of them")
        if motor.name in model.names:
            raise InvalidArgument(f"motor {motor.name!r}: a joint has this name; rename the motor")
        for joint in motor.weights:
            if (nv := joint_of(model, joint).nv) != 1:
                raise InvalidArgument(
                    f"motor {motor.name!r}: joint {joint!r} has {nv} degrees of freedom; joints "
                    "with one are needed"
                )


def _weights(given: Any) -> tuple[tuple[str, float], ...]:
    """Pairs of joints and their weights."""
    try:
        pairs = [*(given.items() if isinstance(given, Mapping) else given)]
        found = {text("joints", name, "joint"): weight for name, weight in pairs}
    except (TypeError, ValueError) as error:
        raise InvalidArgument(f"joints = {text_of(given)}: a weight by joint is needed") from error
    if not found:
        raise InvalidArgument(f"joints = {text_of(given)}: one joint at least is needed")
    if len(found) < len(pairs):
        raise InvalidArgument(f"joints = {text_of(given)}: a joint is named twice; name it once")
    for name, weight in zip(found, floats("joints", [*found.values()], len(found)), strict=True):
        if abs(weight) < 1.0 / tolerances.HUGE:
            raise InvalidArgument(f"joints: the weight of {name!r} is {weight:g}; leave it out")
        found[name] = weight
    return tuple(found.items())


def _limits(given: Any) -> tuple[float, float]:
    """Least and largest torque, the least below the largest; infinite for none."""
    try:
        least, largest = (float(x) for x in given if not isinstance(x, str | bool))
    except (TypeError, ValueError, OverflowError) as error:
        raise InvalidArgument(
            f"limits = {text_of(given)}: the least and the largest torque are needed"
        ) from error
    if not least < largest:
        raise InvalidArgument(f"limits = {text_of(given)}: the least has to be below the largest")
    return least, largest
