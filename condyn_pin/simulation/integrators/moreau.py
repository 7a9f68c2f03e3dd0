"""Moreau: contacts at the middle of the step, with restitution."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core.arrays import Array
from condyn_pin.simulation.integrators.base import Order, Stepper
from condyn_pin.simulation.integrators.contact_scheme import AskedBy, ContactScheme, Near
from condyn_pin.simulation.integrators.contact_steps import contact_stepper
from condyn_pin.simulation.system import System


@dataclass(frozen=True)
class Moreau(ContactScheme):
    """Moreau's time stepping, on velocities and impulses, at the midpoint of the step.

    q_m = q (+) dt v / 2,    contacts with a gap <= 0 there take part,
    g_n = J_n v_free + e J_n v,    q+ = q (+) dt (v + v+) / 2

    Contacts rebound by Newton's law, all in the same instant; if several touch, as in Newton's
    cradle, other impact laws give other velocities. While no contact opens, closes or slides, a
    step is of second order, and exact in a constant field where M is constant. A penetration, up to
    dt v / 2 at an impact, is not pushed out.

    Parameters
    ----------
    contact : ContactSolver
        What answers the contact problem of each step.

    References
    ----------
    Moreau. Unilateral contact and dry friction in finite freedom dynamics. In: Nonsmooth Mechanics
    and Applications, CISM 302. Springer, 1988.
    """

    title: ClassVar[str] = "Moreau"
    use: ClassVar[str] = "where contacts rebound, and for the energy of falls"
    order: ClassVar[Order] = Order(2, 2, 1)  # while no contact opens, closes or slides
    at_midpoint: ClassVar[bool] = True
    # what rests on a plane is above it by rounding in half of its steps
    touching: ClassVar[float] = 1e-9  # [m, rad]
    takes_restitution: ClassVar[bool] = True

    def near(self, gaps: Array, v: Array, dt: float) -> NDArray[np.bool_]:
        """Return which contacts touch in the middle of the step."""
        return np.asarray(gaps <= self.touching)

    def asked(self, near: Near) -> tuple[Array, Array | None]:
        """Return g (m,) [m/s] of contacts that are `near`; nothing gives way."""
        g = near.free.copy()
        g[near.normals] += near.restitution * near.before[near.normals]
        return g, None

    def asked_by(self, near: Near) -> AskedBy:
        """Return how `asked` changes with what is `near`."""
        before = np.zeros_like(near.free)
        before[near.normals] = near.restitution
        approach = near.before[near.normals]
        return AskedBy(before=before, restitution=approach)

    def start(self, system: System, dt: float) -> Stepper:
        """Return this integrator at work on `system`."""
        return contact_stepper(self, system, dt)
