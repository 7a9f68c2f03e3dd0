"""Mechanisms in space: Bricard's loop, Stewart's platform, a Delta robot."""

from __future__ import annotations

from math import acos, asin, atan2, cos, hypot, pi, sin

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
    mechanism,
    on_circle,
    plate,
    quaternion_about,
    round_rod,
    square_rod,
)
from condyn_pin.model.robot import Robot
from condyn_pin.model.tree import DrawnJoint

_LEVER = 0.5  # [m]


@mechanism
def bricard() -> Robot:
    """Return Bricard's loop of six hinges, each across the next: mobility 1, where counting says 0.

    Five rods of 1 m, 1 kg and 0.1 x 0.1 m along edges of a cube. With a and b the angles of the odd
    and of the even hinges,

        sin(b) = -sin(a) / (1 + sin(a)).

    At the posture ``home`` all are zero, as drawn; at ``half``, a = 90 deg and b = -30 deg.

    Returns
    -------
    Robot
        Five joints, two ball loops, one motor.

    Notes
    -----
    The sixth hinge is cut, and closed by two balls on its axis, 0.5 m to each side, for MuJoCo has
    no other: 6 rows of rank 4. They span what the 5 rows of a hinge span, and are as well
    conditioned: J M⁻¹ Jᵀ without its zeros has a condition number of 13 to 30 along the motion,
    that of a hinge 22 to 24, that of two points 50 mm to each side 800 to 1800.

    Source: problem A04 of the IFToMM library of computational benchmark problems, with its y axis
    turned up: its axes are (x, z, -y) here.
    """
    made, parent = Machine("bricard"), "base"
    points = np.array([0 * X, X, X - Z, X - Y - Z, -Y - Z, -Y])
    axes = Z, -Y, X, Z, -Y
    for k, (start, end, axis) in enumerate(zip(points, points[1:], axes, strict=False), start=1):
        R = axes_along(end - start, axis)
        rod = square_rod(1.0, 1.0, 0.1)
        made.body(f"rod{k}", parent, start, R, hinge(f"theta{k}", R.T @ axis), rod)
        parent = f"rod{k}"
    for name, sign in (("near", -1), ("far", 1)):
        made.connect(f"hinge_{name}", "rod5", "base", points[5] + sign * _LEVER * X)
    a = pi / 2
    b = asin(-sin(a) / (1 + sin(a)))
    half = {f"theta{k}": (b, a)[k % 2] for k in range(1, 6)}
    return made.robot({"home": {}, "half": half}, "theta1")


_BASE_RADIUS, _TOP_RADIUS, _HEIGHT = 0.5, 0.3, 0.6  # [m]
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
        foot = _BASE_RADIUS * on_circle(third + side * _HALF_GAP)
        head = centre + _TOP_RADIUS * on_circle(third + side * (pi / 3 - _HALF_GAP))
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
            ball, disc = (
                DrawnJoint("platform_ball", "ball"),
                plate(_TOP_RADIUS, 0.03, 5.0, centre - head),
            )
            made.body("platform", "piston1", head, np.eye(3), ball, disc)
            made.mark("platform_centre", "platform", centre)
            lifted["platform_ball"] = quaternion_about(R[:, 1], steeper)
        else:
            made.connect(f"ball{k}", f"piston{k}", "platform", head)
    return made.robot({"home": {}, "lifted": lifted}, *(f"leg{k}" for k in range(1, 7)))


_MOTORS_RADIUS, _PLATE_RADIUS, _ARM, _LENGTH, _HALF_WIDTH = 0.2, 0.06, 0.25, 0.5, 0.05  # [m]
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
        elbow = (_MOTORS_RADIUS + _ARM) * e
        along_rod = cos(beta) * e - sin(beta) * Z
        R_arm, R_rod = axes_along(e, t), axes_along(along_rod, t)
        arm = round_rod(_ARM, 0.4, 0.015)
        made.body(f"arm{k}", "base", _MOTORS_RADIUS * e, R_arm, hinge(f"motor{k}", Y), arm)
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
                disc = plate(_PLATE_RADIUS, 0.01, 0.3, head[2] * Z - head)
                made.body("platform", "rod1a", head, np.eye(3), ball, disc)
                made.mark("platform_centre", "platform", head[2] * Z)
                low["platform_ball"] = quaternion_about(t, -pitch)
            else:
                made.connect(f"ball{name}", f"rod{name}", "platform", head)
    return made.robot({"home": {}, "low": low}, "motor1", "motor2", "motor3")


def _slope(alpha: float) -> float:
    """Slope beta of the rods at the arm angle alpha [rad]."""
    return acos((_PLATE_RADIUS - _MOTORS_RADIUS - _ARM * cos(alpha)) / _LENGTH)
