"""Drift control with larger and larger gains."""

from condyn_pin.constraints.baumgarte import Baumgarte
from condyn_pin.dynamics.scene import Scene
from condyn_pin.lab.extremes.base import Case, Rng, ajar, extreme, moving, powers


@extreme(0.0, *powers(0, 12))
def stiff_drift(severity: float, rng: Rng, scene: Scene) -> Case:
    """Gains alpha = beta of Baumgarte on loops that are open by 1e-7 [1/s]."""
    q, v, tau = moving(scene, rng)
    return Case(scene, ajar(scene, q, rng), v, tau, drift=Baumgarte(severity, severity))
