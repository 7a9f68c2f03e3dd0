"""A foot that is turned by nearly 180 degrees from its anchor."""

import math

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin.constraints.baumgarte import Baumgarte
from condyn_pin.constraints.surface_contact import SurfaceContact
from condyn_pin.dynamics.scene import Scene
from condyn_pin.io.load import load_robot
from condyn_pin.lab.extremes.base import Case, Rng, extreme, frame_at, powers, torques


@extreme(1.0, *powers(-1, -16, -1), 0.0)
def half_turn(severity: float, rng: Rng) -> Case:
    """How much is missing to half a turn between a foot and its anchor [rad].

    Drift control follows the logarithm of that turn, whose axis is lost at 180 degrees.
    """
    talos, foot = load_robot("talos"), "left_sole_link"
    q, v = Scene(talos, [SurfaceContact(foot)]).state()
    axis = rng.normal(size=3)
    axis *= (math.pi - severity) / float(np.linalg.norm(axis))
    anchor = frame_at(talos, q, foot) * pin.SE3(pin.exp3(axis), np.zeros(3))
    scene = Scene(talos, [SurfaceContact(foot, anchor=anchor)])
    return Case(scene, q, v, torques(scene, rng), drift=Baumgarte(5.0, 5.0))
