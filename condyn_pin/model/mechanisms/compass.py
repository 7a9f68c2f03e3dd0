"""Two legs and a hip that walk down a slope: the compass walker."""

from __future__ import annotations

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import finite
from condyn_pin.constraints.constraint import check_positive
from condyn_pin.constraints.point_contact import PointContact
from condyn_pin.model.mechanisms.registry import LICENCE, source
from condyn_pin.model.robot import Robot


def compass_walker(
    *, slope: float = 0.05, length: float = 1.0, hip: float = 10.0, leg: float = 5.0
) -> Robot:
    """Return two legs on a hip that walk down a slope without a motor.

    q = (x, z, left, right): the hip along and off the ground, and the angles of the legs from the
    normal of the slope, positive where the foot is behind. Legs have their mass in the middle. The
    foot that swings is on the ground where

        left + right = 0,

    and where both legs are side by side: there it has to be lifted, which is not modelled.

    Parameters
    ----------
    slope : float
        Of the ground, down towards x: gravity is inclined by it [rad].
    length : float
        Of a leg [m].
    hip, leg : float
        Masses [kg].

    Returns
    -------
    Robot
        Its feet are ready-made contacts: a scene has one of them.

    Raises
    ------
    InvalidArgument
        If a size is not a positive number.

    References
    ----------
    Goswami, Thuilot, Espiau. A study of the passive gait of a compass-like biped robot: symmetry
    and chaos. International Journal of Robotics Research 17, 1998.
    """
    check_positive(length=length, hip=hip, leg=leg)
    incline = float(finite("slope", slope, ()))
    model = pin.Model()
    model.name = "compass_walker"
    here, joint = pin.SE3.Identity(), 0
    for name, kind in (("x", pin.JointModelPX()), ("z", pin.JointModelPZ())):
        joint = model.addJoint(joint, kind, here, name)
    model.appendBodyToJoint(joint, _lump(hip, 0.0), here)
    for name in ("left", "right"):
        on = model.addJoint(joint, pin.JointModelRY(), here, name)
        model.appendBodyToJoint(on, _lump(leg, length / 2), here)
        foot = pin.SE3(np.eye(3), np.array([0.0, 0.0, -length]))
        model.addFrame(pin.Frame(f"{name}_foot", on, 0, foot, pin.FrameType.OP_FRAME))
    model.gravity.linear = 9.81 * np.array([np.sin(incline), 0.0, -np.cos(incline)])
    return Robot(
        "compass_walker",
        model,
        postures={"upright": np.array([0.0, length, 0.0, 0.0])},
        contacts=(PointContact("left_foot"), PointContact("right_foot")),
        source=source("compass"),
        licence=LICENCE,
    )


def _lump(mass: float, below: float) -> object:
    """Return a point mass below a joint."""
    return pin.Inertia(mass, np.array([0.0, 0.0, -below]), np.zeros((3, 3)))
