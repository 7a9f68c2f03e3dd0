"""Two points of one foot that are held, nearer and nearer to each other."""

from __future__ import annotations

import numpy as np

from condyn_pin.constraints.point_contact import PointContact
from condyn_pin.dynamics.scene import Scene
from condyn_pin.io.load import load_robot
from condyn_pin.lab.extremes.base import Case, extreme, moving, powers


@extreme(severities=(*powers(-1, -16, -1), 0.0))
def near_points(severity: float, rng: np.random.Generator) -> Case:
    """Distance of two points of a foot that are both held [m].

    Together they leave the foot one turn less than a single point, however near they are. Below
    1e-11 no arithmetic in double precision can tell them from one.
    """
    talos = load_robot("talos")
    foot = "left_sole_link"
    points = [
        PointContact(foot, name="here"),
        PointContact(foot, (severity, 0.0, 0.0), name="there"),
    ]
    scene = Scene(talos, points)
    return Case(scene, *moving(scene, rng))
