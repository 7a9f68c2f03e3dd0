"""A unicycle: an upright wheel that is driven and steered."""

from __future__ import annotations

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin.constraints.constraint_fields import check_positive
from condyn_pin.constraints.rolling_wheel import RollingWheel
from condyn_pin.model.mechanisms.base import LICENCE, disc, mechanism, source
from condyn_pin.model.robot import Robot


@mechanism
def unicycle(*, radius: float = 0.3, mass: float = 2.0) -> Robot:
    """Return an upright disc on a level plane, with motors about the vertical and the axle.

    q = (x, y, heading, roll). With A = mass radius^2 / 4 and C = mass radius^2 / 2,

        A heading'' = tau_heading,    (C + mass radius^2) roll'' = tau_roll,
        x' = radius roll' cos(heading),    y' = radius roll' sin(heading).

    Two directions of motion lead to every (x, y, heading, roll): it parks.

    Parameters
    ----------
    radius : float
        [m].
    mass : float
        [kg].

    Returns
    -------
    Robot
        Four joints and its ready-made wheel.

    Raises
    ------
    InvalidArgument
        If a size is not a positive number.

    Notes
    -----
    Its wheel is among the ready-made contacts: ``Scene(robot, robot.contacts)``.
    """
    check_positive(radius=radius, mass=mass)
    model = pin.Model()
    model.name = "unicycle"
    up = pin.SE3(np.eye(3), np.array([0.0, 0.0, radius]))
    joint = 0
    for name, kind in (
        ("x", pin.JointModelPX()),
        ("y", pin.JointModelPY()),
        ("heading", pin.JointModelRZ()),
        ("roll", pin.JointModelRY()),
    ):
        joint = model.addJoint(joint, kind, up if name == "x" else pin.SE3.Identity(), name)
    model.appendBodyToJoint(joint, disc(radius, mass), pin.SE3.Identity())
    model.addFrame(pin.Frame("wheel", joint, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    return Robot(
        "unicycle",
        model,
        postures={"origin": np.zeros(4)},
        contacts=(RollingWheel("wheel", radius, holds=("rolling", "lateral")),),
        actuated=("heading", "roll"),
        source=source("unicycle"),
        licence=LICENCE,
    )
