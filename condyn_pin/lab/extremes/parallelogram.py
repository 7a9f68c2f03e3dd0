"""A parallelogram that is nearly flat."""

from __future__ import annotations

import math

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin._core.tolerances import REFERENCE_RANK
from condyn_pin.dynamics.scene import Scene
from condyn_pin.lab.extremes.base import Case, extreme, powers
from condyn_pin.model.mechanisms.n_four_bar import n_four_bar


@extreme(severities=(1.0, *powers(-1, -12, -1), 0.0))
def parallelogram(severity: float, rng: np.random.Generator) -> Case:
    """Angle of the cranks to the ground [rad].

    As long as they are not flat, all cranks turn as one:

        ((n + 1) / 3 + n) theta'' = -((n + 1) / 2 + n) (g / length) cos(theta) + torques

    Flat, the cell can also leave the parallelogram, and the equations allow what they did not.
    """
    linkage = n_four_bar(1)
    along = np.array([1.0, -1.0, 1.0])
    tau = rng.normal(size=3)
    right = () if severity <= 10 * REFERENCE_RANK else (cranks_as_one(1, severity, tau),)
    return Case(Scene(linkage, linkage.loops), severity * along, rng.normal() * along, tau, right)


def cranks_as_one(n: int, theta: float, tau: Array) -> Array:
    """Return the accelerations of n cells of unit rods whose cranks stand at theta.

    Parameters
    ----------
    n : int
    theta : float
        [rad].
    tau : (2 n + 1,) array
        [N m]; those of the couplers act backwards.
    """
    along = np.ones(2 * n + 1)
    along[1::2] = -1.0
    inertia = (n + 1) / 3 + n
    weight = ((n + 1) / 2 + n) * 9.81 * math.cos(theta)
    return np.asarray((along @ tau - weight) / inertia * along)
