"""A limit on the iterations, from very many to one."""

from condyn_pin.dynamics.scene import Scene
from condyn_pin.lab.extremes.base import Case, Rng, extreme, moving


@extreme(1e4, 1e3, 1e2, 20.0, 10.0, 5.0, 3.0, 2.0, 1.0, 0.0)
def few_iterations(severity: float, rng: Rng, scene: Scene) -> Case:
    """How large the parameter max_iterations is."""
    return Case(scene, *moving(scene, rng), parameters={"max_iterations": round(severity)})
