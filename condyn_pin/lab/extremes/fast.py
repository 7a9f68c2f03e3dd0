"""Joints that turn faster and faster."""

from __future__ import annotations

import numpy as np

from condyn_pin.dynamics.scene import Scene
from condyn_pin.lab.extremes.base import Case, extreme, moving, sized


@extreme(severities=(0.0, 1.0, 1e1, 1e2, 1e3, 1e4, 1e6, 1e9), any_scene=True)
def fast(severity: float, rng: np.random.Generator, scene: Scene) -> Case:
    """Speed of the fastest joint [rad/s, m/s]; forces grow with its square."""
    q, v, tau = moving(scene, rng)
    return Case(scene, q, sized(v, severity), tau)
