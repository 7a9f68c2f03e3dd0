"""The posture: joints go to where they are in a configuration."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import checked_names, normalised
from condyn_pin._core.arrays import Array, entries, finite
from condyn_pin._core.models import indices
from condyn_pin.control.tasks.task import (
    BoundTask,
    DefaultReference,
    RobotMotion,
    Tracking,
    entry_names,
)
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import InvalidArgument, unknown_name
from condyn_pin.model.robot import Robot


@dataclass(frozen=True)
class Posture(Tracking):
    """Joints follow a configuration of the whole robot: a row for each degree of freedom.

    Parameters
    ----------
    posture : str or (nq,) array_like, optional
        Name of a posture of the robot, or a configuration [rad, m]; by default the first posture
        of the robot with its loops closed.
    reference : callable, optional
        In its place a function of t that returns (q, v, a), of sizes nq, nv and nv.
    joints : sequence of str, optional
        Those that follow; by default the joints with a motor.

    Raises
    ------
    InvalidArgument
        If a posture and a reference are both given, or the reference is no function of t.
    """

    unit: ClassVar[str] = "rad/s^2, m/s^2"

    posture: Any = None
    joints: Sequence[str] | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        if self.reference is not None and (
            self.posture is not None or not callable(self.reference)
        ):
            raise InvalidArgument("reference: it has to be a function of t, without a posture")
        if self.posture is not None and not isinstance(self.posture, str):
            q = finite("posture", self.posture, np.shape(self.posture))
            object.__setattr__(self, "posture", tuple(q.tolist()))
        if self.joints is not None and not isinstance(self.joints, str):
            object.__setattr__(self, "joints", tuple(self.joints))
        if self.a is not None:
            raise InvalidArgument("a: a posture is a reference; JointTask takes an acceleration")
        super().__post_init__()

    def at(self, t: float) -> Posture:
        """Return the task of standing at its posture at a time [s]."""
        q = self.posture if self.reference is None else self.reference(t)[0]
        return replace(self, posture=q, reference=None, kp=1.0, kd=0.0)

    def bind(self, scene: Scene, home: DefaultReference) -> BoundTask:
        """Return the task bound to a scene; by default joints stay where they are at `home`."""
        robot = scene.robot
        chosen = robot.motor_joints if self.joints is None else self.joints
        joints = checked_names("joints", chosen, robot.joints, "joint")
        if not joints:
            raise InvalidArgument(f"joints: {robot.name} names no motors: pass joints=[...]")
        columns = indices(robot.model, joints)[1]
        J, some = np.eye(robot.nv)[columns], entries(columns)

        def goal(reference: Any) -> Array:
            return normalised(robot.model, "reference", reference)

        def left(reference: Any) -> Callable[[Array], Array]:
            q_r = goal(reference)
            return lambda q: np.asarray(pin.difference(robot.unedited, q, q_r))

        def start() -> Any:
            return self._configuration(robot, home)

        wanted = self._feedback(robot.nv, start, left)

        def rows(motion: RobotMotion, t: float) -> tuple[Array, Array]:
            return J, wanted(motion.q, motion.v, t)[some]

        names = self._row_names(entry_names(robot.model, columns))
        sizes = robot.model.nq, robot.nv
        compiled = self._compiled("posture", sizes, start, goal, columns=tuple(columns.tolist()))
        return self._chosen(BoundTask("accelerations", names, self.unit, rows, compiled, J))

    def _configuration(self, robot: Robot, home: DefaultReference) -> Any:
        """Return the posture (nq,)."""
        if self.posture is None:
            return home()
        if not isinstance(self.posture, str):
            return normalised(robot.model, "posture", self.posture)
        if self.posture not in robot.postures:
            raise unknown_name("posture", self.posture, robot.postures)
        return robot.postures[self.posture]
