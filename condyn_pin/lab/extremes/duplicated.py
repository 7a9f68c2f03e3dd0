"""Duplicated constraints: every row is there again and again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from condyn_pin.dynamics.scene import Scene
from condyn_pin.lab.extremes.base import Case, extreme, moving, whole


@extreme(severities=(1, 2, 3, 5, 8, 12), any_scene=True)
def duplicated(severity: float, rng: np.random.Generator, scene: Scene) -> Case:
    """How many times every constraint is there.

    The motion is the one of the scene itself; lam is shared between the copies.
    """
    state = moving(scene, rng)
    copies = [
        replace(constraint, name=f"{constraint.name} {k}")
        for k in range(whole(severity))
        for constraint in scene.constraints
    ]
    return Case(Scene(scene.robot, copies), *state)
