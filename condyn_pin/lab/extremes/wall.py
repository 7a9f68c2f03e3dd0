"""Drift control on both sides of the stability limit of semi-implicit Euler."""

import numpy as np

from condyn_pin.constraints.baumgarte import Baumgarte
from condyn_pin.dynamics.scene import Scene
from condyn_pin.lab.extremes.base import Case, Motion, Rng, ajar, extreme


@extreme(1e-3, 1e-2, 0.1, 0.5, 0.8, 0.82, 0.828, 0.829, 0.84, 1.0, 2.0, 10.0, 1e3, 1e6)
def wall(severity: float, rng: Rng, scene: Scene) -> Case:
    """Gains alpha = beta of Baumgarte times the step, of 1e-6 to 0.1 s; gaps grow beyond 0.828.

    The loops are open by about 1e-7, and nothing else moves.
    """
    dt = 10.0 ** rng.uniform(-6.0, -1.0)  # [s]
    q, v = scene.state()
    drift = Baumgarte(severity / dt, severity / dt)
    return Case(scene, ajar(scene, q, rng), v, np.zeros(len(v)), drift=drift, motion=Motion(dt))
