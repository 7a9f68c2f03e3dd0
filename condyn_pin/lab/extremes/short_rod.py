"""A rod loop whose two ends nearly meet."""

from condyn_pin.constraints.loop import Loop
from condyn_pin.dynamics.scene import Scene
from condyn_pin.lab.extremes.base import Case, Rng, extreme, moving
from condyn_pin.model.mechanisms.four_bar import four_bar


@extreme(1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-8, 1e-10, 1e-12, 1e-14, 1e-16, 1e-300)
def short_rod(severity: float, rng: Rng) -> Case:
    """Length of the rod between coupler and rocker of a four-bar [m].

    Its direction turns with the speed of the ends over its length.
    """
    scene = Scene(four_bar(), [Loop("coupler_tip", "rocker_tip", "rod", length=severity)])
    return Case(scene, *moving(scene, rng))
