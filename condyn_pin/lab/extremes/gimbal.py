"""Euler angles near their gimbal lock."""

from __future__ import annotations

import math

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin.constraints.point_contact import PointContact
from condyn_pin.dynamics.scene import Scene
from condyn_pin.lab.extremes.base import Case, extreme, powers
from condyn_pin.model.robot import Robot


@extreme(severities=(1.0, *powers(-1, -10, -1), 0.0))
def gimbal(severity: float, rng: np.random.Generator) -> Case:
    """How far a top in Euler angles is from the lock of two of them [rad].

    cond(M) grows as 1 / distance^2, and so do the accelerations.
    """
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelSphericalZYX(), pin.SE3.Identity(), "turn")
    body = pin.Inertia(1.0, np.array([0.1, 0.2, 0.3]), np.diag([0.1, 0.2, 0.25]))
    model.appendBodyToJoint(joint, body, pin.SE3.Identity())
    tip = pin.SE3(np.eye(3), np.array([0.3, 0.1, 0.2]))
    model.addFrame(pin.Frame("tip", joint, 0, tip, pin.FrameType.OP_FRAME))
    scene = Scene(Robot("top", model), [PointContact("tip")])
    q = np.array([0.4, math.pi / 2 - severity, 0.3])
    return Case(scene, q, np.zeros(3), rng.normal(size=3))
