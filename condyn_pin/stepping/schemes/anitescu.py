"""Anitescu: the convex relaxation of Stewart and Trinkle's step."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from condyn_pin._core.arrays import Array
from condyn_pin.contact.problem import Law
from condyn_pin.simulation.integrators.contact_scheme import (
    ActiveContacts,
    BiasPartials,
    ContactScheme,
    closing_by,
    closing_velocities,
)
from condyn_pin.simulation.integrators.integrator import Stepper
from condyn_pin.simulation.system import System
from condyn_pin.stepping.contact_steps import contact_stepper


@dataclass(frozen=True)
class Anitescu(ContactScheme):
    """The step of `StewartTrinkle` as a convex problem, which always has a solution.

    min over lam in K of 1/2 lam^T G lam + g^T lam,    K* contains sigma = G lam + g

    It is exact for sticking contacts. A sliding contact lifts off with mu |sigma_t|: contacts that
    start to slide fast hop, by the same height at any dt.

    Parameters
    ----------
    contact : ContactSolver
        What answers the contact problem of each step.

    References
    ----------
    Anitescu. Optimization-based simulation of nonsmooth rigid multibody dynamics. Mathematical
    Programming 105, 2006.
    """

    title: ClassVar[str] = "Anitescu"
    use: ClassVar[str] = "to compare with convex simulators; where nothing slides fast"
    law: ClassVar[Law] = "ccp"
    closes_gaps: ClassVar[bool] = True

    def bias(self, near: ActiveContacts) -> tuple[Array, Array | None]:
        """Return g (m,) [m/s] of contacts that are `near`; they are rigid."""
        return closing_velocities(near), None

    def bias_partials(self, near: ActiveContacts) -> BiasPartials:
        """Partial derivatives of `bias` by `near`."""
        return closing_by(near)

    def start(self, system: System, dt: float) -> Stepper:
        """Return this integrator at work on `system`."""
        return contact_stepper(self, system, dt)
