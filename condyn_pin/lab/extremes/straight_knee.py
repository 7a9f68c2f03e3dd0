"""A leg that is held at both ends, nearly stretched."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.constraints.loop import Loop
from condyn_pin.dynamics.scene import Scene
from condyn_pin.lab.extremes.base import Case, extreme, powers
from condyn_pin.mechanism.projection import project_velocity
from condyn_pin.model.mechanisms.chain import chain
from condyn_pin.model.robot import Robot


@extreme(severities=(1.0, *powers(-1, -12, -1), 0.0))
def straight_knee(severity: float, rng: np.random.Generator) -> Case:
    """Angle of three links of a leg to the line between its held ends [rad].

    Stretched, the rows along the leg hold less and less, and forces grow without bound before.
    """
    leg = chain(3)
    q = severity * np.array([1.0, -2.0, 1.5])
    turns = np.cumsum(q)
    tip = np.array([np.cos(turns).sum(), 0.0, np.sin(turns).sum()])
    leg = leg.with_frame("held", "world", tip)
    scene = Scene(_standing(leg, q), [Loop("joint2_tip", "held", "planar", axis="y")])
    v = project_velocity(scene, q, rng.normal(size=3))
    return Case(scene, q, v, rng.normal(size=3))


def _standing(leg: Robot, q: Array) -> Robot:
    """Return the leg with q as its posture, so that the scene is measured there."""
    return replace(leg, postures={"held": q})
