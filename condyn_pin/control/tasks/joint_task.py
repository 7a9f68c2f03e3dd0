"""One joint, such as a hinge that follows an angle."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from condyn_pin._core.arguments import checked_names
from condyn_pin._core.arrays import Array, finite
from condyn_pin._core.models import indices
from condyn_pin.constraints.constraint import text
from condyn_pin.control.tasks.task import (
    BoundTask,
    DefaultReference,
    RobotMotion,
    Tracking,
    difference,
)
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import InvalidArgument


@dataclass(frozen=True)
class JointTask(Tracking):
    """A joint with one degree of freedom follows an angle or a length: 1 row.

    a_wanted = a_r + kp (x_r - x) + kd (v_r - v)

    Parameters
    ----------
    joint : str
        Name of a joint of the robot.
    reference : float or callable, optional
        [rad, m], or a function of t that returns (x, v, a). By default where the joint is in the
        first posture of the robot.

    Raises
    ------
    InvalidArgument
        If `joint` is no name.
    """

    unit: ClassVar[str] = "rad/s^2, m/s^2"

    joint: str

    def __post_init__(self) -> None:
        text("joint", self.joint, "joint")
        super().__post_init__()

    @property
    def _called(self) -> str:
        return self.joint

    def _value(self, reference: Any) -> Any:
        one = reference[0] if np.shape(reference) == (1,) else reference  # that of a path
        return float(finite("reference", one, ()))

    def bind(self, scene: Scene, home: DefaultReference) -> BoundTask:
        """Return the task bound to a scene; by default the joint stays where it is at `home`."""
        model = scene.robot.model
        checked_names("joint", [self.joint], scene.robot.joints, "joint")
        in_q, in_v = indices(model, [self.joint])
        if (len(in_q), len(in_v)) != (1, 1):
            raise InvalidArgument(
                f"joint = {self.joint!r}: it has {len(in_v)} degrees of freedom; "
                f"Posture(joints=[{self.joint!r}]) takes it"
            )
        i, k = int(in_q[0]), int(in_v[0])
        J = np.eye(model.nv)[k : k + 1]

        def start() -> Array:
            return home()[i : i + 1]

        wanted = self._feedback(1, start, difference)

        def rows(motion: RobotMotion, t: float) -> tuple[Array, Array]:
            return J, wanted(motion.q[i : i + 1], motion.v[k : k + 1], t)

        compiled = self._compiled("joint", (1, 1), start, np.atleast_1d, at=i, columns=(k,))
        return self._chosen(BoundTask("accelerations", (self.name,), self.unit, rows, compiled, J))
