"""A contact of what can hardly move, and of what cannot."""

from condyn_pin.constraints.contacts.shapes import Plane
from condyn_pin.contact.problem import ContactProblem
from condyn_pin.lab.contact_extremes.base import (
    Rng,
    box_on,
    columns,
    contact_extreme,
    falling,
    posed,
    with_rows,
)  # fmt: skip


@contact_extreme(1.0, 1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12, 1e-14, 1e-16, 1e-100, 0.0)
def immovable(severity: float, rng: Rng) -> ContactProblem:
    """Factor of the inverse mass that one contact of a falling box feels; at zero nothing moves it.

    At zero its rows are empty, and it is asked to part: no impulse can.
    """
    scene = box_on(Plane(), friction=0.5)
    problem = posed(scene, *falling(scene, rng))
    share = columns([severity**0.5, *[1.0] * (len(problem.friction) - 1)])
    g = problem.g.copy()
    g[2] = -1.0
    return with_rows(problem, share[:, None] * problem.G * share, g)


@contact_extreme(1.0, *(10.0**k for k in (1, -1, 3, -3, 6, -6, 9, -9, 12, -12, 40, -40)))
def other_units(severity: float, rng: Rng) -> ContactProblem:
    """Factor of G: another unit of mass [1/kg]."""
    scene = box_on(Plane(), friction=0.5)
    problem = posed(scene, *falling(scene, rng))
    return with_rows(problem, severity * problem.G, problem.g)


@contact_extreme(1.0, *(10.0**k for k in (1, -1, 3, -3, 6, -6, 9, -9, 12, -12, 40, -40)))
def other_speed(severity: float, rng: Rng) -> ContactProblem:
    """Factor of g: another unit of length, or of time [m/s]."""
    scene = box_on(Plane(), friction=0.5)
    problem = posed(scene, *falling(scene, rng))
    return with_rows(problem, problem.G, severity * problem.g)
