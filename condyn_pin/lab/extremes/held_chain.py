"""A long chain that is held at its tip too."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from condyn_pin.constraints.loop import Loop
from condyn_pin.dynamics.scene import Scene
from condyn_pin.lab.extremes.base import Case, extreme, whole
from condyn_pin.mechanism.projection import project_velocity
from condyn_pin.model.mechanisms.chain import chain


@extreme(severities=(3, 5, 10, 20, 50, 100))
def held_chain(severity: float, rng: np.random.Generator) -> Case:
    """How many rods there are in a chain with a ball at its tip."""
    n = whole(severity)
    links = chain(n)
    q = rng.normal(size=n) * 0.3
    turns = np.cumsum(q)
    tip = np.array([np.cos(turns).sum(), 0.0, np.sin(turns).sum()])
    links = replace(links.with_frame("hook", "world", tip), postures={"held": q})
    scene = Scene(links, [Loop(f"joint{n - 1}_tip", "hook")])
    q, _ = scene.state()
    v = project_velocity(scene, q, rng.normal(size=n) / n)
    return Case(scene, q, v, rng.normal(size=n))
