"""Contacts that give way, less and less: the convex problem of MuJoCo and Drake."""

import numpy as np

from condyn_pin.constraints.contacts.shapes import Plane
from condyn_pin.contact.problem import ContactProblem
from condyn_pin.lab.contact_extremes.base import Rng, box_on, contact_extreme, falling, posed


@contact_extreme(1.0, *(10.0**-k for k in (1, 2, 3, 4, 6, 8, 10, 12, 15)))
def compliance(severity: float, rng: Rng) -> ContactProblem:
    """Compliance of the contacts of a falling box over their G; the law is convex."""
    scene = box_on(Plane(), friction=0.5)
    hard = posed(scene, *falling(scene, rng))
    R = severity * float(np.mean(hard.G.diagonal()))
    return ContactProblem(
        G=hard.G, g=hard.g, friction=hard.friction, R=np.full(hard.rows, R), law="ccp",
        names=hard.names,
    )  # fmt: skip
