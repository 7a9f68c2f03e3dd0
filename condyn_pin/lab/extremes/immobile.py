"""Mechanisms that cannot move."""

import numpy as np

from condyn_pin.constraints.coupling import Coupling
from condyn_pin.dynamics.scene import Scene
from condyn_pin.lab.extremes.base import Case, Rng, closed, extreme
from condyn_pin.model.mechanisms.four_bar import four_bar


@extreme(0.0, 1.0, 1e3, 1e6, 1e9, 1e12)
def immobile(severity: float, rng: Rng) -> Case:
    """Torques on a four-bar whose rocker is geared to its crank besides [N m].

    Nothing is left to move: a = 0, whatever the torques.
    """
    linkage = four_bar()
    q, v = closed(linkage).state()
    gear = Coupling("rocker", "crank", -0.5, float(q[2] + 0.5 * q[0]))
    scene = Scene(linkage, [*linkage.loops, gear])
    return Case(scene, q, v, severity * rng.normal(size=3), (np.zeros(3),))
