"""Chaplygin's sleigh: a body on a blade, the smallest nonholonomic robot."""

from __future__ import annotations

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin.constraints.constraint_fields import check_positive
from condyn_pin.constraints.knife_edge import KnifeEdge
from condyn_pin.model.mechanisms.base import LICENCE, along_x, mechanism, source
from condyn_pin.model.robot import Robot


@mechanism
def sleigh(*, arm: float = 0.2, mass: float = 1.0, inertia: float = 0.1) -> Robot:
    """Return a body that slides on a level plane, on a blade that does not slip sideways.

    With u the speed of the blade, omega the turn rate and J = inertia + mass arm^2,

        u' = arm omega^2,    J omega' = -mass arm u omega,

    so that it ends up gliding straight, blade behind and centre of mass ahead. From the start
    u = 0, omega = W, with U = W sqrt(J / mass) and k = mass arm U / J,

        u = U tanh(k t),    omega = W / cosh(k t).

    Parameters
    ----------
    arm : float
        From the blade forward to the centre of mass [m].
    mass : float
        [kg].
    inertia : float
        About the vertical through the centre of mass [kg m^2].

    Returns
    -------
    Robot
        Three joints and its ready-made blade.

    Raises
    ------
    InvalidArgument
        If a size is not a positive number.

    Notes
    -----
    Its blade is among the ready-made contacts: ``Scene(robot, robot.contacts)``.

    References
    ----------
    Neimark, Fufaev. Dynamics of Nonholonomic Systems. American Mathematical Society, 1972.
    """
    check_positive(arm=arm, mass=mass, inertia=inertia)
    model = pin.Model()
    model.name = "sleigh"
    joint = model.addJoint(0, pin.JointModelPlanar(), pin.SE3.Identity(), "plane")
    body = pin.Inertia(mass, np.zeros(3), inertia * np.eye(3))
    model.appendBodyToJoint(joint, body, along_x(arm))
    model.addFrame(pin.Frame("blade", joint, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    return Robot(
        "sleigh",
        model,
        postures={"origin": pin.neutral(model)},
        contacts=(KnifeEdge("blade", axis="y"),),
        source=source("sleigh"),
        licence=LICENCE,
    )
