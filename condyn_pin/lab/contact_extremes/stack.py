"""Boxes on boxes."""

from __future__ import annotations

import numpy as np

from condyn_pin.constraints.contacts.frictional_contact import FrictionalContact
from condyn_pin.constraints.contacts.shapes import Box, Plane
from condyn_pin.contact.problem import ContactProblem
from condyn_pin.dynamics.scene import Scene
from condyn_pin.lab.contact_extremes.base import HALF, Rng, contact_extreme, posed
from condyn_pin.model.mechanisms.free_bodies import free_box
from condyn_pin.model.smaller import together


def stacked(masses: list[float], friction: float, rng: Rng) -> ContactProblem:
    """Return the problem of boxes on each other, the first on the floor, all pushed a little."""
    size = (2 * HALF[0], 2 * HALF[1], 2 * HALF[2])
    boxes = {f"box {i}": free_box(mass=mass, size=size) for i, mass in enumerate(masses, start=1)}
    robot, names = together(boxes), list(boxes)
    contacts = []
    for below, name in zip([None, *names], names, strict=False):
        on = Plane() if below is None else f"{below}/box"
        top = None if below is None else Plane(height=HALF[2])
        contacts.append(
            FrictionalContact(
                f"{name}/box", Box(*HALF), on=on, on_shape=top, friction=friction, name=name
            )
        )
    scene = Scene(robot, contacts=contacts)
    q, v = scene.state()
    for i in range(len(names)):
        q[7 * i + 2] = (2 * i + 1) * HALF[2]
    return posed(
        scene, q, v + 0.1 * rng.normal(size=len(v)) * np.tile([1, 1, 0, 0, 0, 0], len(names))
    )


@contact_extreme(1, 2, 3, 5, 10, 20)
def stack(severity: float, rng: Rng) -> ContactProblem:
    """How many boxes stand on each other, four corners each."""
    return stacked([1.0] * int(severity), 0.5, rng)


@contact_extreme(1.0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
def heavy_on_light(severity: float, rng: Rng) -> ContactProblem:
    """Mass of a box over that of the box that it stands on."""
    return stacked([1.0, severity], 0.5, rng)
