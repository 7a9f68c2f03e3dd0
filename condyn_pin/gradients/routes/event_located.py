"""EventLocated: impacts at their own times within a step."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.errors import InvalidArgument
from condyn_pin.gradients.routes.linear_steps import LinearizedStep
from condyn_pin.gradients.routes.located import LocatedStep
from condyn_pin.gradients.routes.route import Route
from condyn_pin.gradients.routes.step_derivatives import StepDerivatives
from condyn_pin.simulation.integrators.contact_scheme import ContactScheme
from condyn_pin.stepping.schemes.moreau import Moreau
from condyn_pin.stepping.step_problem import AcceptedStep


@dataclass(frozen=True)
class EventLocated(Route):
    """The derivatives of a step with impacts located in time: saltation matrices.

    x+ = flow(dt - s) o impact o flow(s),    gap(s) = 0,    ds = -(J_n dq) / (J_n v)

    If the impact comes ds later, the flow after it is ds shorter, and what depends on time, as
    paths and torques may, is taken ds later.

    The step is cut where a gap closes. On both sides contacts keep what they are, open or at rest,
    by steps of `Moreau`; at the cut they rebound by Newton's law, with friction. The time of the
    cut depends on the start, which a step of fixed length ignores: otherwise the height of a ball
    after one bounce has a wrong derivative with respect to its initial height, at every dt.

    Notes
    -----
    The end differs from that of the scheme, which rebounds before or after the true impact. A
    contact that bounces more than eight times within a step rests from then on. One that is on its
    way out of the ground and does not get there within the step closes nothing: it goes on. What
    rests stays at rest: velocities that open or close it, and a small restitution, move it by their
    square. A landing at the very start or end of a step is `one_sided`; derivatives by q of what
    rests at a gap of zero are those of what is in the ground, which stays as deep as it is.

    References
    ----------
    Leine, Nijmeijer. Dynamics and Bifurcations of Non-Smooth Mechanical Systems. Springer, 2004.
    Kong, Payne, Zhu, Johnson. Saltation matrices: the essential tool for linearizing hybrid
    dynamical systems. Proceedings of the IEEE 112, 2024.
    """

    title: ClassVar[str] = "event located"
    cost: ClassVar[str] = "as ActiveSet; a step with an impact as much as ten"
    use: ClassVar[str] = "where the time of an impact matters: throws, bounces, touch-down"

    def scheme(self, scheme: ContactScheme) -> ContactScheme:
        """Return the scheme of the parts of a step: Moreau's, with the same contact solver."""
        if scheme.law != "ncp":
            raise InvalidArgument(
                f"route = EventLocated(): impacts obey Coulomb's law, and {scheme.title} poses its "
                "convex relaxation; take StewartTrinkle() or Moreau()"
            )
        if isinstance(scheme, Moreau):
            return Moreau(scheme.contact, scheme.restitution_law)
        return Moreau(contact=scheme.contact)

    def at(
        self, steps: LinearizedStep, t: float, q: Array, v: Array, taken: AcceptedStep | None = None
    ) -> StepDerivatives:
        """Return the end of a step of `steps` from a state, with its derivatives."""
        with np.errstate(all="ignore"):  # what is not finite is refused
            return LocatedStep(steps).differentiated(self, t, q, v)

    def step(self, steps: LinearizedStep, t: float, q: Array, v: Array) -> tuple[Array, Array]:
        """Return the end of the same step of `steps`, without derivatives."""
        with np.errstate(all="ignore"):
            return LocatedStep(steps).taken(t, q, v)
