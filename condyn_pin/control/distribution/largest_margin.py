"""The forces that are farthest from leaving their cones: max t with A lam + t <= 0."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.control.distribution.least_norm import LeastNorm

# How much of the largest margin the smallest forces may use up.
_GIVEN = 1e-6


@dataclass(frozen=True)
class LargestMargin(LeastNorm):
    """The forces with the largest smallest margin to their cones, and of these the smallest.

    max t    with  A lam + t <= 0

    Parameters
    ----------
    cones : Cone or dict of str to Cone
        One for all contacts that press on a floor, or one each by name.
    """

    title: ClassVar[str] = "largest margin"

    def margin(self, A: Array, y: Array, N: Array) -> float:
        """Return the largest t that some forces have, by a linear program."""
        # imported here: scipy.optimize takes as long to import as Pinocchio
        from scipy.optimize import linprog

        size = max(float(np.abs(y).max(initial=0.0)), np.finfo(float).tiny)
        found = linprog(
            np.concatenate((np.zeros(N.shape[1]), [-1.0])),
            np.hstack((A @ N, np.ones((len(A), 1)))),
            -(A @ y) / size,
            bounds=(None, None),
            method="highs",
        )
        largest = size * float(found.x[-1]) if found.status == 0 else 0.0
        return largest - _GIVEN * size if largest > 0 else 0.0
