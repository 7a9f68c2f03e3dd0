"""Posed: a step with contacts, all of it but the answer."""

from __future__ import annotations

from typing import NamedTuple

from condyn_pin._core.arrays import Array
from condyn_pin.contact.condense import Condensed
from condyn_pin.contact.problem import ContactProblem
from condyn_pin.simulation.integrators.chosen_contacts import Chosen
from condyn_pin.simulation.integrators.contact_scheme import Near


class Posed(NamedTuple):
    """A step before its contact problem is solved; floating bodies in their axes at `at`."""

    at: Array  # (nq,), where M, h and J are taken
    v: Array  # (nv,), the velocity before
    mean: Array  # (nv,), the velocity of h
    turning: Array  # (nv,), w x u of floating bodies at `mean`
    tau: Array  # (nv,), springs and damping as they act at the end of the step [N, N m]
    gaps: Array  # of all cones and half-lines [m, rad]
    J: Array  # (rows, nv), of all candidates
    J_c: Array  # (m, nv), of those that take part
    chosen: Chosen
    condensed: Condensed
    near: Near
    problem: ContactProblem
