"""A long chain that is held at its tip too."""

from condyn_pin.lab.extremes.base import Case, Rng, extreme, hooked
from condyn_pin.mechanism.projection import project_velocity
from condyn_pin.model.mechanisms.chain import chain


@extreme(3, 5, 10, 20, 50, 100)
def held_chain(severity: float, rng: Rng) -> Case:
    """How many rods there are in a chain with a ball at its tip."""
    n = round(severity)
    scene = hooked(chain(n), rng.normal(size=n) * 0.3)
    q, _ = scene.state()
    v = project_velocity(scene, q, rng.normal(size=n) / n)
    return Case(scene, q, v, rng.normal(size=n))
