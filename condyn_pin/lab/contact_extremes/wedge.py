"""A box between two walls, and one that is jammed."""

import math

from condyn_pin.constraints.contacts.shapes import Plane
from condyn_pin.contact.problem import ContactProblem
from condyn_pin.lab.contact_extremes.base import HALF, Rng, box_on, contact_extreme, posed


@contact_extreme(45.0, 30.0, 10.0, 3.0, 1.0, 0.1, 1e-2, 1e-4, 1e-6, 0.0)
def wedge(severity: float, rng: Rng) -> ContactProblem:
    """Angle of two walls to the vertical that a box is pressed in between [deg].

    With a friction of 1 it is jammed from 45 degrees on: walls push against each other with forces
    that nothing bounds. At zero they are parallel.
    """
    s, c = math.sin(math.radians(severity)), math.cos(math.radians(severity))
    walls = (Plane((c, 0.0, s), -HALF[0] * c), Plane((-c, 0.0, s), -HALF[0] * c))
    scene = box_on(*walls, friction=1.0)
    q, v = scene.state()
    q[2] = 0.0
    v[:3] = *rng.normal(scale=0.1, size=2), -1.0
    # the walls meet the corners that are lowest
    q[2] = HALF[2] + 1e-5
    return posed(scene, q, v)
