"""A Stewart platform: six driven legs."""

from __future__ import annotations

from math import atan2, hypot, pi

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin.model.mechanisms.machine import (
    Machine,
    X,
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

_BASE, _TOP, _HEIGHT = 0.5, 0.3, 0.6  # [m]
_HALF_GAP = 0.25  # [rad]
_LIFT, _STROKE = 0.1, 0.2  # [m]


@mechanism
def stewart() -> Robot:
    """Return a platform on six legs, each a universal joint, a slider and a ball: mobility 6.

    The legs stand in pairs, at +-half_gap about three directions 120 deg apart on the base; on the
    platform they meet in other pairs. All are r wide and h high, L = hypot(r, h). To lift the level
    platform by d, each leg gets longer by hypot(r, h + d) - L and steeper by
    atan2(h + d, r) - atan2(h, r), about its first axis, which is level.

    Base 0.5 m and platform 0.3 m in radius, 0.6 m apart, legs of 0.666 m with a stroke of 0.2 m
    either way. A cylinder has 1 kg, a piston 0.5 kg, the platform 5 kg, the cross of a universal
    joint 50 g: MuJoCo wants a mass on every body that moves. At the posture ``home`` all joints are
    zero, as drawn; at ``lifted`` the platform is level, 0.1 m higher.

    Returns
    -------
    Robot
        The platform hangs on the first leg by its ball, where its frame ``platform`` is; its middle
        is ``platform_centre``. The other five legs are cut, 3 rows each: rank 15, nothing is
        redundant. Its motors ``leg1`` to ``leg6`` are positive when longer.
    """
    made = Machine("stewart")
    centre, lifted = _HEIGHT * Z, dict[str, ArrayLike]()
    for i in range(6):
        third, side = 2 * pi / 3 * (i // 2), (-1) ** (i + 1)
        foot = _BASE * on_circle(third + side * _HALF_GAP)
        head = centre + _TOP * on_circle(third + side * (pi / 3 - _HALF_GAP))
        leg = head - foot
        L, r, k = float(np.linalg.norm(leg)), hypot(*leg[:2]), i + 1
        R = axes_along(leg, np.cross(Z, leg))
        tilt, swing = hinge(f"tilt{k}", Y), hinge(f"swing{k}", Z)
        motor = DrawnJoint(f"leg{k}", "slide", X, lower=-_STROKE, upper=_STROKE)
        cylinder, piston = round_rod(L / 2, 1.0, 0.03), round_rod(L / 2, 0.5, 0.02)
        made.body(f"cross{k}", "base", foot, R, tilt, lump(0.02, 0.05))
        made.body(f"cylinder{k}", f"cross{k}", foot, R, swing, cylinder)
        made.body(f"piston{k}", f"cylinder{k}", (foot + head) / 2, R, motor, piston)
        steeper = atan2(_HEIGHT + _LIFT, r) - atan2(_HEIGHT, r)
        lifted |= {f"tilt{k}": -steeper, f"leg{k}": hypot(r, _HEIGHT + _LIFT) - L}
        if i == 0:
            ball, disc = DrawnJoint("platform_ball", "ball"), plate(_TOP, 0.03, 5.0, centre - head)
            made.body("platform", "piston1", head, np.eye(3), ball, disc)
            made.mark("platform_centre", "platform", centre)
            lifted["platform_ball"] = quaternion_about(R[:, 1], steeper)
        else:
            made.connect(f"ball{k}", f"piston{k}", "platform", head)
    return made.robot({"home": {}, "lifted": lifted}, *(f"leg{k}" for k in range(1, 7)))
