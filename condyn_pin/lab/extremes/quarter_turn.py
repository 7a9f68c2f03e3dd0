"""Stewart's platform with locked legs, near a quarter of a turn."""

from __future__ import annotations

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.loop import Loop
from condyn_pin.dynamics.scene import Scene
from condyn_pin.io.load import load_robot
from condyn_pin.lab.extremes.base import Case, extreme, powers
from condyn_pin.model.robot import Robot


@extreme(severities=(1.0, *powers(-1, -12, -1), 0.0))
def quarter_turn(severity: float, rng: np.random.Generator) -> Case:
    """Angle of Stewart's platform from a quarter of a turn about the vertical [rad].

    Six locked legs hold it still. Turned by a right angle, they do not: it can move up and turn on.
    """
    stewart = load_robot("stewart")
    q = _turned(stewart, np.pi / 2 - severity)
    locked = Scene(stewart, stewart.loops).lock(stewart.actuated, q=q)
    q, v = locked.state()
    tau = rng.normal(size=locked.robot.nv)
    right = (np.zeros(locked.robot.nv),) if severity > 1e-6 else ()
    return Case(Scene(locked.robot, locked.constraints), q, v, tau, right)


def _turned(stewart: Robot, angle: float) -> Array:
    """Return q with the platform turned about the vertical, at its own height."""
    q, _ = Scene(stewart, stewart.loops).state()
    data = stewart.model.createData()
    pin.forwardKinematics(stewart.model, data, q)
    centre = data.oMi[stewart.model.getJointId("platform_ball")].inverse()
    there = stewart.with_frame("there", "world", np.zeros(3), pin.rpy.rpyToMatrix(0, 0, angle))
    both = there.with_frame("centre", "platform", centre.translation, centre.rotation)
    posed = Scene(both, [*both.loops, Loop("there", "centre", "weld", name="pose")])
    return posed.assemble(q, within_limits=False, branch={}).q
