"""A chain whose last rod weighs less and less."""

from condyn_pin.dynamics.scene import Scene
from condyn_pin.lab.extremes.base import Case, Rng, extreme, rods, torques
from condyn_pin.lab.extremes.planar_chain import accelerations


@extreme(1.0, 1e-1, 1e-3, 1e-6, 1e-9, 1e-12, 1e-13, 1e-15, 1e-30, 1e-300, 0.0)
def massless_tip(severity: float, rng: Rng) -> Case:
    """Mass of the last of five rods in an open chain, the others of 1 kg [kg].

    It still swings by its own weight; without mass nothing says how.
    """
    masses = (1.0, 1.0, 1.0, 1.0, severity)
    scene = Scene(rods(masses))
    q, v = rng.normal(size=(2, 5))
    tau = torques(scene, rng)
    return Case(scene, q, v, tau, (accelerations(q, v, tau, masses),))
