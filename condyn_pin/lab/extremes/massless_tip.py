"""A chain whose last rod weighs less and less."""

from __future__ import annotations

import numpy as np

from condyn_pin.dynamics.scene import Scene
from condyn_pin.lab.extremes.base import Case, extreme, torques, with_inertias
from condyn_pin.lab.extremes.planar_chain import accelerations
from condyn_pin.model.mechanisms.base import rod
from condyn_pin.model.mechanisms.chain import chain
from condyn_pin.model.robot import Robot

_RODS = 5


@extreme(severities=(1.0, 1e-1, 1e-3, 1e-6, 1e-9, 1e-12, 1e-13, 1e-15, 1e-30, 1e-300, 0.0))
def massless_tip(severity: float, rng: np.random.Generator) -> Case:
    """Mass of the last of five rods in an open chain, the others of 1 kg [kg].

    It still swings by its own weight; without mass nothing says how.
    """
    links, masses = chain(_RODS), (*(_RODS - 1) * (1.0,), severity)
    inertias = [links.model.inertias[0], *(rod(1.0, mass) for mass in masses)]
    scene = Scene(Robot("light tip", with_inertias(links.model, inertias), links.postures))
    q, v = rng.normal(size=(2, _RODS))
    tau = torques(scene, rng)
    return Case(scene, q, v, tau, (accelerations(q, v, tau, masses),))
