"""Euler angles near their gimbal lock."""

import math

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin.constraints.point_contact import PointContact
from condyn_pin.dynamics.scene import Scene
from condyn_pin.lab.extremes.base import Case, Rng, extreme, one_joint, powers
from condyn_pin.model.robot import Robot


@extreme(1.0, *powers(-1, -10, -1), 0.0)
def gimbal(severity: float, rng: Rng) -> Case:
    """How far a top in Euler angles is from the lock of two of them [rad].

    cond(M) grows as 1 / distance^2, and so do the accelerations.
    """
    body = pin.Inertia(1.0, np.array([0.1, 0.2, 0.3]), np.diag([0.1, 0.2, 0.25]))
    model = one_joint("turn", pin.JointModelSphericalZYX(), body)
    tip = pin.SE3(np.eye(3), np.array([0.3, 0.1, 0.2]))
    model.addFrame(pin.Frame("tip", 1, 0, tip, pin.FrameType.OP_FRAME))
    q = np.array([0.4, math.pi / 2 - severity, 0.3])
    return Case(
        Scene(Robot("top", model), [PointContact("tip")]), q, np.zeros(3), rng.normal(size=3)
    )
