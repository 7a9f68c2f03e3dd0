"""StewartTrinkle: velocities that close the gaps of a step, with Coulomb's law."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from condyn_pin._core.arrays import Array
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
class StewartTrinkle(ContactScheme):
    """Time stepping without penetration and rebound: the default with contacts.

    g_n = J_n v_free + (s + gap) / dt  (gap > 0),    J_n v_free + s / dt - p  (gap < 0)
    q+  = q (+) dt v+,    s = gap(q (+) dt v) - gap - dt J_n v

    A contact touches at the end of the step in which it would have gone through; s is how far a
    path over a plane bends in that time. Where the step ends 0.1 mm from there, or s < -0.1 mm of
    what presses, it is taken again, with gaps and J_c as they are at its end: impulses then act
    against what goes through there. What penetrates still is pushed out with p = -0.2 gap / dt, at
    0.2 m/s at most; by less where that presses a body into something else, as between two walls.

    Parameters
    ----------
    contact : ContactSolver
        What answers the contact problem of each step.

    References
    ----------
    Stewart, Trinkle. An implicit time-stepping scheme for rigid body dynamics with inelastic
    collisions and Coulomb friction. International Journal for Numerical Methods in Engineering 39,
    1996.
    """

    title: ClassVar[str] = "Stewart-Trinkle"
    use: ClassVar[str] = "by default with contacts: nothing penetrates, whatever dt is"
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
