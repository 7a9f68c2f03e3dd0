"""The smallest torques of the motors: |u|^2."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.control.distribution.force_distribution import ForceDistribution
from condyn_pin.dynamics.solution import Sites


@dataclass(frozen=True)
class LeastTorque(ForceDistribution):
    """The smallest torques of the motors with forces within the cones, in the sum of squares.

    min |u|^2    with  A lam <= 0

    Parameters
    ----------
    cones : Cone or dict of str to Cone
        One for all contacts that press on a floor, or one each by name.
    """

    title: ClassVar[str] = "smallest torques"

    def measured(self, at: Sites, motors: int) -> Array:
        """Return the rows of all torques."""
        return np.hstack((np.eye(motors), np.zeros((motors, at.scene.rows))))
