"""A parallelogram: a four-bar that gets singular where it is flat."""

from __future__ import annotations

from math import pi

from condyn_pin.model.mechanisms.machine import Machine, X, Y, hinge, in_plane, round_rod
from condyn_pin.model.mechanisms.registry import mechanism
from condyn_pin.model.robot import Robot


@mechanism
def parallelogram() -> Robot:
    """Return two equal cranks with a coupler as long as the ground: mobility 1, but 2 when flat.

    Cranks of 0.3 m and 0.6 kg, a coupler of 0.5 m and 1 kg, in the world's x-z plane. Drawn, and at
    the posture ``home``, the cranks are at 60 deg.

    Returns
    -------
    Robot
        Three joints, a ball loop, one motor: the crank.

    Notes
    -----
    The row of the ball along y is redundant, always: rank 2. At the posture ``flat`` it drops to 1,
    for the bars can go on as a parallelogram or cross over. Near it the second singular value of J
    falls in proportion to the distance: a loop as badly conditioned as one likes.
    """
    ground, crank, theta = 0.5, 0.3, pi / 3  # [m], [m], [rad]
    made, R = Machine("parallelogram"), in_plane(theta)
    tip, bar = crank * R[:, 0], round_rod(crank, 0.6, 0.01)
    coupler = round_rod(ground, 1, 0.01)
    made.body("crank", "base", 0 * X, R, hinge("crank_pivot", -Y), bar)
    made.body("coupler", "crank", tip, in_plane(0), hinge("coupler_pivot", -Y), coupler)
    made.body("rocker", "base", ground * X, R, hinge("rocker_pivot", -Y), bar)
    made.connect("coupler_rocker", "coupler", "rocker", ground * X + tip)
    flat = {"crank_pivot": -theta, "coupler_pivot": theta, "rocker_pivot": -theta}
    return made.robot({"home": {}, "flat": flat}, "crank_pivot")
