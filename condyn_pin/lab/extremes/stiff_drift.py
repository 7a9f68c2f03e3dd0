"""Drift control with larger and larger gains."""

from __future__ import annotations

import numpy as np

from condyn_pin.constraints.baumgarte import Baumgarte
from condyn_pin.dynamics.scene import Scene
from condyn_pin.lab.extremes.base import Case, ajar, extreme, moving, powers


@extreme(severities=(0.0, *powers(0, 12)), any_scene=True)
def stiff_drift(severity: float, rng: np.random.Generator, scene: Scene) -> Case:
    """Gains alpha = beta of Baumgarte on loops that are open by 1e-7 [1/s]."""
    q, v, tau = moving(scene, rng)
    q = ajar(scene, q, rng)
    return Case(scene, q, v, tau, drift=Baumgarte(severity, severity))
