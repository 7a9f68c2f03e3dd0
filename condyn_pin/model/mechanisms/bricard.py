"""Bricard's loop: overconstrained at every posture."""

from __future__ import annotations

from math import asin, pi, sin

import numpy as np

from condyn_pin.model.mechanisms.machine import Machine, X, Y, Z, axes_along, hinge, square_rod
from condyn_pin.model.mechanisms.registry import mechanism
from condyn_pin.model.robot import Robot

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
