"""A parallelogram that is nearly flat."""

import math

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin._core.tolerances import REFERENCE_RANK
from condyn_pin.lab.extremes.base import Case, Rng, alternating, closed, extreme, powers
from condyn_pin.model.mechanisms.n_four_bar import n_four_bar


@extreme(1.0, *powers(-1, -12, -1), 0.0)
def parallelogram(severity: float, rng: Rng) -> Case:
    """Angle of the cranks to the ground [rad].

    As long as they are not flat, all cranks turn as one:

        ((n + 1) / 3 + n) theta'' = -((n + 1) / 2 + n) (g / length) cos(theta) + torques

    Flat, the cell can also leave the parallelogram, and the equations allow what they did not.
    """
    along, tau = alternating(3), rng.normal(size=3)
    right = () if severity <= 10 * REFERENCE_RANK else (cranks_as_one(1, severity, tau),)
    return Case(closed(n_four_bar(1)), severity * along, rng.normal() * along, tau, right)


def cranks_as_one(n: int, theta: float, tau: Array) -> Array:
    """Return the accelerations of n cells of unit rods whose cranks stand at theta [rad].

    Torques tau (2 n + 1,) [N m]; those of the couplers act backwards.
    """
    along, inertia = alternating(2 * n + 1), (n + 1) / 3 + n
    weight = ((n + 1) / 2 + n) * 9.81 * math.cos(theta)
    return np.asarray((along @ tau - weight) / inertia * along)
