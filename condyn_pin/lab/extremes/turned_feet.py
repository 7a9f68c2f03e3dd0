"""Feet that are held twice, the second time by other frames of the same body."""

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin.constraints.surface_contact import SurfaceContact
from condyn_pin.dynamics.scene import Scene
from condyn_pin.io.load import load_robot
from condyn_pin.lab.extremes.base import Case, Rng, by_reference, extreme, moving, powers, unit


@extreme(1.0, *powers(-2, -16, -2), 0.0)
def turned_feet(severity: float, rng: Rng) -> Case:
    """Angle about the ankle from the frames that hold Talos's feet to those that do again [rad].

    Who holds a body holds it by any of its frames: the motion is that of feet held once, and every
    row of the copies is a sum of others.
    """
    talos = load_robot("talos")
    once = Scene(talos, talos.contacts)
    state = moving(once, rng)
    right = by_reference(once, *state)
    copies = []
    for foot in once.names:
        joint, placement = talos.frame(foot)
        there = pin.SE3(pin.exp3(severity * unit(rng)), np.zeros(3)) * placement
        name, ankle = f"{foot} again", talos.model.names[joint]
        talos = talos.with_frame(name, ankle, there.translation, there.rotation)
        copies.append(SurfaceContact(name))
    return Case(Scene(talos, [*once.constraints, *copies]), *state, (right,))
