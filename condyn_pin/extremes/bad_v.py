"""One number of the velocity that no machine has."""

from __future__ import annotations

import math

import numpy as np

from condyn_pin.extremes.base import Case, extreme, moving
from condyn_pin.scene import Scene


@extreme(
    severities=(
        0.0,
        5e-324,
        1e-310,
        1e-155,
        1e16,
        1e30,
        1e77,
        1e100,
        1e155,
        1e300,
        math.inf,
        math.nan,
    ),
    any_scene=True,
)
def bad_v(severity: float, rng: np.random.Generator, scene: Scene) -> Case:
    """One entry of v, from nothing to what is not a number [SI]."""
    q, v, tau = moving(scene, rng)
    v[rng.integers(len(v))] = severity
    return Case(scene, q, v, tau)
