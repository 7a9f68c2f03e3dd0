"""Painlevé's rod: friction that has no force, and an impulse alone."""

import numpy as np

from condyn_pin.constraints.contacts.frictional_contact import FrictionalContact
from condyn_pin.contact.problem import ContactProblem
from condyn_pin.dynamics.scene import Scene
from condyn_pin.lab.contact_extremes.base import Rng, contact_extreme, posed
from condyn_pin.model.mechanisms.free_bodies import painleve_rod


@contact_extreme(0.1, 0.5, 1.0, 1.3, 1.333, 4 / 3, 1.334, 1.4, 1.5, 2.0, 3.0, 5.0, 10.0)
def painleve(severity: float, rng: Rng) -> ContactProblem:
    """Friction of a rod whose lower end slides; from 4/3 on no force is right."""
    scene = Scene(painleve_rod(), contacts=[FrictionalContact("tip", friction=severity)])
    q, _ = scene.state("paradox")
    return posed(scene, q, np.array([-rng.uniform(0.5, 2.0), 0.0, 0.0]))
