"""Baumgarte: what the rows are asked to do about a gap that has opened."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt
from typing import ClassVar, Final

from condyn_pin.arrays import finite
from condyn_pin.drift.base import Drift
from condyn_pin.errors import InvalidArgument

# Where (1 + x) exp(-x) = 0.02.
_SETTLED: Final = 5.8339


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

    @classmethod
    def critical(cls, alpha: float) -> Baumgarte:
        """Return critical damping, alpha = beta [1/s]: (1 + alpha t) exp(-alpha t)."""
        return cls(alpha, alpha)

    @classmethod
    def from_settling_time(cls, T: float) -> Baumgarte:
        """Return critical damping with which a gap falls to two per cent in T [s].

        (1 + x) exp(-x) = 0.02 at x = alpha T = 5.834
        """
        return cls.critical(_SETTLED / _positive("T", T, "s"))

    @classmethod
    def deadbeat(cls, dt: float) -> Baumgarte:
        """Return the gains that cancel gap and slip in a step, up to dt^2: 1/dt and sqrt(2)/dt.

        Taylor's rule. It is beyond the wall of semi-implicit Euler, for which `simulate` refuses
        it, and inside that of explicit Euler and Runge-Kutta 4.
        """
        step = _positive("dt", dt, "s")
        return cls(1.0 / step, sqrt(2.0) / step)

    @classmethod
    def from_solref(cls, timeconst: float, dampratio: float) -> Baumgarte:
        """Return MuJoCo's solref = (timeconst [s], dampratio) as gains.

        alpha = 1 / timeconst,    beta = alpha / dampratio

        The same spring where the rows are rigid: MuJoCo divides by its impedance d < 1 besides.
        """
        alpha = 1.0 / _positive("timeconst", timeconst, "s")
        return cls(alpha, alpha / _positive("dampratio", dampratio, "1"))

    def to_solref(self) -> tuple[float, float]:
        """Return MuJoCo's (timeconst [s], dampratio) of these gains."""
        if not (self.alpha > 0 and self.beta > 0):
            raise InvalidArgument(f"{self!r}: solref needs alpha > 0 and beta > 0")
        return 1.0 / self.alpha, self.alpha / self.beta

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


def _positive(argument: str, value: float, unit: str) -> float:
    """Return a positive number, or raise InvalidArgument."""
    number = float(finite(argument, value, ()))
    if number <= 0:
        raise InvalidArgument(f"{argument} = {value!r}: a number > 0 [{unit}] is needed")
    return number
