"""N four-bars in a row: many loops, a third of the rows redundant."""

from __future__ import annotations

import numpy as np

from condyn_pin.dynamics.scene import Scene
from condyn_pin.lab.extremes.base import Case, extreme, whole
from condyn_pin.lab.extremes.parallelogram import cranks_as_one
from condyn_pin.model.mechanisms.n_four_bar import n_four_bar


@extreme(severities=(2, 3, 5, 8, 12, 20, 30, 40))
def many_cells(severity: float, rng: np.random.Generator) -> Case:
    """How many cells there are; 40 have 120 rows of rank 80.

    All cranks turn as one (problem A02 of the IFToMM library).
    """
    n = whole(severity)
    linkage = n_four_bar(n)
    theta = rng.uniform(0.5, 2.5)
    along = np.ones(2 * n + 1)
    along[1::2] = -1.0
    q, v, tau = theta * along, rng.normal() * along, rng.normal(size=2 * n + 1)
    return Case(Scene(linkage, linkage.loops), q, v, tau, (cranks_as_one(n, theta, tau),))
