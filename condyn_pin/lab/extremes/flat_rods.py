"""Delta with locked arms, its rods near to one plane."""

import math

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.dynamics.scene import Scene
from condyn_pin.io.load import load_robot
from condyn_pin.lab.extremes.base import Case, Rng, closed, extreme, posed, powers

# [m]: from the middle to an arm's axis less the radius of the platform, an arm, a rod
_BASE, _ARM, _ROD = 0.2 - 0.06, 0.25, 0.5
_CENTRE = pin.SE3(np.eye(3), np.array([-0.06, 0.05, 0.0]))  # of the platform, in its ball's frame


@extreme(0.1, *powers(-2, -12, -1), 0.0)
def flat_rods(severity: float, rng: Rng) -> Case:
    """Distance of Delta's platform from the plane of its elbows, arms locked [m].

    Three rods that are not in one plane hold the platform still. In one plane they do not: it can
    move across it.
    """
    delta = load_robot("delta")
    scene, (angle, centre) = closed(delta), _flattened(severity)
    q, _ = scene.state()
    q[delta.model.joints[delta.model.getJointId("motor1")].idx_q] = angle
    q = posed(delta, q, _CENTRE, pin.SE3(np.eye(3), centre))
    locked = scene.lock(delta.actuated, q=q)
    q, v = locked.state()
    tau = rng.normal(size=locked.robot.nv)
    right = (np.zeros(locked.robot.nv),) if severity > 1e-7 else ()
    return Case(Scene(locked.robot, locked.constraints), q, v, tau, right)


def _flattened(d: float) -> tuple[float, Array]:
    """Return the angle of the first arm, the others level, and where the platform is then.

    Elbows are counted as if the platform were a point: three rods of length l meet in it, on the
    axis of the circle through the elbows, whose radius is R = (l^2 - d^2)^(1/2). The first elbow is
    nearer than R to the middle of the others, so this arm is folded inwards.
    """
    R = math.sqrt(_ROD**2 - d**2)
    level = _BASE + _ARM
    half = level * math.sqrt(3) / 2  # of the distance between the two level elbows
    high = R - math.sqrt(R**2 - half**2)  # of the first elbow above the line between them
    far = _BASE + level / 2  # from the first arm's axis to that line
    cosine = (high**2 - far**2 - _ARM**2) / (2 * far * _ARM)
    angle = math.acos(cosine)  # positive is down
    middle = np.array([-level / 2, 0.0, 0.0])
    elbow = np.array([_BASE + _ARM * cosine, 0.0, -_ARM * math.sin(angle)])
    along = (middle - elbow) / high
    across = np.array([along[2], 0.0, -along[0]])
    return angle, elbow + R * along + d * across
