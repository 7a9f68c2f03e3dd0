"""Posed: a step with contacts, all of it but the answer."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core.arrays import Array
from condyn_pin.contact.condense import Condensed
from condyn_pin.contact.problem import ContactProblem
from condyn_pin.contact.restitution import Strike
from condyn_pin.simulation.integrators.chosen_contacts import Chosen
from condyn_pin.simulation.integrators.contact_scheme import Near


class Posed(NamedTuple):
    """A step before its contact problem is solved; floating bodies in their axes at `at`."""

    at: Array  # (nq,), where M and h are taken, and J of the constraints
    v: Array  # (nv,), the velocity before
    mean: Array  # (nv,), the velocity of h
    turning: Array  # (nv,), w x u of floating bodies at `mean`
    tau: Array  # (nv,), springs and damping as they act at the end of the step [N, N m]
    gaps: Array  # of all cones and half-lines, at `at` [m, rad]
    J: Array  # (rows, nv), of all candidates, at `at`
    straight: Array | None  # (nq,), the end of a path from `at` along v, if gaps were asked there
    path: (
        Array | None
    )  # (nv,), the velocity along which contacts are taken to its end; None: at `at`
    J_c: Array  # (m, nv), of those that take part, where they are taken
    J_n: Array  # (k, nv), the rates of their gaps at `at`
    chosen: Chosen
    condensed: Condensed
    near: Near
    problem: ContactProblem
    strike: Strike | None = None  # the impact with which the step begins
    span: float = 0.0  # over which springs and damping act: dt, or its half in the middle [s]
    t: float = 0.0  # when the equations are taken [s]
    kept: Kept | None = None

    def total(self, lam: Array) -> Array:
        """Return all impulses of the contacts (m,), of the impact and of the step behind it."""
        if self.strike is None:
            return lam
        total = lam.copy()
        total[: len(self.strike.lam)] += self.strike.lam
        return total

    def velocity(self, lam: Array) -> Array:
        """Return v+ (nv,) of impulses (m,) of the step behind the impact."""
        return self.condensed.velocity(self.total(lam))


class Kept(NamedTuple):
    """What of a step that is taken again along a path stays as it was in an attempt before."""

    of: NDArray[np.int_]  # (nv,), the attempt whose path each velocity has; -1 for the next one
    gaps: NDArray[np.bool_]  # of all candidates, which are taken at the beginning
    first: Posed  # as they were there
