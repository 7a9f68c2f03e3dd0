"""NoDrift: nothing is done."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from condyn_pin.constraints.drift import Drift


@dataclass(frozen=True)
class NoDrift(Drift):
    """No correction: J a + gamma = 0 alone, so gaps stay open.

    For integrators that satisfy the constraints themselves. With others c grows like t^2 for high
    orders, and like t for order 1.
    """

    title: ClassVar[str] = "none"
    cost: ClassVar[str] = "nothing"
    use: ClassVar[str] = "with integrators that keep the constraints, and to see the drift"
