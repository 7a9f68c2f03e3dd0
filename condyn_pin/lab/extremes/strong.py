"""Motors that are stronger and stronger."""

from condyn_pin.dynamics.scene import Scene
from condyn_pin.lab.extremes.base import Case, Rng, extreme, moving, sized


@extreme(0.0, 1.0, 1e2, 1e4, 1e6, 1e8, 1e12, 1e16)
def strong(severity: float, rng: Rng, scene: Scene) -> Case:
    """Largest torque on a joint [N m, N]."""
    q, v, tau = moving(scene, rng)
    return Case(scene, q, v, sized(tau, severity))
