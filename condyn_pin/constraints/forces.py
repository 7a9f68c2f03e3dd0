"""External forces: on frames, and as generalised forces.

AppliedForce: a force from outside, at a frame of the robot.

    M a + h = tau + J^T lam + sum_f J_f^T f

with J_f the Jacobian of the frame, in the axes that f is in.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Final, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core._pin import LOCAL, pin
from condyn_pin._core.arguments import check_called
from condyn_pin._core.arrays import Array, finite
from condyn_pin._core.models import algorithms, joints_with_turning_axes
from condyn_pin.constraints.constraint import FramedModel, check_size
from condyn_pin.constraints.places import FrameLike, set_frames, short_frames
from condyn_pin.errors import InvalidArgument

Axes = Literal["world", "body"]
ForceFunction = Callable[[float, Array, Array], ArrayLike]  # (t, q, v) -> (3,) or (6,) [N, N m]

_SHAPES: Final = ((3,), (6,))


@dataclass(frozen=True, eq=False)
class AppliedForce:
    """A force, or a force with a moment, that acts on a body at the origin of a frame.

    tau_f = J_f^T f

    with J_f the Jacobian of the frame, in the axes of f.

    Parameters
    ----------
    frame : str, (joint, pin.SE3) or pin.Frame
        The frame at whose origin, and on whose body, it acts; `Robot.with_frame` adds one.
    force : (3,) or (6,) array_like, or callable
        Force [N], or force and moment about the frame's origin, force first [N, N m]. For batches
        also (N, 3) or (N, 6), one row per state. For `simulate` and `simulate_batch` also a
        function of (t, q, v) that returns (3,) or (6,).
    frame_of : {"world", "body"}
        The axes of its components. With ``world`` the force keeps its direction while the body
        turns, as wind and a hanging weight do; with ``body``, the axes of `frame`, it turns with
        the body, as a thruster does.

    Raises
    ------
    InvalidArgument
        If a number is not finite, a shape is another, a function takes other arguments, or
        `frame_of` is neither.
    """

    frame: FrameLike
    force: ArrayLike | ForceFunction
    frame_of: Axes = "world"

    def __post_init__(self) -> None:
        set_frames(self, "frame")
        if self.frame_of not in get_args(Axes):
            raise InvalidArgument(
                f"frame_of = {self.frame_of!r}: 'world' or 'body' is needed, whose axes the "
                "components are in"
            )
        if callable(self.force):
            check_called(self._what, self.force, "t, q, v")
        else:
            object.__setattr__(self, "force", _numbers(self._what, self.force))

    @property
    def is_function(self) -> bool:
        """True if the force is a function of (t, q, v)."""
        return callable(self.force)

    @property
    def has_rows(self) -> bool:
        """True if the force has one row per state of a batch."""
        return not self.is_function and self.numbers.ndim == 2

    @property
    def numbers(self) -> Array:
        """Components of a force that is no function: (3,), (6,), or a row per state [N, N m]."""
        return self.force  # type: ignore[return-value]

    def at(self, t: float, q: Array, v: Array) -> AppliedForce:
        """Return the force at a time t and a state q, v."""
        if not callable(self.force):
            return self
        found = _numbers(f"{self._what}({t:g}, q, v)", self.force(t, q, v))
        if found.ndim != 1:
            raise _of_another_shape(f"{self._what}({t:g}, q, v)", found.shape)
        return replace(self, force=found)

    def row(self, i: Any) -> AppliedForce:
        """Return the force at state i of a batch, or at some states."""
        return replace(self, force=self.numbers[i]) if self.has_rows else self

    @property
    def _what(self) -> str:
        return f"force on {short_frames(self.frame)!r}"

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, AppliedForce):
            return NotImplemented
        same = (self.frame, self.frame_of) == (other.frame, other.frame_of)
        if callable(self.force) or callable(other.force):
            return same and self.force is other.force
        return same and np.array_equal(self.numbers, other.numbers)

    def __hash__(self) -> int:
        return hash((self.frame, self.frame_of))


def applied_forces(
    forces: object, *, functions: bool = False, rows: int | None = None
) -> tuple[AppliedForce, ...]:
    """Applied forces of a user, or InvalidArgument."""
    # `functions` says whether they may be functions of (t, q, v), and `rows` the number of states,
    # where a force may have a row each.
    if isinstance(forces, AppliedForce):
        raise InvalidArgument("forces: a list is needed, also for a single force")
    if isinstance(forces, str) or not isinstance(forces, Iterable):
        raise InvalidArgument(f"forces = {forces!r}: a list of AppliedForce is needed")
    found = tuple(forces)
    for i, force in enumerate(found):
        if not isinstance(force, AppliedForce):
            raise InvalidArgument(f"forces[{i}] = {force!r}: an AppliedForce is needed")
        name = f"forces[{i}], on {force.frame!r}"
        if force.is_function and not functions:
            raise InvalidArgument(
                f"{name}: it is a function of (t, q, v), and nothing moves here; its value at the "
                "state is needed"
            )
        if force.has_rows and rows is None:
            raise InvalidArgument(
                f"{name} has shape {force.numbers.shape}: (3,) or (6,) is needed; rows are for the "
                "verbs of batches"
            )
        if force.has_rows and len(force.numbers) != rows:
            raise InvalidArgument(
                f"{name} has {len(force.numbers)} rows, and there are {rows} states"
            )
    return found


def _numbers(name: str, force: Any) -> Array:
    """Components of a force in a read-only array."""
    try:
        shape = np.shape(force)
    except ValueError:  # of lists that differ in length, which `finite` refuses
        shape = (3,)
    if shape[-1:] not in _SHAPES or len(shape) > 2:
        raise _of_another_shape(name, shape)
    array = np.array(finite(name, force, shape))
    check_size(name, *np.abs(array).reshape(-1).tolist())
    array.flags.writeable = False
    return array


def _of_another_shape(name: str, shape: tuple[int, ...]) -> InvalidArgument:
    return InvalidArgument(
        f"{name} has shape {shape}: (3,), a force, or (6,), a force and a moment, is needed"
    )


# Loads: what forces on frames do to the joints of a robot.
#
#     tau_f = J_f^T f
#
# J_f comes from joint Jacobians, in the axes of f and at the origin of the frame. The proof of an
# answer takes the same forces another way: as wrenches on the bodies, through Newton-Euler.


ALIGNED = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED


class ForceSite(NamedTuple):
    """Joint that carries a frame, and the placement of the frame on it."""

    joint: int
    placement: Any


class PointForce(NamedTuple):
    """Applied force bound to a model."""

    place: ForceSite
    in_world: bool  # whether it keeps its direction in the world, or turns with the frame
    wrench: Array  # (6,), at the origin of the frame [N, N m]


class Load(NamedTuple):
    """Total of applied forces at one configuration."""

    torque: Array  # (nv,) sum_f J_f^T f [N, N m]
    size: Array  # (nv,) sum_f |J_f|^T |f|: of which rounding is a share [N, N m]
    # the same forces on the joints that carry the frames, in the axes of these
    wrenches: tuple[tuple[int, Any], ...]
    forces: tuple[AppliedForce, ...]  # those that they are

    def added_to(self, wrenches: Any) -> Any:
        """Return the wrenches on the joints plus those of the load."""
        total = pin.StdVec_Force(wrenches)
        for joint, wrench in self.wrenches:
            total[joint] += wrench
        return total


class Loads:
    """Forces on the frames of one robot, or of any machine with frames; the data is written to."""

    def __init__(self, robot: FramedModel, model: Any, data: Any) -> None:
        self._robot, self.model, self.data = robot, model, data
        self._places: dict[str, ForceSite] = {}  # to look through all frames takes its time

    @cached_property
    def turning(self) -> frozenset[int]:
        """Joints whose axes turn with their own q."""
        return frozenset(joints_with_turning_axes(self.model))

    def place(self, name: str) -> ForceSite:
        """Return the joint and the placement of a frame on a moving body."""
        if name not in self._places:
            joint, placement = self._robot.frame(name)
            if joint == 0:
                raise InvalidArgument(
                    f"force on {name!r}: this frame belongs to the world, which does not move; a "
                    "frame of a body is needed"
                )
            self._places[name] = ForceSite(joint, placement)
        return self._places[name]

    def bind(self, forces: Sequence[AppliedForce]) -> tuple[PointForce, ...]:
        """Return constant forces bound to the model."""
        return tuple(
            PointForce(self.place(each.frame), each.frame_of == "world", _six(each.numbers))
            for each in forces
        )

    def at(self, q: Array, forces: Sequence[AppliedForce]) -> Load:
        """Return the load of constant forces at q."""
        model, data = self.model, self.data
        algorithms(data).computeJointJacobians(model, data, q)
        torque, size, wrenches = np.zeros(model.nv), np.zeros(model.nv), []
        for (joint, placement), in_world, wrench in self.bind(forces):
            axes = ALIGNED if in_world else LOCAL
            J = frame_jacobian(model, data, joint, placement, axes)
            torque += J.T @ wrench
            size += np.abs(J.T) @ np.abs(wrench)
            if in_world:
                wrench = in_axes((data.oMi[joint] * placement).rotation, wrench)
            wrenches.append((joint, placement.act(pin.Force(wrench))))
        return Load(torque, size, tuple(wrenches), tuple(forces))


def frame_jacobian(model: Any, data: Any, joint: int, placement: Any, axes: Any) -> Array:
    """Jacobian (6, nv) of a frame, after `pin.computeJointJacobians`."""
    J = algorithms(data).getFrameJacobian(model, data, joint, placement, axes)
    # a single column comes as a vector
    return J if J.ndim == 2 else J[:, None]  # type: ignore[no-any-return]


def in_axes(R: Array, wrench: Array) -> Array:
    """Wrench (6,) of the world in axes turned by R."""
    return np.asarray(wrench.reshape(2, 3) @ R).ravel()


def _six(force: Array) -> Array:
    """Force as a wrench (6,)."""
    return force if len(force) == 6 else np.concatenate([force, np.zeros(3)])
