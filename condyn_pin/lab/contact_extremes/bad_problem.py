"""One number of a contact problem that no machine has."""

import math

from condyn_pin.constraints.contacts.shapes import Plane
from condyn_pin.contact.problem import ContactProblem
from condyn_pin.lab.contact_extremes.base import (
    Rng,
    box_on,
    contact_extreme,
    falling,
    posed,
    with_rows,
)  # fmt: skip

SIZES = (0.0, 5e-324, 1e-310, 1e-155, 1e16, 1e77, 1e155, 1e300, math.inf, math.nan)


@contact_extreme(*SIZES)
def bad_g(severity: float, rng: Rng) -> ContactProblem:
    """One entry of g, from nothing to what is not a number [m/s]."""
    scene = box_on(Plane(), friction=0.5)
    problem = posed(scene, *falling(scene, rng))
    g = problem.g.copy()
    g[rng.integers(len(g))] = severity
    return with_rows(problem, problem.G, g)


@contact_extreme(*SIZES)
def bad_G(severity: float, rng: Rng) -> ContactProblem:
    """One entry on the diagonal of G, from nothing to what is not a number [1/kg]."""
    scene = box_on(Plane(), friction=0.5)
    problem = posed(scene, *falling(scene, rng))
    G, i = problem.G.copy(), rng.integers(len(problem.g))
    G[i, i] = severity
    return with_rows(problem, G, problem.g)
