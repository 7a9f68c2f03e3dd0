"""States whose loops are open."""

from __future__ import annotations

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin.dynamics.scene import Scene
from condyn_pin.lab.extremes.base import Case, extreme, moving, powers


@extreme(severities=(0.0, *powers(-15, 0)), any_scene=True)
def open_loops(severity: float, rng: np.random.Generator, scene: Scene) -> Case:
    """How far each joint is from where the loops close [rad, m].

    Redundant rows then ask for slightly different accelerations.
    """
    q, v, tau = moving(scene, rng)
    apart = severity * rng.normal(size=len(v))
    return Case(scene, pin.integrate(scene.robot.model, q, apart), v, tau)
