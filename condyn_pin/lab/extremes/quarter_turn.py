"""Stewart's platform with locked legs, near a quarter of a turn."""

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin.dynamics.scene import Scene
from condyn_pin.io.load import load_robot
from condyn_pin.lab.extremes.base import Case, Rng, closed, extreme, posed, powers


@extreme(1.0, *powers(-1, -12, -1), 0.0)
def quarter_turn(severity: float, rng: Rng) -> Case:
    """Angle of Stewart's platform from a quarter of a turn about the vertical [rad].

    Six locked legs hold it still. Turned by a right angle, they do not: it can move up and turn on.
    """
    stewart = load_robot("stewart")
    scene, data = closed(stewart), stewart.model.createData()
    q, _ = scene.state()
    pin.forwardKinematics(stewart.model, data, q)
    centre = data.oMi[stewart.model.getJointId("platform_ball")].inverse()
    turn = pin.SE3(pin.rpy.rpyToMatrix(0, 0, np.pi / 2 - severity), np.zeros(3))
    locked = scene.lock(stewart.actuated, q=posed(stewart, q, centre, turn))
    q, v = locked.state()
    tau = rng.normal(size=locked.robot.nv)
    right = (np.zeros(locked.robot.nv),) if severity > 1e-6 else ()
    return Case(Scene(locked.robot, locked.constraints), q, v, tau, right)
