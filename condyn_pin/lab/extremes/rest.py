"""Robots that stand still, with less and less to do."""

import numpy as np

from condyn_pin.constraints.rows.equations import Equations
from condyn_pin.dynamics.scene import Scene
from condyn_pin.lab.extremes.base import Case, Rng, by_reference, extreme, powers


@extreme(1.0, *powers(-1, -6, -1), 1e-8, 1e-10, 1e-12, 0.0)
def rest(severity: float, rng: Rng, scene: Scene) -> Case:
    """Share of the weight that no torque holds, at rest; at 1 nothing is held, at 0 all of it.

    At rest a is linear in tau - h, and so a share of that of the free fall.
    """
    q, _ = scene.sample(rng)
    still = np.zeros(scene.robot.nv)
    h = Equations(scene.robot.model, scene.bounds).terms(q, still).h
    falling = by_reference(scene, q, still, still)
    return Case(scene, q, still, (1.0 - severity) * h, (severity * falling,))
