"""Drift schemes: their contract, and Baumgarte stabilisation, the one that the rows know.

Integrators solve J a + gamma = 0, and what they leave in J v and c(q) adds up. A scheme of one kind
changes what is asked of the rows, J a + gamma = a_ref; one of the other kind moves the state back
after a step.

1. Add one file to `simulation/drift/` with one frozen dataclass that inherits from `Drift`. Its
   fields are its parameters, each with a default and a unit. Set `title`, `cost` and `use`. The
   class registers itself under its lower-case name in `DRIFTS`.
2. A scheme of the first kind returns what it asks for from `rows`. Only `Baumgarte` can be asked
   for: Pinocchio's own methods know nothing else.
3. A scheme of the second kind returns a `Correction` from `start(system, dt)`. It runs after every
   step, takes (t, q, v) at its end, returns (q, v) and writes to neither of its arguments. What it
   remembers from step to step it keeps in its closure; after an event it is started again. It
   sets `corrects`. One that leaves gaps of configurations alone overrides `closes`.
4. `system`, a `System` of the simulation, brings what a correction needs; the equations import this
   file, which knows nothing of it.
5. A correction that cannot reach the constraints returns the best state that it found; it raises
   `NotAssembled` only where going on has no meaning. The run then ends with what it has.
6. Sources: cite the paper in the docstring.
"""

from __future__ import annotations

from abc import ABC
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import e, sqrt
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from condyn_pin._core.arguments import register, seconds, step_size
from condyn_pin._core.arrays import Array, finite
from condyn_pin.errors import InvalidArgument

if TYPE_CHECKING:
    from condyn_pin.constraints.rows.bound import BoundConstraint

DRIFTS: dict[str, type[Drift]] = {}

# (t, q, v) -> (q, v)
Correction = Callable[[float, Array, Array], tuple[Array, Array]]


class Drift(ABC):
    """Drift scheme, which keeps the constraints closed; a frozen value."""

    title: ClassVar[str]
    cost: ClassVar[str]
    use: ClassVar[str]  # when to take it
    corrects: ClassVar[bool] = False  # whether it moves the state back after a step

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        name = cls.__name__.lower()
        register(DRIFTS, name, cls, f"a drift scheme named {cls.__name__}")

    @property
    def rows(self) -> Baumgarte | None:
        """Baumgarte stabilisation of the rows; None for J a + gamma = 0."""
        return None

    @property
    def closes(self) -> bool:
        """True if the scheme closes a gap at the beginning of a motion."""
        return self.corrects

    def start(self, system: Any, dt: float) -> Correction | None:
        """Return the correction of the state after each step of size dt; None without one."""
        return None


# Of gains whose squares are numbers [1/s].
_LARGEST = 1e154


@dataclass(frozen=True)
class Baumgarte(Drift):
    """Close gaps of the constraints as a damped spring would.

    J a + gamma = a_ref = -2 alpha J v - beta^2 c

    so that a gap obeys c'' + 2 alpha c' + beta^2 c = 0; alpha = beta is critically damped. Contacts
    without an anchor have no gap, and are only damped.

    Parameters
    ----------
    alpha, beta : float
        Gains [1/s], not negative.

    Raises
    ------
    InvalidArgument
        If a gain is negative, not finite, or so large that its square overflows.

    References
    ----------
    Baumgarte. Stabilization of constraints and integrals of motion in dynamical systems. Computer
    Methods in Applied Mechanics and Engineering 1, 1972.
    """

    title: ClassVar[str] = "Baumgarte"
    cost: ClassVar[str] = "two products a row"
    use: ClassVar[str] = (
        "to compare, and in solve; gains far from the stability limit of the integrator"
    )

    alpha: float  # [1/s]
    beta: float  # [1/s]

    def __post_init__(self) -> None:
        for argument in ("alpha", "beta"):
            value = float(finite(argument, getattr(self, argument), ()))
            if value < 0:
                raise InvalidArgument(f"{argument} = {value!r}: a number >= 0 [1/s] is needed")
            if value > _LARGEST:
                raise InvalidArgument(
                    f"{argument} = {value!r}: its square overflows; a number below {_LARGEST:g} "
                    "[1/s] is needed"
                )
            object.__setattr__(self, argument, value)

    @classmethod
    def critical(cls, alpha: float) -> Baumgarte:
        """Return alpha = beta [1/s]: a gap decays as (1 + alpha t) exp(-alpha t)."""
        return cls(alpha, alpha)

    @classmethod
    def from_settling_time(cls, T: float, remaining: float = 0.02) -> Baumgarte:
        """Return critical gains that reduce a gap to a given fraction within a given time.

        (1 + x) exp(-x) = remaining,    alpha = beta = x / T

        Parameters
        ----------
        T : float
            The settling time [s], positive.
        remaining : float
            The fraction [1], between 0 and 1.

        Raises
        ------
        InvalidArgument
            If T is not positive, or `remaining` is not between 0 and 1.
        """
        T = seconds("T", T)
        if not 0 < finite("remaining", remaining, ()) < 1:
            raise InvalidArgument(f"remaining = {remaining!r}: between 0 and 1")
        from scipy.special import lambertw  # as long to import as Pinocchio

        x = -float(lambertw(-remaining / e, k=-1).real) - 1.0
        return cls.critical(x / T)

    @classmethod
    def deadbeat(cls, dt: float) -> Baumgarte:
        """Return the gains with which semi-implicit Euler closes a gap in two steps.

        alpha = 1 / (2 dt), beta = 1 / dt: both eigenvalues of the step are zero.

        Parameters
        ----------
        dt : float
            The step of the simulation [s].

        Raises
        ------
        InvalidArgument
            If dt is not positive.
        """
        dt = step_size(dt)
        return cls(0.5 / dt, 1.0 / dt)

    @classmethod
    def from_solref(cls, timeconst: float, dampratio: float = 1.0) -> Baumgarte:
        """Return the gains of MuJoCo's ``solref``, for a constraint of impedance 1.

        alpha = 1 / timeconst,    beta = 1 / (timeconst dampratio)

        Two numbers that are not positive are -stiffness and -damping there: beta^2 and 2 alpha.
        With an impedance d < 1 MuJoCo divides besides: alpha by d, beta by d too.

        Parameters
        ----------
        timeconst : float
            [s], or -beta^2 [1/s^2].
        dampratio : float
            [1], or -2 alpha [1/s].

        Raises
        ------
        InvalidArgument
            If one number is positive and the other is not.

        References
        ----------
        MuJoCo's documentation, chapter Modeling, section Solver parameters.
        """
        first, second = (
            float(finite("timeconst", timeconst, ())),
            finite("dampratio", dampratio, ()),
        )
        if first > 0 and second > 0:
            return cls(1.0 / first, 1.0 / (first * float(second)))
        if first <= 0 and second <= 0:
            return cls(-float(second) / 2, sqrt(-first))
        raise InvalidArgument(
            f"timeconst, dampratio = {timeconst!r}, {dampratio!r}: both positive, or both not"
        )

    def to_solref(self) -> tuple[float, float]:
        """MuJoCo's (timeconst, dampratio) of the same gains; direct, negative, without both."""
        if self.alpha > 0 and self.beta > 0:
            return 1.0 / self.alpha, self.alpha / self.beta
        return -self.Kp, -self.Kd

    @property
    def Kd(self) -> float:
        """2 alpha [1/s]."""
        return 2.0 * self.alpha

    @property
    def Kp(self) -> float:
        """beta^2 [1/s^2]."""
        return self.beta**2

    @property
    def closes(self) -> bool:
        """True if both gains are positive: else a gap stays, or oscillates."""
        return self.alpha > 0 and self.beta > 0

    @property
    def rows(self) -> Baumgarte:
        """Stabilisation of the rows: itself."""
        return self


# Gains of the rows of a scene, whose constraints may have their own.


def stabilisation(bounds: Sequence[BoundConstraint], drift: Baumgarte | None) -> Baumgarte | None:
    """Stabilisation of the constraints that have none of their own; None where no row has any."""
    own = any(bound.drift for bound in bounds)
    return Baumgarte(0.0, 0.0) if own and drift is None else drift


def gains(bounds: Sequence[BoundConstraint], drift: Baumgarte) -> tuple[Array, Array]:
    """Gains Kp, Kd (m,) of each row [1/s^2], [1/s]: the constraint's own, or those of `drift`."""
    sizes = [bound.size for bound in bounds]
    of_each = np.array([(d.Kp, d.Kd) for d in (bound.drift or drift for bound in bounds)])
    Kp, Kd = np.repeat(of_each.reshape(-1, 2), sizes, axis=0).T
    return np.ascontiguousarray(Kp), np.ascontiguousarray(Kd)
