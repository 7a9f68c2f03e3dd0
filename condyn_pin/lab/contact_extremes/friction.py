"""Friction from ice to what locks."""

from condyn_pin.constraints.contacts.shapes import Plane
from condyn_pin.contact.problem import ContactProblem
from condyn_pin.lab.contact_extremes.base import Rng, box_on, contact_extreme, falling, posed


@contact_extreme(0.5, 0.7, 1.0, 0.1, 1e-2, 1e-6, 1e-12, 0.0, 1.5, 2.0, 3.0, 5.0, 10.0, 30.0, 100.0)
def friction(severity: float, rng: Rng) -> ContactProblem:
    """Friction of a box that falls on its corners."""
    scene = box_on(Plane(), friction=severity)
    return posed(scene, *falling(scene, rng))
