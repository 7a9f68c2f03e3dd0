"""Derivatives of accelerations and constraint forces: one file a method."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from condyn_pin._core.arrays import Array
from condyn_pin.dynamics.derivatives.base import Derivatives
from condyn_pin.dynamics.derivatives.differences import DifferenceDerivatives
from condyn_pin.dynamics.derivatives.kkt import KktDerivatives
from condyn_pin.dynamics.derivatives.pinocchio import PinocchioDerivatives

if TYPE_CHECKING:
    from condyn_pin.dynamics.solution import Solution
    from condyn_pin.dynamics.workspace import Workspace

# By the name that `derivatives` takes.
METHODS: dict[str, Callable[[Workspace, Solution, Array, Array], Derivatives]] = {
    "kkt": KktDerivatives,
    "pinocchio": PinocchioDerivatives,
    "differences": DifferenceDerivatives,
}

__all__ = ["METHODS", "Derivatives"]
