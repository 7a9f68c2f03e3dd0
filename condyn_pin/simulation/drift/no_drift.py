"""NoDrift: nothing is done."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from condyn_pin.constraints.drift import Drift


@dataclass(frozen=True)
class NoDrift(Drift):
    """J a + gamma = 0 and nothing else: what a step leaves open stays open.

    Right for integrators that satisfy the constraints themselves. With the others c grows like
    t^2 with high orders, and like t with the first order.
    """

    title: ClassVar[str] = "none"
    cost: ClassVar[str] = "nothing"
    use: ClassVar[str] = "with integrators that keep the constraints, and to see the drift"
