"""Joints that turn faster and faster."""

from condyn_pin.dynamics.scene import Scene
from condyn_pin.lab.extremes.base import Case, Rng, extreme, moving, sized


@extreme(0.0, 1.0, 1e1, 1e2, 1e3, 1e4, 1e6, 1e9)
def fast(severity: float, rng: Rng, scene: Scene) -> Case:
    """Speed of the fastest joint [rad/s, m/s]; forces grow with its square."""
    q, v, tau = moving(scene, rng)
    return Case(scene, q, sized(v, severity), tau)
