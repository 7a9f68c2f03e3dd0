"""A Delta robot: a platform kept level by three parallelograms."""

from __future__ import annotations

from math import acos, cos, pi, sin

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin.model.mechanisms.machine import (
    Machine,
    Y,
    Z,
    axes_along,
    hinge,
    lump,
    on_circle,
    plate,
    quaternion_about,
    round_rod,
)
from condyn_pin.model.mechanisms.registry import mechanism
from condyn_pin.model.robot import Robot
from condyn_pin.model.tree import DrawnJoint

_BASE, _TOP, _ARM, _LENGTH, _HALF_WIDTH = 0.2, 0.06, 0.25, 0.5, 0.05  # [m]
_LOWERED = 0.5  # [rad]


@mechanism
def delta() -> Robot:
    """Return a platform that three parallelograms keep level, each on a driven arm: mobility 3.

    Drawn with the arms level. With all arms down by alpha, the rods leave them at an angle beta
    below the outward direction,

        cos(beta) = -(base + arm cos(alpha) - top) / length.

    Arms of 0.25 m and 0.4 kg at 0.2 m from the middle, rods of 0.5 m and 0.1 kg, 0.1 m apart, a
    platform of 60 mm radius and 0.3 kg; the cross of a universal joint has 20 g. At the posture
    ``home`` all joints are zero and the platform is 0.313 m below the arms; at ``low`` the arms are
    0.5 rad down.

    Returns
    -------
    Robot
        The platform hangs on the rod ``1a`` by its ball, where its frame ``platform`` is; its
        middle is ``platform_centre``. The other five rods are cut, 3 rows each: rank 15, nothing is
        redundant. Its motors ``motor1`` to ``motor3`` are positive when lower.

    Notes
    -----
    A rod has a universal joint at the arm and a ball at the platform, so that it cannot spin about
    itself, as it could between two balls with an inertia of 1e-6 kg m^2 or none at all.
    """
    made, beta = Machine("delta"), _slope(0.0)
    pitch, low = _slope(_LOWERED) - beta, dict[str, ArrayLike]()
    for k in (1, 2, 3):
        e, t = (on_circle(2 * pi / 3 * (k - 1) + a) for a in (0, pi / 2))
        elbow = (_BASE + _ARM) * e
        along_rod = cos(beta) * e - sin(beta) * Z
        R_arm, R_rod = axes_along(e, t), axes_along(along_rod, t)
        arm = round_rod(_ARM, 0.4, 0.015)
        made.body(f"arm{k}", "base", _BASE * e, R_arm, hinge(f"motor{k}", Y), arm)
        low[f"motor{k}"] = _LOWERED
        for side, sign in (("a", -1), ("b", 1)):
            name = f"{k}{side}"
            start = elbow + sign * _HALF_WIDTH * t
            head = start + _LENGTH * along_rod
            bend, yaw = hinge(f"pitch{name}", Y), hinge(f"yaw{name}", Z)
            rod = round_rod(_LENGTH, 0.1, 0.005)
            made.body(f"cross{name}", f"arm{k}", start, R_rod, bend, lump(0.01, 0.02))
            made.body(f"rod{name}", f"cross{name}", start, R_rod, yaw, rod)
            low[f"pitch{name}"] = pitch - _LOWERED
            if name == "1a":
                ball = DrawnJoint("platform_ball", "ball")
                disc = plate(_TOP, 0.01, 0.3, head[2] * Z - head)
                made.body("platform", "rod1a", head, np.eye(3), ball, disc)
                made.mark("platform_centre", "platform", head[2] * Z)
                low["platform_ball"] = quaternion_about(t, -pitch)
            else:
                made.connect(f"ball{name}", f"rod{name}", "platform", head)
    return made.robot({"home": {}, "low": low}, "motor1", "motor2", "motor3")


def _slope(alpha: float) -> float:
    """Slope beta of the rods at the arm angle alpha [rad]."""
    return acos((_TOP - _BASE - _ARM * cos(alpha)) / _LENGTH)
