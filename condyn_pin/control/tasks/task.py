"""The contract of a task, and how to write one.

A task is a row, or several, of what a controller minimises:

    w |J a + drift - a_wanted|^2        over accelerations
    w |F lam - f_wanted|^2              over contact forces

1. Add one file to this folder with one frozen dataclass that inherits from `Task`, or from
   `Tracking` if it follows a reference by feedback. The class registers itself in `TASKS`.
2. Its fields are what a user says of it: names, numbers, tuples of numbers, functions of t. Checks
   are in `__post_init__`, which ends with that of its base.
3. `bind(scene, home)` looks names up, once, and returns a `BoundTask`: names of its rows, their
   unit, and `rows(motion, t)`, which returns (J, b) with J x = b wanted. `home()` is a
   configuration of the scene with its loops closed: where a task without a reference belongs.
4. `rows` is called in every control tick. It reads `motion`, and writes to nothing that is not its
   own; the arrays that it returns are not written to.
5. A weight of infinity makes the rows equations, which nothing is weighed against.
6. A task that the compiled core has too sets `compiled`; one that leaves it out is done in
   Python. Either way `tests/test_control.py` and `tests/test_native_control.py` need an example.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from numbers import Real
from typing import Any, ClassVar, Final, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import (
    check_accuracy,
    check_called,
    check_type,
    checked_names,
    listed,
    register,
)
from condyn_pin._core.arrays import Array, finite, text_of
from condyn_pin._core.models import whole_data
from condyn_pin.constraints.constraint import check_positive
from condyn_pin.constraints.forces import ALIGNED, frame_jacobian
from condyn_pin.constraints.path import MinimumJerk
from condyn_pin.constraints.rows.bound import Terms
from condyn_pin.constraints.rows.equations import Equations
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import InvalidArgument

# Motion: what tasks read of a robot at one state, computed once for all of them.


class TaskQuantity(NamedTuple):
    """A quantity x, its velocity v, and J and Jdot v of it: J a + drift."""

    x: Any
    v: Array
    J: Array
    drift: Array


class RobotMotion:
    """The robot of a scene at one state, in the memory of its equations."""

    # q (nq,), v (nv,): configuration, and velocity [rad/s, m/s]; a free-flyer's in its body frame,
    # linear first
    q: Array
    v: Array
    terms: Terms  # M, h, J, gamma and a_ref of the scene

    def __init__(self, scene: Scene, equations: Equations) -> None:
        self.scene = scene
        self.model, self.data = equations.model, equations.data
        self._equations = equations
        # views of data: what Pinocchio writes is read there
        self._oMi = [self.data.oMi[joint] for joint in range(self.model.njoints)]
        self._com = self.data.com[0], self.data.vcom[0]
        self._acom = self.data.acom[0]

    def move(self, q: Array, v: Array) -> None:
        """Go to a state: the terms of the scene, joint Jacobians and accelerations with a = 0."""
        self.q, self.v = q, v
        self.terms = self._equations.terms(q, v)
        if not self._equations.m:  # data.a is still that of the last answer
            pin.forwardKinematics(self.model, self.data, q, v, np.zeros_like(v))

    def frame(self, joint: int, placement: Any) -> TaskQuantity:
        """Return a frame: its placement in the world, and 6 rows in the axes of the world."""
        model, data = self.model, self.data
        velocity = pin.getFrameVelocity(model, data, joint, placement, ALIGNED)
        drift = pin.getFrameClassicalAcceleration(model, data, joint, placement, ALIGNED)
        J = frame_jacobian(model, data, joint, placement, ALIGNED)
        return TaskQuantity(self._oMi[joint] * placement, velocity.vector, J, drift.vector)

    def center_of_mass(self) -> TaskQuantity:
        """Return the centre of mass: 3 rows in the axes of the world."""
        data = self.data
        pin.centerOfMass(self.model, data, pin.KinematicLevel.ACCELERATION, False)
        # a single column comes as a vector
        J = pin.jacobianCenterOfMass(self.model, data, False).reshape(3, -1)
        return TaskQuantity(*self._com, J, self._acom)

    def angular_momentum(self) -> TaskQuantity:
        """Return the angular momentum about the centre of mass; it is its own "velocity"."""
        model, data = self.model, self.data
        drift = np.array(pin.computeCentroidalMomentumTimeVariation(model, data).angular)
        momentum = np.array(data.hg.angular)
        J = np.array(pin.ccrba(model, data, self.q, self.v).reshape(6, -1)[3:])
        return TaskQuantity(momentum, momentum, J, drift)


def moving(scene: Scene, frame: str) -> tuple[int, Any]:
    """Return the joint of a frame and its placement there; the frame has to move."""
    joint, place = scene.robot.frame(frame)
    if joint == 0:
        raise InvalidArgument(f"frame = {frame!r}: it belongs to the world, which does not move")
    return joint, place


def placement_at(scene: Scene, joint: int, place: Any, q: Array) -> Any:
    """Return the placement of a frame in the world at q."""
    model = scene.robot.unedited
    data = whole_data(model)
    pin.forwardKinematics(model, data, q)
    return data.oMi[joint] * place


def entry_names(model: Any, columns: NDArray[np.int_]) -> tuple[str, ...]:
    """Return a name for each of some entries of v: the joint, numbered where it has several."""
    names = [""] * int(model.nv)
    for name, joint in zip(list(model.names)[1:], list(model.joints)[1:], strict=True):
        for i in range(joint.nv):
            names[joint.idx_v + i] = str(name) if joint.nv == 1 else f"{name}.{i}"
    return tuple(names[i] for i in columns.tolist())


# minimum_jerk: a smooth path from one value to another, as the reference of a task.


def minimum_jerk(
    start: ArrayLike, end: ArrayLike, duration: float, *, begin: float = 0.0
) -> Callable[[float], tuple[Array, Array, Array]]:
    """Return a minimum-jerk path between two values, a function of t that returns (x, v, a).

    x(s) = start + (10 s^3 - 15 s^4 + 6 s^5) (end - start),    s = (t - begin) / duration

    Use it as the `reference` of a task, or as the path of `Driven` rows. Before and after, it is at
    rest without acceleration.

    Parameters
    ----------
    start, end : (n,) array_like or float
        Such as two points of the world [m], or two angles of a joint [rad].
    duration : float
        Length of the motion [s].
    begin : float
        When it leaves the start [s].

    Returns
    -------
    callable
        Of t [s]; frozen, so that tasks with it compare, hash and pickle.

    Raises
    ------
    InvalidArgument
        If start and end are no arrays of one size, or the duration is not positive.

    References
    ----------
    Flash, Hogan. The coordination of arm movements: an experimentally confirmed mathematical model.
    Journal of Neuroscience 5, 1985.
    """
    size = np.size(start)
    here, there = (
        finite(name, np.atleast_1d(value), size) for name, value in (("start", start), ("end", end))
    )
    check_positive("time [s]", duration=duration)
    since = float(finite("begin", begin, ()))
    return MinimumJerk(tuple(here.tolist()), tuple(there.tolist()), float(duration), since)


# A task as numbers: what the compiled core has in place of a bound task.


# Rows of a task in the core (`native/src/tick/tick_spec.hpp`).
TaskKind = Literal[
    "position", "orientation", "pose", "center of mass", "joint", "posture", "angular momentum",
    "contact force", "capture point",
]  # fmt: skip

# References as numbers at t: x_r, v_r and a_r one after the other.
Follow = Callable[[float], Array]

NO_FEEDBACK: Final = (0.0, 0.0)


class CompiledTask(NamedTuple):
    """The rows of one task: a_r + kp (x_r - x) + kd (v_r - v), or x_r of a force.

    Of a capture point x_r is where the mass belongs, in the axes of the floor, and its edges.
    """

    kind: TaskKind
    sizes: tuple[int, int]  # of x_r, and of v_r and a_r
    gains: tuple[float, float]  # kp [1/s^2] and kd [1/s]; of a capture point k [1] and omega [1/s]
    follow: Callable[[], Follow]  # returns the reference as a function of t; asked for once
    changes: bool  # whether it depends on t
    at: int = 0  # the joint of its frame, where q holds its joint, or the contact in the scene
    placement: Any = None  # of its frame on the joint, or of the floor
    columns: tuple[int, ...] = ()  # entries of v, where rows are entries of a


# The contract of a task, and how to write one.


TASKS: dict[str, type[Task]] = {}

DefaultReference = Callable[[], Array]


# Of (motion, t): J (r, nv) or (r, m), and b (r,).
Rows = Callable[["RobotMotion", float], tuple[Array, Array]]


def approach_by_turns(rows: Rows, first: int) -> Rows:
    """Rows whose b are distances, three of them turns log3, with J the derivative of -b by q.

    log3(R_r R^T exp(-w)) = b - Jlog3 w
    """
    turns = slice(first, first + 3)

    def approach(motion: RobotMotion, t: float) -> tuple[Array, Array]:
        J, b = rows(motion, t)
        J = J.copy()
        J[turns] = pin.Jlog3(pin.exp3(b[turns])) @ J[turns]
        return J, b

    return approach


@dataclass(frozen=True, eq=False)
class BoundTask:
    """A task bound to one scene."""

    over: Literal["accelerations", "forces"]  # of what its rows are
    names: tuple[str, ...]  # of the rows
    unit: str  # of b and of the errors of its rows
    # of (motion, t); returns J (r, nv) or (r, m) and b (r,)
    rows: Callable[[RobotMotion, float], tuple[Array, Array]]
    compiled: CompiledTask | None = None  # the same for the compiled core
    # (r, nv) J, where it is the same in every tick: its part of the program is computed once
    fixed: Array | None = None
    # (r, nv) and b, with J the derivative of -b by q where turns are far; J of `rows` by default
    approach: Callable[[RobotMotion, float], tuple[Array, Array]] | None = None


@dataclass(frozen=True)
class Task(ABC):
    """A task of a controller; the base of all tasks.

    Parameters
    ----------
    weight : float
        Of the squares of its rows [s^4/m^2, s^4/rad^2, 1/N^2]; infinity makes them equations.
    name : str, optional
        What its rows are called by.

    Raises
    ------
    InvalidArgument
        If the weight is negative or NaN, or the name is no text.
    """

    weight: float = field(default=1.0, kw_only=True)
    name: str = field(default="", kw_only=True)

    def __post_init__(self) -> None:
        if not (isinstance(self.weight, Real) and self.weight == math.inf):
            check_accuracy("weight", self.weight)
        check_type("name", self.name, str, "a text is needed")
        object.__setattr__(self, "name", self.name or self._called)

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        if getattr(cls.bind, "__isabstractmethod__", False):
            return
        register(TASKS, cls.__name__, cls, f"a task named {cls.__name__}")

    @property
    def _called(self) -> str:
        """Default name of the task."""
        return type(self).__name__

    @abstractmethod
    def bind(self, scene: Scene, home: DefaultReference) -> BoundTask:
        """Return the task bound to a scene; `home` finds where it belongs without a reference."""

    def _row_names(self, axes: Sequence[str]) -> tuple[str, ...]:
        return tuple(f"{self.name}.{axis}" for axis in axes)


@dataclass(frozen=True)
class Tracking(Task):
    """A task that follows a reference: a_wanted = a_r + kp (x_r - x) + kd (v_r - v).

    Parameters
    ----------
    reference : (k,) array_like or callable, optional
        Where it belongs [m, rad], or a function of t that returns (x, v, a). By default where it is
        in the first posture of the robot.
    a : (r,) array_like, optional
        An acceleration that is wanted as it is, in place of a reference and without feedback.
    kp : float
        Gain of the position error [1/s^2].
    kd : float, optional
        Gain of the velocity error [1/s]; 2 sqrt(kp) by default, which is critical damping.
    axes : sequence of str, optional
        Rows that it has, such as "xy" of a centre of mass, or ("z", "about x") of a pose; all by
        default. The compiled core has whole tasks only.

    Raises
    ------
    InvalidArgument
        If a gain is negative, or a reference and an acceleration are both given.
    """

    unit: ClassVar[str] = "m/s^2"

    reference: Any = field(default=None, kw_only=True)
    a: Any = field(default=None, kw_only=True)
    kp: float = field(default=100.0, kw_only=True)  # [1/s^2]
    kd: float | None = field(default=None, kw_only=True)  # [1/s]
    axes: Sequence[str] | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        check_accuracy("kp", self.kp)
        if self.kd is None:
            object.__setattr__(self, "kd", 2.0 * math.sqrt(self.kp))
        check_accuracy("kd", self.kd)  # type: ignore[arg-type]
        if self.a is not None and self.reference is not None:
            raise InvalidArgument("a: give an acceleration or a reference, not both")
        if callable(self.reference):
            check_called("reference", self.reference, "t")
        elif self.reference is not None:
            object.__setattr__(self, "reference", self._value(self.reference))
        if self.a is not None:
            object.__setattr__(self, "a", _tuple(finite("a", self.a, np.shape(self.a))))
        if self.axes is not None:
            check_type("axes", self.axes, Iterable, 'names of rows are needed, such as "xy"')
            object.__setattr__(self, "axes", tuple(self.axes))
        super().__post_init__()

    def at(self, t: float) -> Self:
        """Return the task of standing at its reference at a time [s]: b = x_r - x at rest."""
        if self.a is not None:
            raise InvalidArgument(f"{self.name}: a reference is needed, not an acceleration")
        found = self.reference
        if callable(found):
            found = found(t)[0]
        return replace(self, reference=found, kp=1.0, kd=0.0)

    def _value(self, reference: Any) -> Any:
        """Return a reference that is no function as what hashes, or raise InvalidArgument."""
        return _tuple(finite("reference", reference, np.shape(reference)))

    def _chosen(self, bound: BoundTask) -> BoundTask:
        """The rows of `axes`."""
        if self.axes is None:
            return bound
        known = [row.removeprefix(f"{self.name}.") for row in bound.names]
        names = checked_names("axes", self.axes, known, "axis")
        if not names:
            raise InvalidArgument(f"axes: one at least of {listed(known)} is needed")
        some = [known.index(name) for name in names]

        def chosen_of(rows: Rows) -> Rows:
            def some_rows(motion: RobotMotion, t: float) -> tuple[Array, Array]:
                J, b = rows(motion, t)
                return J[some], b[some]

            return some_rows

        return replace(
            bound,
            names=tuple(bound.names[i] for i in some),
            rows=chosen_of(bound.rows),
            compiled=None,
            fixed=None if bound.fixed is None else bound.fixed[some],
            approach=chosen_of(bound.approach) if bound.approach else None,
        )

    def _feedback(
        self, size: int, start: Callable[[], Any], error: Callable[[Any], Callable[[Any], Array]]
    ) -> Callable[[Any, Array, float], Array]:
        """Return a_wanted (size,) as a function of x, v and t."""
        # `start` returns the reference where none was given. `error`, of a reference, returns a
        # function of x: how far it is from the reference (size,).
        if self.a is not None:
            fixed = finite(f"{self.name}.a", np.atleast_1d(self.a), size)
            return lambda x, v, t: fixed
        kp, kd = self.kp, float(self.kd or 0.0)
        if not callable(self.reference):
            left = error(start() if self.reference is None else self.reference)
            return lambda x, v, t: kp * left(x) - kd * v
        at = self._path(size, error)

        def wanted(x: Any, v: Array, t: float) -> Array:
            left, v_r, a_r = at(t)
            return np.asarray(a_r + kp * left(x) + kd * (v_r - v))

        return wanted

    def _path(
        self, size: int, made: Callable[[Any], Any]
    ) -> Callable[[float], tuple[Any, Array, Array]]:
        """Return a reference as a function of t: what is `made` of x_r, then v_r, a_r (size,)."""
        at = self.reference

        def path(t: float) -> tuple[Any, Array, Array]:
            found = at(t)
            if not isinstance(found, tuple | list) or len(found) != 3:
                raise InvalidArgument(
                    f"{self.name}: reference({t:g}) = {text_of(found)}: (x, v, a) is needed"
                )
            what = f"{self.name}: reference({t:g})"
            v_r = finite(f"{what}: v", np.atleast_1d(found[1]), size)
            a_r = finite(f"{what}: a", np.atleast_1d(found[2]), size)
            try:
                x_r = made(self._value(found[0]))
            except InvalidArgument as fault:  # it speaks of a reference that is no function
                raise InvalidArgument(f"{what}: {fault}") from fault
            return x_r, v_r, a_r

        return path

    def _compiled(
        self, kind: TaskKind, sizes: tuple[int, int], start: Callable[[], Any],
        numbers: Callable[[Any], Array], **place: Any,
    ) -> CompiledTask:  # fmt: skip
        """Return the task for the compiled core; `numbers` are those of a reference x_r."""
        still = np.zeros(sizes[1])
        if self.a is not None:
            fixed = np.concatenate((np.zeros(sum(sizes)), np.atleast_1d(self.a)))
            return CompiledTask(kind, sizes, NO_FEEDBACK, lambda: lambda t: fixed, False, **place)

        def follow() -> Follow:
            if callable(self.reference):
                at = self._path(sizes[1], numbers)
                return lambda t: np.concatenate(at(t))
            x_r = numbers(start() if self.reference is None else self.reference)
            return lambda t: np.concatenate((x_r, still, still))

        gains = self.kp, float(self.kd or 0.0)
        return CompiledTask(kind, sizes, gains, follow, callable(self.reference), **place)


def _tuple(value: Array) -> Any:
    """Return an array as tuples, which hash."""
    return tuple(map(_tuple, value)) if value.ndim else float(value)


def difference(reference: ArrayLike) -> Callable[[Array], Array]:
    """Return the error of positions x, reference - x, as a function."""
    r = np.array(reference)
    return lambda x: r - x
