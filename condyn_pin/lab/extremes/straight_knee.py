"""A leg that is held at both ends, nearly stretched."""

import numpy as np

from condyn_pin.lab.extremes.base import Case, Rng, extreme, hooked, powers
from condyn_pin.mechanism.projection import project_velocity
from condyn_pin.model.mechanisms.chain import chain


@extreme(1.0, *powers(-1, -12, -1), 0.0)
def straight_knee(severity: float, rng: Rng) -> Case:
    """Angle of three links of a leg to the line between its held ends [rad].

    Stretched, the rows along the leg hold less and less, and forces grow without bound before.
    """
    q = severity * np.array([1.0, -2.0, 1.5])
    scene = hooked(chain(3), q, "planar")
    v = project_velocity(scene, q, rng.normal(size=3))
    return Case(scene, q, v, rng.normal(size=3))
