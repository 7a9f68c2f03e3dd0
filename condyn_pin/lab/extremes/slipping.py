"""Velocities that the constraints do not allow."""

from __future__ import annotations

import numpy as np

from condyn_pin.dynamics.scene import Scene
from condyn_pin.lab.extremes.base import Case, extreme, moving, powers


@extreme(severities=(0.0, *powers(-15, 2)), any_scene=True)
def slipping(severity: float, rng: np.random.Generator, scene: Scene) -> Case:
    """How fast each joint moves across the constraints [rad/s, m/s]."""
    q, v, tau = moving(scene, rng)
    return Case(scene, q, v + severity * rng.normal(size=len(v)), tau)
