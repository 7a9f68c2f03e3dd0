"""A thin rod with balls at both ends between two heavy bodies."""

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin.constraints.loop import Loop
from condyn_pin.dynamics.scene import Scene
from condyn_pin.lab.extremes.base import Case, Rng, extreme, one_joint
from condyn_pin.model.mechanisms.base import along_x
from condyn_pin.model.robot import Robot


@extreme(1.0, 1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-9, 1e-12, 1e-15, 0.0)
def light_rod(severity: float, rng: Rng) -> Case:
    """Mass of a rod of 2 mm across that joins two arms of 10 kg [kg].

    Nothing keeps it from spinning about itself, with an inertia of m r^2 / 2.
    """
    arm = pin.Inertia(10.0, np.array([0.25, 0.0, 0.0]), np.diag([0.01, 0.2, 0.2]))
    model = one_joint("left", pin.JointModelRY(), arm)
    link = model.addJoint(1, pin.JointModelSpherical(), along_x(0.5), "rod")
    across = severity * (0.4**2 / 12 + 1e-6 / 4)
    about = np.diag([severity * 1e-6 / 2, across, across])
    thin = pin.Inertia(severity, np.array([0.2, 0.0, 0.0]), about)
    model.appendBodyToJoint(link, thin, pin.SE3.Identity())
    model.addFrame(pin.Frame("rod_tip", link, 0, along_x(0.4), pin.FrameType.OP_FRAME))
    right = model.addJoint(0, pin.JointModelRZ(), along_x(0.9), "right")
    lever = pin.SE3(np.eye(3), np.array([0.0, 0.3, 0.0]))
    model.appendBodyToJoint(right, arm, lever)
    model.addFrame(pin.Frame("arm", right, 0, lever, pin.FrameType.OP_FRAME))
    q = np.array([0.3, 0.0, 0.0, 0.0, 1.0, -0.5])
    robot = Robot("arms on a rod", model, postures={"open": q}, actuated=("left", "right"))
    scene = Scene(robot, [Loop("rod_tip", "arm", name="tip")])
    q, v = scene.sample(rng)
    tau = np.zeros(5)
    tau[[0, 4]] = 10.0 * rng.normal(size=2)
    return Case(scene, q, v, tau)
