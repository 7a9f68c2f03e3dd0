"""Moreau: contacts at the middle of the step, with restitution."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core.arrays import Array
from condyn_pin.contact.restitution import Energetic, RestitutionLaw, check_law
from condyn_pin.simulation.integrators.contact_scheme import (
    ActiveContacts,
    BiasPartials,
    ContactScheme,
)
from condyn_pin.simulation.integrators.integrator import Order, Stepper
from condyn_pin.simulation.system import System
from condyn_pin.stepping.contact_steps import contact_stepper


@dataclass(frozen=True)
class Moreau(ContactScheme):
    """Moreau's time stepping, on velocities and impulses, at the midpoint of the step.

    q_m = q (+) dt v / 2,    contacts with a gap <= 0 there are active,
    g_n = J_n v_free + e J_n v,    q+ = q (+) dt (v + v+) / 2

    Where the law of restitution is not Newton's, nor gives the same, what strikes is thrown off
    first, and e J_n v is -max(J_n v', 0) of the velocity v' behind the impact. What rests on a
    plane that its path bends away from or into, such as a board that tilts, follows it: g_n has
    dt Jdot_n v / 2 more.

    While nothing touches, a step is of second order, also with torques that are functions, springs
    and damping; it is exact in a constant field where M is constant. Torques are those of the
    middle of the step, and so are springs and damping, but for stiff ones that dt does not resolve,
    trace M^-1 (dt D + dt^2 K) > 1: these act at its end, which is of first order and does not swing
    on. A penetration, up to dt v at an impact at speed v, is not pushed out; notices say how deep
    bodies are. Shapes that pass through each other within one step do not touch, and notices name
    them.

    Parameters
    ----------
    contact : ContactSolver
        What answers the contact problem of each step.
    restitution_law : RestitutionLaw
        The law by which contacts rebound: `Energetic()`, `Newton()` or `Poisson()`. Impacts of
        several contacts are all in the same instant, but for ``Energetic(chain=True)``.

    Raises
    ------
    InvalidArgument
        If `contact` or `restitution_law` is none.

    References
    ----------
    Moreau. Unilateral contact and dry friction in finite freedom dynamics. In: Nonsmooth Mechanics
    and Applications, CISM 302. Springer, 1988.
    """

    title: ClassVar[str] = "Moreau"
    use: ClassVar[str] = "where contacts rebound, and for the energy of falls"
    order: ClassVar[Order] = Order(2, 2, 1)  # while nothing touches
    at_midpoint: ClassVar[bool] = True
    # what rests on a plane is above it by rounding in half of its steps
    touching: ClassVar[float] = 1e-9  # [m, rad]
    takes_restitution: ClassVar[bool] = True
    follows_planes: ClassVar[bool] = True

    restitution_law: RestitutionLaw = Energetic()  # noqa: RUF009  a value

    def __post_init__(self) -> None:
        super().__post_init__()
        check_law(self.restitution_law)

    @property
    def impacts(self) -> RestitutionLaw:
        """The law by which contacts rebound."""
        return self.restitution_law

    def near(self, gaps: Array, v: Array, dt: float) -> NDArray[np.bool_]:
        """Flags of contacts that touch in the middle of the step."""
        return np.asarray(gaps <= self.touching)

    def bias(self, near: ActiveContacts) -> tuple[Array, Array | None]:
        """Return g (m,) [m/s] of contacts that are `near`; they are rigid."""
        g = near.free.copy()
        g[near.normals] += near.restitution * near.before[near.normals] + near.bends / near.dt
        return g, None

    def bias_partials(self, near: ActiveContacts) -> BiasPartials:
        """Partial derivatives of `bias` by `near`."""
        before = np.zeros_like(near.free)
        before[near.normals] = near.restitution
        approach = near.before[near.normals]
        follows = (near.bends != 0.0) / near.dt
        return BiasPartials(before=before, restitution=approach, bends=follows)

    def start(self, system: System, dt: float) -> Stepper:
        """Return this integrator at work on `system`."""
        return contact_stepper(self, system, dt)
