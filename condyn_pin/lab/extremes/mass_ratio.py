"""One heavy or light body in a loop."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from condyn_pin.dynamics.scene import Scene
from condyn_pin.lab.extremes.base import Case, extreme, moving, with_inertias
from condyn_pin.model.mechanisms.base import rod
from condyn_pin.model.mechanisms.four_bar import four_bar


@extreme(severities=(1.0, 1e1, 1e2, 1e3, 1e4, 1e6, 1e9, 1e12, 1e-2, 1e-4, 1e-6, 1e-9, 1e-12))
def mass_ratio(severity: float, rng: np.random.Generator) -> Case:
    """Mass of the coupler of a four-bar over that of its crank."""
    linkage = four_bar()
    inertias = list(linkage.model.inertias)
    inertias[2] = rod(0.8, severity * inertias[1].mass)
    linkage = replace(linkage, model=with_inertias(linkage.model, inertias))
    scene = Scene(linkage, linkage.loops)
    return Case(scene, *moving(scene, rng))
