"""Mechanisms in space: a Stewart platform, a Delta robot and Bricard's loop."""

from __future__ import annotations

from math import acos, asin, atan2, cos, hypot, pi, sin

import numpy as np
from numpy.typing import ArrayLike
from writing.mjcf import (
    Mjcf,
    X,
    Y,
    Z,
    along,
    ball,
    disc,
    hinge,
    rod,
    round_body,
    slide,
    square_rod,
    turn,
)


def stewart(
    base: float = 0.5,
    top: float = 0.3,
    height: float = 0.6,
    half_gap: float = 0.25,
    lift: float = 0.1,
    stroke: float = 0.2,
) -> Mjcf:
    """Write a platform on six legs, each a universal joint, a slider and a ball: mobility 6.

    The legs stand in pairs, at +-half_gap [rad] about three directions 120 deg apart on the base;
    on the platform they meet in other pairs. All are r wide and h high, L = hypot(r, h). To lift
    the level platform by d, each leg gets longer by hypot(r, h + d) - L and steeper by
    atan2(h + d, r) - atan2(h, r), about its first axis, which is level. They change
    by up to +-stroke [m].
    """
    made = Mjcf("stewart")
    centre = height * Z
    lifted: dict[str, ArrayLike] = {}
    for i in range(6):
        third, side = 2 * pi / 3 * (i // 2), (-1) ** (i + 1)
        foot = base * _on_circle(third + side * half_gap)
        head = centre + top * _on_circle(third + side * (pi / 3 - half_gap))
        leg = head - foot
        L, r, k = float(np.linalg.norm(leg)), hypot(*leg[:2]), i + 1
        R = along(leg, np.cross(Z, leg))
        tilt, swing = hinge(f"tilt{k}", Y), hinge(f"swing{k}", Z)
        motor = slide(f"leg{k}", X, (-stroke, stroke))
        made.body(f"cross{k}", "base", foot, R, tilt, round_body(0.02, 0.05))
        made.body(f"cylinder{k}", f"cross{k}", foot, R, swing, rod(L / 2, 1.0, 0.03))
        made.body(f"piston{k}", f"cylinder{k}", (foot + head) / 2, R, motor, rod(L / 2, 0.5, 0.02))
        steeper = atan2(height + lift, r) - atan2(height, r)
        lifted |= {f"tilt{k}": -steeper, f"leg{k}": hypot(r, height + lift) - L}
        if i == 0:
            plate = disc(top, 0.03, 5.0, centre - head)
            made.body("platform", "piston1", head, np.eye(3), ball("platform_ball"), plate)
            lifted["platform_ball"] = turn(R[:, 1], steeper)
        else:
            made.connect(f"ball{k}", f"piston{k}", "platform", head)
    made.motors(*(f"leg{k}" for k in range(1, 7)))
    made.posture("home", {})
    made.posture("lifted", lifted)
    return made


def delta(
    base: float = 0.2,
    top: float = 0.06,
    arm: float = 0.25,
    length: float = 0.5,
    half_width: float = 0.05,
    lowered: float = 0.5,
) -> Mjcf:
    """Write a platform that three parallelograms keep level, each on a driven arm: mobility 3.

    Drawn with the arms level. With all arms down by alpha, the rods leave them at an angle beta
    below the outward direction,

        cos(beta) = -(base + arm cos(alpha) - top) / length.

    Each rod has a universal joint at the arm and a ball at the platform, so that it cannot spin.
    """

    def slope(alpha: float) -> float:
        return acos((top - base - arm * cos(alpha)) / length)

    made = Mjcf("delta")
    beta = slope(0.0)
    pitch = slope(lowered) - beta
    low: dict[str, ArrayLike] = {}
    for k in (1, 2, 3):
        e, t = (_on_circle(2 * pi / 3 * (k - 1) + a) for a in (0, pi / 2))
        elbow = (base + arm) * e
        along_rod = cos(beta) * e - sin(beta) * Z
        R_arm, R_rod = along(e, t), along(along_rod, t)
        made.body(f"arm{k}", "base", base * e, R_arm, hinge(f"motor{k}", Y), rod(arm, 0.4, 0.015))
        low[f"motor{k}"] = lowered
        for side, sign in (("a", -1), ("b", 1)):
            name = f"{k}{side}"
            start = elbow + sign * half_width * t
            head = start + length * along_rod
            bend, yaw = hinge(f"pitch{name}", Y), hinge(f"yaw{name}", Z)
            made.body(f"cross{name}", f"arm{k}", start, R_rod, bend, round_body(0.01, 0.02))
            made.body(f"rod{name}", f"cross{name}", start, R_rod, yaw, rod(length, 0.1, 0.005))
            low[f"pitch{name}"] = pitch - lowered
            if name == "1a":
                middle = head[2] * Z - head
                plate = disc(top, 0.01, 0.3, middle)
                made.body("platform", "rod1a", head, np.eye(3), ball("platform_ball"), plate)
                low["platform_ball"] = turn(t, -pitch)
            else:
                made.connect(f"ball{name}", f"rod{name}", "platform", head)
    made.motors("motor1", "motor2", "motor3")
    made.posture("home", {})
    made.posture("low", low)
    return made


def bricard(lever: float = 0.5) -> Mjcf:
    """Write Bricard's loop of six hinges, each across the next: mobility 1, where counting says 0.

    Problem A04 of the IFToMM library, with its y axis up: five rods of 1 m and 1 kg along edges of
    a cube. The sixth hinge is cut, and closed by two points on its axis, `lever` to each side. With
    a and b the angles of the odd and of the even hinges,

        sin(b) = -sin(a) / (1 + sin(a)).
    """
    made = Mjcf("bricard")
    points = np.array([0 * X, X, X - Z, X - Y - Z, -Y - Z, -Y])
    axes = Z, -Y, X, Z, -Y
    parent = "base"
    for k, (start, end, axis) in enumerate(zip(points, points[1:], axes, strict=False), start=1):
        R = along(end - start, axis)
        solid = square_rod(1.0, 1.0, 0.1)
        made.body(f"rod{k}", parent, start, R, hinge(f"theta{k}", R.T @ axis), solid)
        parent = f"rod{k}"
    for name, sign in (("near", -1), ("far", 1)):
        made.connect(f"hinge_{name}", "rod5", "base", points[5] + sign * lever * X)
    made.motors("theta1")
    made.posture("home", {})
    a = pi / 2
    b = asin(-sin(a) / (1 + sin(a)))
    made.posture("half", {f"theta{k}": (b, a)[k % 2] for k in range(1, 6)})
    return made


def _on_circle(angle: float) -> np.ndarray:
    return np.array([cos(angle), sin(angle), 0])
