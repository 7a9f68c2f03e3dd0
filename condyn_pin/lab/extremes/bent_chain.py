"""A long chain that is bent everywhere."""

from condyn_pin.dynamics.scene import Scene
from condyn_pin.lab.extremes.base import Case, Rng, extreme
from condyn_pin.lab.extremes.planar_chain import accelerations
from condyn_pin.model.mechanisms.chain import chain


@extreme(5, 10, 20, 50, 100, 200, heavy=(400,))
def bent_chain(severity: float, rng: Rng) -> Case:
    """How many rods there are, each at a random angle to the one before."""
    n = round(severity)
    q, v, tau = rng.normal(size=n), rng.normal(size=n) / n, rng.normal(size=n)
    return Case(Scene(chain(n)), q, v, tau, (accelerations(q, v, tau),))
