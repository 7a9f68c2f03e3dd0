"""The smallest forces: |lam|^2."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.control.distribution.force_distribution import ForceDistribution
from condyn_pin.dynamics.solution import Sites


@dataclass(frozen=True)
class LeastNorm(ForceDistribution):
    """The smallest forces within the cones, in the sum of squares of all rows [N, N m].

    min |lam|^2    with  A lam <= 0

    Parameters
    ----------
    cones : Cone or dict of str to Cone
        One for all contacts that press on a floor, or one each by name.
    """

    title: ClassVar[str] = "smallest forces"

    def measured(self, at: Sites, motors: int) -> Array:
        """Return the rows of all forces."""
        m = at.scene.rows
        return np.hstack((np.zeros((m, motors)), np.eye(m)))
