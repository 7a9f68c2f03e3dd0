"""A point on two planes that are nearly the same one."""

from __future__ import annotations

import math

import numpy as np

from condyn_pin.constraints.planar_contact import PlanarContact
from condyn_pin.dynamics.scene import Scene
from condyn_pin.io.load import load_robot
from condyn_pin.lab.extremes.base import Case, extreme, moving, powers


@extreme(severities=(1.0, *powers(-1, -16, -1), 0.0))
def near_planes(severity: float, rng: np.random.Generator) -> Case:
    """Angle between two planes that a point of the foot slides on [rad]."""
    talos = load_robot("talos")
    planes = [
        PlanarContact("left_sole_link", normal=(math.sin(angle), 0.0, math.cos(angle)), name=name)
        for name, angle in (("level", 0.0), ("tilted", severity))
    ]
    scene = Scene(talos, planes)
    return Case(scene, *moving(scene, rng))
