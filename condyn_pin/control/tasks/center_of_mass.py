"""The centre of mass: J_com a + Jdot v."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array, finite
from condyn_pin._core.models import whole_data
from condyn_pin.control.tasks.task import (
    BoundTask,
    DefaultReference,
    RobotMotion,
    Tracking,
    difference,
)
from condyn_pin.dynamics.scene import Scene


@dataclass(frozen=True)
class CenterOfMass(Tracking):
    """The centre of mass follows a point of the world: 3 rows.

    a_wanted = a_r + kp (x_r - x) + kd (v_r - v)

    Parameters
    ----------
    reference : (3,) array_like or callable, optional
        In the world [m], or a function of t that returns (x, v, a). By default where it is in the
        first posture of the robot.
    """

    def _value(self, reference: Any) -> Any:
        return tuple(finite("reference", reference, 3).tolist())

    def bind(self, scene: Scene, home: DefaultReference) -> BoundTask:
        """Return the task bound to a scene; by default it stays where it is at `home`."""
        model = scene.robot.unedited

        def start() -> Array:
            data = whole_data(model)  # what Pinocchio returns is in there
            return np.array(pin.centerOfMass(model, data, home()))

        wanted = self._feedback(3, start, difference)

        def rows(motion: RobotMotion, t: float) -> tuple[Array, Array]:
            now = motion.center_of_mass()
            return now.J, wanted(now.x, now.v, t) - now.drift

        compiled = self._compiled("center of mass", (3, 3), start, np.array)
        return self._chosen(
            BoundTask("accelerations", self._row_names("xyz"), self.unit, rows, compiled)
        )
