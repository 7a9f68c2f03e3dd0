"""Loads: what forces on frames do to the joints of a robot.

    tau_f = J_f^T f

J_f comes from joint Jacobians, in the axes of f and at the origin of the frame. The proof of an
answer takes the same forces another way: as wrenches on the bodies, through Newton-Euler.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from condyn_pin._core._pin import LOCAL, pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.joints import turning
from condyn_pin._core.trees import algorithms
from condyn_pin.constraints.applied_force import AppliedForce
from condyn_pin.errors import InvalidArgument

if TYPE_CHECKING:
    from condyn_pin.constraints.protocols import Machine

ALIGNED = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED


class Place(NamedTuple):
    """Where a frame is: on which joint, and how."""

    joint: int
    placement: Any


class Push(NamedTuple):
    """A force bound to a model."""

    place: Place
    in_world: bool  # whether it keeps its direction in the world, or turns with the frame
    wrench: Array  # (6,), at the origin of the frame [N, N m]


class Load(NamedTuple):
    """What forces are at one configuration.

    Attributes
    ----------
    torque : (nv,) array
        sum_f J_f^T f [N, N m].
    size : (nv,) array
        sum_f |J_f|^T |f|: of which rounding is a share [N, N m].
    wrenches : tuple of (int, pin.Force)
        The same forces on the joints that carry the frames, in the axes of these.
    forces : tuple of AppliedForce
        Those that they are.
    """

    torque: Array
    size: Array
    wrenches: tuple[tuple[int, Any], ...]
    forces: tuple[AppliedForce, ...]

    def on_top_of(self, wrenches: Any) -> Any:
        """Return the wrenches on the joints with these added."""
        total = pin.StdVec_Force(wrenches)
        for joint, wrench in self.wrenches:
            total[joint] += wrench
        return total


class Loads:
    """The forces on the frames of one robot, or what has frames by name; the data is written to."""

    def __init__(self, robot: Machine, model: Any, data: Any) -> None:
        self._robot, self.model, self.data = robot, model, data
        self._places: dict[str, Place] = {}  # to look through all frames takes its time

    @cached_property
    def turning(self) -> frozenset[int]:
        """The joints whose axes turn with their own q."""
        return frozenset(turning(self.model))

    def place(self, name: str) -> Place:
        """Return where a frame is that can be pushed."""
        if name not in self._places:
            joint, placement = self._robot.frame(name)
            if joint == 0:
                raise InvalidArgument(
                    f"force on {name!r}: this frame belongs to the world, which does not move; a "
                    "frame of a body is needed"
                )
            self._places[name] = Place(joint, placement)
        return self._places[name]

    def bind(self, forces: Sequence[AppliedForce]) -> tuple[Push, ...]:
        """Return forces, all constant, bound to the model."""
        return tuple(
            Push(self.place(each.frame), each.frame_of == "world", _six(each.numbers))
            for each in forces
        )

    def at(self, q: Array, forces: Sequence[AppliedForce]) -> Load:
        """Return what forces, all constant, are at q."""
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
    """Return the Jacobian (6, nv) of a frame, after `pin.computeJointJacobians`."""
    J = algorithms(data).getFrameJacobian(model, data, joint, placement, axes)
    # a single column comes as a vector
    return J if J.ndim == 2 else J[:, None]  # type: ignore[no-any-return]


def in_axes(R: Array, wrench: Array) -> Array:
    """Return a wrench (6,) of the world in axes that are turned by R."""
    return np.asarray(wrench.reshape(2, 3) @ R).ravel()


def _six(force: Array) -> Array:
    """Return a force as a wrench (6,)."""
    return force if len(force) == 6 else np.concatenate([force, np.zeros(3)])
