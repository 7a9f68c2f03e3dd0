"""The same robot with other inertial parameters."""

from __future__ import annotations

from dataclasses import replace

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.model.robot import Robot


def weighing(robot: Robot, inertias: Array) -> Robot:
    """Return the robot with other inertial parameters (bodies, 10).

    InvalidModel if no body has them.
    """
    model = pin.Model(robot.unedited)
    for i, pi in enumerate(inertias, start=1):
        if pi.any():
            model.inertias[i] = pin.Inertia.FromDynamicParameters(pi)
        else:  # a joint that carries nothing has no centre
            model.inertias[i] = pin.Inertia.Zero()
    return replace(robot, model=model)
