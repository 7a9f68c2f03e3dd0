"""The proximal weight, or damping, of every method that has one."""

from condyn_pin.dynamics.scene import Scene
from condyn_pin.lab.extremes.base import Case, Rng, extreme, moving


@extreme(
    *(1e-6, 1e-8, 1e-10, 1e-12, 1e-14, 1e-16, 1e-20, 1e-50, 1e-300, 0.0),
    *(1e-4, 1e-2, 1.0, 1e2, 1e4, 1e6, 1e12),
)
def weight(severity: float, rng: Rng, scene: Scene) -> Case:
    """How large the parameter mu is [1/kg]."""
    return Case(scene, *moving(scene, rng), parameters={"mu": severity})
