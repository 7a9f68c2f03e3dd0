"""A five-bar: two driven cranks on the ground, joined at the tip."""

from __future__ import annotations

from math import acos, cos, pi

from condyn_pin.model.mechanisms.machine import Machine, X, Y, hinge, in_plane, round_rod
from condyn_pin.model.mechanisms.registry import mechanism
from condyn_pin.model.robot import Robot

_HALF_GROUND, _CRANK, _DISTAL = 0.1, 0.2, 0.3  # [m]


@mechanism
def five_bar() -> Robot:
    """Return two cranks, each with a rod, joined at the tip in the world's x-z plane: mobility 2.

    With the left crank at theta, the elbows are at x = -+e and the left rod is at phi,

        e = half_ground - crank cos(theta),    cos(phi) = e / distal.

    Cranks of 0.2 m and 0.4 kg, rods of 0.3 m and 0.3 kg, pivots 0.2 m apart. Drawn, and at the
    posture ``home``, the cranks lean outwards by 30 deg; at ``upright`` they are vertical.

    Returns
    -------
    Robot
        Four joints, a ball loop, two motors.

    Notes
    -----
    All axes are parallel: the row of the ball along y is redundant, always, and the rank 2.
    ``Loop("tip_a", "tip_b", "planar", axis="y")`` is the same closure without it.
    """
    theta, phi = _angles(2 * pi / 3)
    new_theta, new_phi = _angles(pi / 2)
    made, upright = Machine("five_bar"), {}
    for side, sign in (("left", 1), ("right", -1)):
        pivot = -sign * _HALF_GROUND * X
        at_crank, at_rod = (in_plane(a if sign > 0 else pi - a) for a in (theta, phi))
        elbow = pivot + _CRANK * at_crank[:, 0]
        motor, bend = hinge(f"{side}_motor", -Y), hinge(f"{side}_elbow", -Y)
        crank, rod = round_rod(_CRANK, 0.4, 0.01), round_rod(_DISTAL, 0.3, 0.008)
        made.body(f"{side}_crank", "base", pivot, at_crank, motor, crank)
        made.body(f"{side}_rod", f"{side}_crank", elbow, at_rod, bend, rod)
        upright[f"{side}_motor"] = sign * (new_theta - theta)
        upright[f"{side}_elbow"] = sign * (new_phi - phi - new_theta + theta)
    made.connect("tip", "left_rod", "right_rod", elbow + _DISTAL * at_rod[:, 0])
    return made.robot({"home": {}, "upright": upright}, "left_motor", "right_motor")


def _angles(theta: float) -> tuple[float, float]:
    """Return the angles of the left crank and of its rod."""
    return theta, acos((_HALF_GROUND - _CRANK * cos(theta)) / _DISTAL)
