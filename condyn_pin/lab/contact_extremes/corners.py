"""One foot on many points."""

import numpy as np

from condyn_pin.constraints.contacts.frictional_contact import FrictionalContact
from condyn_pin.contact.problem import ContactProblem
from condyn_pin.dynamics.scene import Scene
from condyn_pin.lab.contact_extremes.base import HALF, Rng, contact_extreme, posed
from condyn_pin.model.mechanisms.free_bodies import free_box


@contact_extreme(3, 4, 6, 8, 12, 16, 32, 64)
def corners(severity: float, rng: Rng) -> ContactProblem:
    """Points round the sole of a box, of which two or three would do."""
    angles = 2 * np.pi * np.arange(severity) / severity
    x, y, z = HALF
    scene = Scene(
        free_box(size=(2 * x, 2 * y, 2 * z)),
        contacts=[
            FrictionalContact(
                "box", offset=(x * np.cos(a), y * np.sin(a), -z), friction=0.5, name=f"point {i}"
            )
            for i, a in enumerate(angles)
        ],
    )
    q, v = scene.state()
    return posed(scene, q, v + 0.02 * rng.normal(size=6))
