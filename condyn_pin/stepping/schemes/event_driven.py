"""EventDriven: smooth motion by an accurate integrator, between events that are located."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from condyn_pin.constraints.constraint import check_positive
from condyn_pin.constraints.contacts.candidates import Candidates
from condyn_pin.contact.restitution import Energetic, RestitutionLaw, check_law
from condyn_pin.contact.solvers.contact_solver import ContactSolver
from condyn_pin.contact.solvers.newton import SemismoothNewton
from condyn_pin.errors import InvalidArgument, UnsupportedConstraint
from condyn_pin.simulation.integrators.dormand_prince import DormandPrince
from condyn_pin.simulation.integrators.explicit import ExplicitEuler, RungeKutta4, StormerVerlet
from condyn_pin.simulation.integrators.integrator import Integrator, Order, Stepper
from condyn_pin.simulation.system import System
from condyn_pin.stepping.event_steps import EventSteps
from condyn_pin.stepping.transition import NextModes

# What needs nothing but accelerations at states of its own, and remembers nothing.
_INNER = (RungeKutta4, DormandPrince, StormerVerlet, ExplicitEuler)


@dataclass(frozen=True)
class EventDriven(Integrator):
    """Event-driven contact: each impact, lift-off, slip and stick is located in time.

    M a + h = tau + J_b^T l_b + (J_n - mu s J_t)^T l_n + J_s^T l_s,
    J_b a + gamma = 0,    sigma_n' = 0 of what presses,    sigma_s' = 0 of what sticks

    with s the direction of what slides, and gamma less the second derivative of the path of driven
    rows. The order is that of the integrator between events, and
    across them too: they are found where a gap, a normal force, the margin to the friction cone or
    a speed of slip is zero. The next modes solve a contact problem: in impulses, by a law of
    restitution, if contacts approach, and in accelerations if they do not; if no acceleration
    exists (Painlevé), in impulses again, a shock. The events are in `Trajectory.run.happened`, with
    modes and impulses; each one begins a new phase.

    Parameters
    ----------
    inner : Integrator
        What moves between events: `RungeKutta4`, `DormandPrince`, `StormerVerlet` or
        `ExplicitEuler`.
    shortest_bounce : float
        A contact that would be back sooner comes to rest [s]. A ball is off by its height then,
        g s^2 / 8, and comes to rest earlier by s e / (1 - e): with 1e-7 s by 1e-14 m and 4e-7 s.
    contact : ContactSolver
        What answers the contact problems; Newton's method does to rounding.
    restitution_law : RestitutionLaw
        The law by which contacts rebound: `Energetic()`, `Newton()` or `Poisson()`.

    Raises
    ------
    InvalidArgument
        If `inner` is none of these, the shortest bounce is not positive, `contact` does not solve
        Coulomb's law itself, or `restitution_law` is none.

    Notes
    -----
    Contacts are detected at the ends of steps: one that touches and leaves within a step is missed.
    It accepts planes, of the world and of bodies, joint stops and dry friction; contacts between
    two moving shapes are refused. Springs and damping act as explicit forces: if they are stiff, dt
    has to be small. Sticking contacts are held at the velocity level, and closed to rounding after
    each segment.

    If redundant contacts slide, Coulomb's law does not determine their loads: they change as little
    as possible. Every step takes about eight solves, an event about ten more. Robots whose feet
    rattle have thousands of events per second, and are better simulated with `StewartTrinkle`.

    References
    ----------
    Pfeiffer, Glocker. Multibody dynamics with unilateral contacts. Wiley, 1996.
    Acary, Brogliato. Numerical methods for nonsmooth dynamical systems. Springer, 2008, chapter 8.
    """

    title: ClassVar[str] = "event-driven"
    use: ClassVar[str] = "with few contacts: as accurate as without, times of impact and all"
    solves_per_step: ClassVar[float] = 8
    keeps_constraints: ClassVar[bool] = True
    takes_contacts: ClassVar[bool] = True
    locates_events: ClassVar[bool] = True
    takes_restitution: ClassVar[bool] = True

    inner: Integrator = RungeKutta4()  # noqa: RUF009  a value
    shortest_bounce: float = 1e-7  # [s]
    contact: ContactSolver = SemismoothNewton()  # noqa: RUF009  a value
    restitution_law: RestitutionLaw = Energetic()  # noqa: RUF009  a value

    def __post_init__(self) -> None:
        if not isinstance(self.inner, _INNER):
            can = ", ".join(kind.__name__ for kind in _INNER)
            raise InvalidArgument(
                f"inner = {self.inner!r}: one of {can} is needed, which ask for accelerations only"
            )
        check_positive(shortest_bounce=self.shortest_bounce)
        check_law(self.restitution_law)
        if not isinstance(self.contact, ContactSolver) or not self.contact.exact:
            raise InvalidArgument(
                f"contact = {self.contact!r}: a contact solver that solves Coulomb's law itself is "
                "needed, such as SemismoothNewton()"
            )
        if "ncp" not in self.contact.laws:
            raise InvalidArgument(
                f"contact = {self.contact!r}: it solves {' and '.join(self.contact.laws)} only; "
                "use SemismoothNewton()"
            )

    @property
    def order(self) -> Order:
        """That of the integrator between events."""
        return self.inner.order

    @property
    def between_events(self) -> Integrator:
        """The integrator between events."""
        return self.inner

    @property
    def damps_implicitly(self) -> bool:
        """True if joint damping does not limit dt of the integrator between events."""
        return self.inner.damps_implicitly

    def check(self, candidates: Candidates) -> None:
        """Refuse `candidates` that are where shapes of two bodies meet."""
        if candidates.pairs:
            name = candidates.names[candidates.contact_points]
            raise UnsupportedConstraint(
                f"{name}: where shapes of two bodies meet changes from one edge to the next, and "
                f"{self.title} motion is between planes and bodies; use StewartTrinkle(), or "
                "Moreau() in small steps where they rebound, or on_shape=Plane(...)"
            )

    def start(self, system: System, dt: float) -> Stepper:
        """Return this integrator at work on `system`."""
        choice = NextModes(system.contacts, self.contact, self.restitution_law)
        steps = EventSteps(system, dt, self.inner, choice, self.shortest_bounce)
        return Stepper(steps.step, effects=steps.effects, sample=steps.sample)
