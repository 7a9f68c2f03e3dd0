"""Bars that are too short to meet."""

from dataclasses import replace

import numpy as np

from condyn_pin.constraints.loop import Loop
from condyn_pin.dynamics.scene import Scene
from condyn_pin.lab.extremes.base import Case, Rng, extreme, powers, torques
from condyn_pin.model.mechanisms.chain import chain


@extreme(-1.0, -1e-1, -1e-2, -1e-4, -1e-6, -1e-8, 0.0, *powers(-15, 0))
def unreachable(severity: float, rng: Rng) -> Case:
    """How far a hook is beyond the reach of a chain of two rods [m]; negative within it."""
    links = chain(2).with_frame("hook", "world", [2.0 + severity, 0.0, 0.0])
    links = replace(links, postures={"bent": np.array([0.3, -0.6])})
    scene = Scene(links, [Loop("joint1_tip", "hook", "planar", axis="y")])
    q, v = scene.state()
    return Case(scene, q, v, torques(scene, rng))
