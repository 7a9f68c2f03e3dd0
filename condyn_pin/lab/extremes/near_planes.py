"""A point on two planes that are nearly the same one."""

import math

from condyn_pin._core import tolerances
from condyn_pin.constraints.planar_contact import PlanarContact
from condyn_pin.dynamics.scene import Scene
from condyn_pin.io.load import load_robot
from condyn_pin.lab.extremes.base import Case, Rng, extreme, moving, powers


@extreme(1.0, *powers(-1, -16, -1), 0.0)
def near_planes(severity: float, rng: Rng) -> Case:
    """Angle between two planes that a point of the foot slides on [rad]."""
    planes = [
        PlanarContact("left_sole_link", normal=(math.sin(angle), 0.0, math.cos(angle)), name=name)
        for name, angle in (("level", 0.0), ("tilted", severity))
    ]
    scene = Scene(load_robot("talos", precision=tolerances.ROUNDED_GEOMETRY), planes)
    return Case(scene, *moving(scene, rng))
