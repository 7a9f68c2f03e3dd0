"""Actuation: which joints have a motor, and through which gears.

With u the torques of the motors and w their speeds,

    tau = B u,    w = B^T v,

one column of B for each motor: its gear ratio in the row of its joint, zero elsewhere.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core.arguments import checked
from condyn_pin._core.arrays import Array, finite
from condyn_pin._core.joints import indices
from condyn_pin.control.motion import entry_names
from condyn_pin.dynamics.scene import Scene, check_scene
from condyn_pin.errors import InvalidArgument, unknown_name
from condyn_pin.model.robot import Robot


@dataclass(frozen=True)
class Actuation:
    """The motors of a robot; a frozen value that can be pickled and compared.

    Parameters
    ----------
    robot : Robot
    joints : sequence of str, optional
        The joints with a motor; ``robot.actuated`` by default. A joint of several degrees of
        freedom has a motor for each of them.
    ratios : sequence of float or mapping of str to float, optional
        Turns of the motor for one turn of its joint, one number for each joint or by name of the
        joint [1]; 1 where nothing is said. Of a motor that drives a slider through a screw, turns
        of the motor for a metre [rad/m].

    Raises
    ------
    UnknownName
        If there is no such joint; the text lists the nearest names.
    InvalidArgument
        If there is no motor at all, or a ratio is zero.

    Notes
    -----
    A rotor of inertia I adds ratio^2 I to the inertia of its joint. Put that into the model, as
    ``armature`` of the joint: ratios do not change the mass matrix here.
    """

    robot: Robot
    joints: Sequence[str] | None = None
    ratios: Sequence[float] | Mapping[str, float] | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.robot, Robot):
            raise InvalidArgument(f"robot = {type(self.robot).__name__}: a Robot is needed")
        chosen = self.robot.actuated if self.joints is None else self.joints
        joints = checked("joints", chosen, self.robot.joints, "joint")
        if not joints:
            raise InvalidArgument(
                f"joints: {self.robot.name} names no joint with a motor; "
                "Actuation(robot, [joint, ...]) does"
            )
        object.__setattr__(self, "joints", joints)
        object.__setattr__(self, "ratios", _ratios(joints, self.ratios))

    @cached_property
    def columns(self) -> NDArray[np.int_]:
        """Where v holds the joints of the motors, one entry a motor."""
        return indices(self.robot.model, self._joints)[1]

    @cached_property
    def gears(self) -> Array:
        """The ratio of every motor (k,)."""
        ratios: Sequence[float] = self.ratios  # type: ignore[assignment]
        return np.repeat(np.array(ratios), self._sizes)

    @cached_property
    def B(self) -> Array:
        """The map (nv, k) from motor torques to joint torques."""
        B = np.zeros((self.robot.nv, len(self.columns)))
        B[self.columns, np.arange(len(self.columns))] = self.gears
        B.flags.writeable = False
        return B

    @property
    def motors(self) -> tuple[str, ...]:
        """A name for each motor: that of its joint, numbered where a joint has several."""
        return entry_names(self.robot.model, self.columns)

    @property
    def _joints(self) -> Sequence[str]:
        return self.joints or ()

    @property
    def _sizes(self) -> list[int]:
        model = self.robot.model
        return [int(model.joints[model.getJointId(name)].nv) for name in self._joints]


def _ratios(
    joints: Sequence[str], ratios: Sequence[float] | Mapping[str, float] | None
) -> tuple[float, ...]:
    """Return one ratio for each joint."""
    if ratios is None:
        ratios = {}
    if isinstance(ratios, Mapping):
        for name in ratios:
            if name not in joints:
                raise unknown_name("joint with a motor", str(name), joints)
        ratios = [ratios.get(name, 1.0) for name in joints]
    if isinstance(ratios, str) or not isinstance(ratios, Iterable):
        raise InvalidArgument(f"ratios = {ratios!r}: numbers, or a mapping of joints, are needed")
    found = finite("ratios", list(ratios), len(joints))
    for name, ratio in zip(joints, found, strict=True):
        if ratio == 0.0:
            raise InvalidArgument(f"ratios: that of {name!r} is 0: such a motor drives nothing")
    return tuple(float(ratio) for ratio in found)


def motors_of(scene: Scene, actuation: Actuation | None) -> Actuation:
    """Return the motors that a caller chose, or those of the robot; they have to fit the scene."""
    check_scene(scene)
    if actuation is None:
        return Actuation(scene.robot)
    if not isinstance(actuation, Actuation):
        raise InvalidArgument(
            f"actuation = {actuation!r}: Actuation(robot, joints) is needed, or None"
        )
    if actuation.robot is not scene.robot and actuation.robot.model != scene.robot.model:
        raise InvalidArgument(
            f"actuation: it is made for the model of {actuation.robot.name!r}, and the scene has "
            f"another of {scene.robot.name!r}; Actuation(scene.robot, ...) fits"
        )
    return actuation
