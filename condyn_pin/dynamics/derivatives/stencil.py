"""Differences that end at rounding, of what is made of a few sines, such as the axes of joints.

f'(0) d ~ sum_j w_j (f(j h d) - f(-j h d)) / h,    wrong by h^8 f^(9) / 630
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from condyn_pin._core.arrays import Array

_WEIGHTS: Final = (4 / 5, -1 / 5, 4 / 105, -1 / 280)
_H: Final = 2.0**-7  # [rad, m]: below the rounding of f over h


def slope(function: Callable[[Array], Array], direction: Array) -> Array:
    """Return the derivative of a smooth function of a step, along a direction, at no step."""
    steps = [j * _H * direction for j in range(1, len(_WEIGHTS) + 1)]
    changes = np.array([function(step) - function(-step) for step in steps])
    return np.asarray(np.tensordot(_WEIGHTS, changes, 1) / _H)
