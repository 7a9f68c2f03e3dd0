"""States whose loops are open."""

from condyn_pin._core._pin import pin
from condyn_pin.dynamics.scene import Scene
from condyn_pin.lab.extremes.base import Case, Rng, extreme, moving, powers


@extreme(0.0, *powers(-15, 0))
def open_loops(severity: float, rng: Rng, scene: Scene) -> Case:
    """How far each joint is from where the loops close [rad, m].

    Redundant rows then ask for slightly different accelerations.
    """
    q, v, tau = moving(scene, rng)
    apart = severity * rng.normal(size=len(v))
    return Case(scene, pin.integrate(scene.robot.model, q, apart), v, tau)
