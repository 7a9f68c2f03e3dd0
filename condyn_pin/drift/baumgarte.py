"""Baumgarte: what the rows are asked to do about a gap that has opened."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from condyn_pin.arrays import finite
from condyn_pin.drift.base import Drift
from condyn_pin.errors import InvalidArgument


@dataclass(frozen=True)
class Baumgarte(Drift):
    """The rows are pulled back like a damped spring.

    J a + gamma = a_ref = -2 alpha J v - beta^2 c

    so that a gap obeys c'' + 2 alpha c' + beta^2 c = 0; alpha = beta is critically damped. Contacts
    without an anchor have no gap: they are only damped.

    Parameters
    ----------
    alpha, beta : float
        [1/s], not negative.

    References
    ----------
    Baumgarte. Stabilization of constraints and integrals of motion in dynamical systems. Computer
    Methods in Applied Mechanics and Engineering 1, 1972.
    """

    title: ClassVar[str] = "Baumgarte"
    cost: ClassVar[str] = "two products a row"
    use: ClassVar[str] = "by default; gains far from the wall of the integrator"

    alpha: float  # [1/s]
    beta: float  # [1/s]

    def __post_init__(self) -> None:
        for argument in ("alpha", "beta"):
            value = float(finite(argument, getattr(self, argument), ()))
            if value < 0:
                raise InvalidArgument(f"{argument} = {value!r}: a number >= 0 [1/s] is needed")
            object.__setattr__(self, argument, value)

    @property
    def Kd(self) -> float:
        """2 alpha [1/s]."""
        return 2.0 * self.alpha

    @property
    def Kp(self) -> float:
        """beta^2 [1/s^2]."""
        return self.beta**2

    @property
    def rows(self) -> Baumgarte:
        """What is asked of the rows: itself."""
        return self
