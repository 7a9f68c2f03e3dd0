"""A box that only just touches."""

from condyn_pin.constraints.contacts.shapes import Plane
from condyn_pin.contact.problem import ContactProblem
from condyn_pin.lab.contact_extremes.base import DT, Rng, box_on, contact_extreme, posed


@contact_extreme(1.0, 1e-1, 1e-3, 1e-6, 1e-9, 1e-12, 1e-15, 1e-16, 1e-17, 0.0)
def grazing(severity: float, rng: Rng) -> ContactProblem:
    """Share of its weight with which a box presses while it slides at 1 m/s."""
    scene = box_on(Plane(), friction=0.5)
    q, v = scene.state()
    v[:3] = *rng.normal(size=2), 9.81 * DT * (1.0 - severity)
    return posed(scene, q, v)
