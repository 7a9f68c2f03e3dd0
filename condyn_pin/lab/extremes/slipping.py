"""Velocities that the constraints do not allow."""

from condyn_pin.dynamics.scene import Scene
from condyn_pin.lab.extremes.base import Case, Rng, extreme, moving, powers


@extreme(0.0, *powers(-15, 2))
def slipping(severity: float, rng: Rng, scene: Scene) -> Case:
    """How fast each joint moves across the constraints [rad/s, m/s]."""
    q, v, tau = moving(scene, rng)
    return Case(scene, q, v + severity * rng.normal(size=len(v)), tau)
