"""Duplicated constraints: every row is there again and again."""

from dataclasses import replace

from condyn_pin.dynamics.scene import Scene
from condyn_pin.lab.extremes.base import Case, Rng, extreme, moving


@extreme(1, 2, 3, 5, 8, 12)
def duplicated(severity: float, rng: Rng, scene: Scene) -> Case:
    """How many times every constraint is there.

    The motion is the one of the scene itself; lam is shared between the copies.
    """
    state = moving(scene, rng)
    copies = [
        replace(constraint, name=f"{constraint.name} {k}")
        for k in range(round(severity))
        for constraint in scene.constraints
    ]
    return Case(Scene(scene.robot, copies, scene.contacts), *state)
