"""Mechanisms in a vertical plane: a five-bar and a parallelogram."""

from __future__ import annotations

from math import acos, cos, pi, sin

import numpy as np
from writing.mjcf import Mjcf, X, Y, along, hinge, rod


def five_bar(half_ground: float = 0.1, crank: float = 0.2, distal: float = 0.3) -> Mjcf:
    """Write two cranks, each with a rod, joined at the tip: mobility 2.

    Drawn symmetric, the cranks 30 deg from the vertical. With the left crank at theta, the elbows
    are at x = -+e and the left rod is at phi,

        e = half_ground - crank cos(theta),    cos(phi) = e / distal.
    """

    def angles(theta: float) -> tuple[float, float]:
        return theta, acos((half_ground - crank * cos(theta)) / distal)

    theta, phi = angles(2 * pi / 3)
    new_theta, new_phi = angles(pi / 2)
    made = Mjcf("five_bar")
    upright = {}
    for side, sign in (("left", 1), ("right", -1)):
        pivot = -sign * half_ground * X
        at_crank, at_rod = (_in_plane(a if sign > 0 else pi - a) for a in (theta, phi))
        elbow = pivot + crank * at_crank[:, 0]
        motor, bend = hinge(f"{side}_motor", -Y), hinge(f"{side}_elbow", -Y)
        made.body(f"{side}_crank", "base", pivot, at_crank, motor, rod(crank, 0.4, 0.01))
        made.body(f"{side}_rod", f"{side}_crank", elbow, at_rod, bend, rod(distal, 0.3, 0.008))
        upright[f"{side}_motor"] = sign * (new_theta - theta)
        upright[f"{side}_elbow"] = sign * (new_phi - phi - new_theta + theta)
    made.connect("tip", "left_rod", "right_rod", elbow + distal * at_rod[:, 0])
    made.motors("left_motor", "right_motor")
    made.posture("home", {})
    made.posture("upright", upright)
    return made


def parallelogram(ground: float = 0.5, crank: float = 0.3, theta: float = pi / 3) -> Mjcf:
    """Write two equal cranks with a coupler as long as the ground: mobility 1, but 2 when flat."""
    made = Mjcf("parallelogram")
    R = _in_plane(theta)
    tip = crank * R[:, 0]
    made.body("crank", "base", 0 * X, R, hinge("crank_pivot", -Y), rod(crank, 0.6, 0.01))
    made.body(
        "coupler", "crank", tip, _in_plane(0), hinge("coupler_pivot", -Y), rod(ground, 1, 0.01)
    )
    made.body("rocker", "base", ground * X, R, hinge("rocker_pivot", -Y), rod(crank, 0.6, 0.01))
    made.connect("coupler_rocker", "coupler", "rocker", ground * X + tip)
    made.motors("crank_pivot")
    made.posture("home", {})
    flat = {"crank_pivot": -theta, "coupler_pivot": theta, "rocker_pivot": -theta}
    made.posture("flat", flat)
    return made


def _in_plane(angle: float) -> np.ndarray:
    """Return axes in the x-z plane; the angle counts from x towards z, about -y."""
    return along(np.array([cos(angle), 0, sin(angle)]), Y)
