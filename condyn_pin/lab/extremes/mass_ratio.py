"""One heavy or light body in a loop."""

from dataclasses import replace

from condyn_pin.lab.extremes.base import Case, Rng, closed, extreme, moving, with_inertias
from condyn_pin.model.mechanisms.base import rod
from condyn_pin.model.mechanisms.four_bar import four_bar


@extreme(1.0, 1e1, 1e2, 1e3, 1e4, 1e6, 1e9, 1e12, 1e-2, 1e-4, 1e-6, 1e-9, 1e-12)
def mass_ratio(severity: float, rng: Rng) -> Case:
    """Mass of the coupler of a four-bar over that of its crank."""
    linkage = four_bar()
    inertias = list(linkage.model.inertias)
    inertias[2] = rod(0.8, severity * inertias[1].mass)
    scene = closed(replace(linkage, model=with_inertias(linkage.model, inertias)))
    return Case(scene, *moving(scene, rng))
