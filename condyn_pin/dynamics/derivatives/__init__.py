"""Derivatives of accelerations and constraint forces: one file a method."""

from __future__ import annotations

from collections.abc import Callable

from condyn_pin._core.arrays import Array
from condyn_pin.dynamics.derivatives.kkt import kkt_derivatives
from condyn_pin.dynamics.derivatives.others import DifferenceDerivatives, PinocchioDerivatives
from condyn_pin.dynamics.derivatives.solution_derivatives import Derivatives
from condyn_pin.dynamics.solution import Solution
from condyn_pin.dynamics.workspace import Workspace

# By the name that `derivatives` takes.
METHODS: dict[str, Callable[[Workspace, Solution, Array, Array], Derivatives]] = {
    "kkt": kkt_derivatives,
    "pinocchio": PinocchioDerivatives,
    "differences": DifferenceDerivatives,
}

__all__ = ["METHODS", "Derivatives"]
