"""Joints whose axes turn with their own angles, in motion by `Rattle`."""

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin.dynamics.scene import Scene
from condyn_pin.lab.extremes.base import Case, Flight, Rng, extreme, one_joint
from condyn_pin.model.robot import Robot
from condyn_pin.simulation.integrators.dormand_prince import DormandPrince
from condyn_pin.simulation.integrators.rattle import Rattle
from condyn_pin.simulation.run import simulate

_DURATION, _DT = 0.5, 2e-3  # [s]


@extreme(0.0, 0.1, 0.3, 1.0, 2.0, 5.0)
def turning_joints(severity: float, rng: Rng) -> Case:
    """Speed of a body on a universal joint, and of another on Euler angles at it [rad/s].

    The axis of one angle turns with another, so that their momenta are no constants of a free
    motion. The end is that of Dormand and Prince's method, at 1e-12.
    """
    x, y, _ = np.eye(3)
    body = pin.Inertia(1.0, np.array([0.1, 0.2, -0.3]), np.diag([0.1, 0.2, 0.25]))
    model = one_joint("universal", pin.JointModelUniversal(x, y), body)
    at = pin.SE3(np.eye(3), np.array([0.0, 0.1, -0.5]))
    euler = model.addJoint(1, pin.JointModelSphericalZYX(), at, "euler")
    model.appendBodyToJoint(euler, body, pin.SE3.Identity())
    scene = Scene(Robot("turning", model))
    q, v = 0.3 * rng.normal(size=5), severity * rng.uniform(0.5, 1.0, size=5)
    exact = DormandPrince(1e-12, 1e-12)
    right = simulate(scene, q, v, duration=_DURATION, dt=_DT, integrator=exact)
    flight = Flight(_DURATION, _DT, Rattle(), right.q[-1], 2e-3 * (1.0 + severity))
    return Case(scene, q, v, np.zeros(5), flight=flight)
