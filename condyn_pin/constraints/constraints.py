"""Constraints between bodies and between joints, by name; each kind is a file of its own."""

from condyn_pin.constraints.base import WORLD, Constraint
from condyn_pin.constraints.coupling import Coupling
from condyn_pin.constraints.loop import Loop, LoopKind

__all__ = ["WORLD", "Constraint", "Coupling", "Loop", "LoopKind"]
