"""Derivatives compared with central differences."""

from __future__ import annotations

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array
from condyn_pin.dynamics.derivatives.base import Derivatives
from condyn_pin.dynamics.derivatives.differences import DifferenceDerivatives
from condyn_pin.errors import DerivativesDisagree

BLOCKS = ("da_dq", "da_dv", "da_dtau", "dlam_dq", "dlam_dv", "dlam_dtau")


def check_derivatives(found: Derivatives, differences: DifferenceDerivatives) -> None:
    """Raise `DerivativesDisagree` where derivatives differ from central differences.

    By q, where rows are redundant, only along the constraints.
    """
    for name in BLOCKS:
        wanted: Array = getattr(differences, name)
        had: Array = getattr(found, name)
        if name.endswith("_dq"):
            had = had @ differences.along.T @ differences.along
        error = np.abs(had - wanted)
        size = max(float(np.abs(wanted).max(initial=0.0)), 1.0)
        if error.size and not error.max() <= tolerances.DERIVATIVES * size:
            row, column = np.unravel_index(int(np.argmax(error)), error.shape)
            raise DerivativesDisagree(
                f"{name}[{row}, {column}] = {had[row, column]:.9g}, and differences with a step of "
                f"{differences.step:g} give {wanted[row, column]:.9g}; the largest entry is "
                f"{size:.3g}. Near a singular state or at an open loop neither is reliable"
            )
