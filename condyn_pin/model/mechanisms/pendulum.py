"""A pendulum: the smallest robot."""

from __future__ import annotations

import math

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin.constraints.constraint import check_positive
from condyn_pin.model.mechanisms.registry import LICENCE, mechanism, source
from condyn_pin.model.robot import Robot


@mechanism
def pendulum(*, length: float = 1.0, mass: float = 1.0) -> Robot:
    """Return a point mass on a massless rod that turns about the world's y axis.

    theta'' = -(g / length) sin(theta), with theta = 0 hanging.

    Parameters
    ----------
    length : float
        Length of the rod [m].
    mass : float
        Mass at its end [kg].

    Returns
    -------
    Robot
        One joint.

    Raises
    ------
    InvalidArgument
        If a size is not a positive number.
    """
    check_positive(length=length, mass=mass)
    model = pin.Model()
    model.name = "pendulum"
    joint = model.addJoint(0, pin.JointModelRY(), pin.SE3.Identity(), "pivot")
    tip = pin.SE3(np.eye(3), np.array([0.0, 0.0, -length]))
    model.appendBodyToJoint(joint, pin.Inertia(mass, np.zeros(3), np.zeros((3, 3))), tip)
    model.addFrame(pin.Frame("tip", joint, 0, tip, pin.FrameType.OP_FRAME))
    return Robot(
        "pendulum",
        model,
        postures={"hanging": np.zeros(1), "horizontal": np.array([math.pi / 2])},
        actuated=("pivot",),
        source=source("pendulum"),
        licence=LICENCE,
    )
