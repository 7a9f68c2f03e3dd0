"""Rods without mass in a row, in a closed chain."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.constraints.loop import Loop
from condyn_pin.dynamics.scene import Scene
from condyn_pin.lab.extremes.base import Case, extreme, whole, with_inertias
from condyn_pin.mechanism.projection import project_velocity
from condyn_pin.model.mechanisms.base import rod
from condyn_pin.model.mechanisms.chain import chain


@extreme(severities=(0, 1, 2, 3, 5, 10))
def massless_row(severity: float, rng: np.random.Generator) -> Case:
    """How many rods without mass there are in a row, between two of 1 kg, the last held at its tip.

    Up to two of them move only with the last rod, which has three ways to go; of more, nothing
    says how they move.
    """
    n = whole(severity)
    masses = (1.0, *n * (0.0,), 1.0)
    links = chain(len(masses))
    q = _zigzag(len(masses), rng)
    turns = np.cumsum(q)
    links = links.with_frame("hook", "world", [np.cos(turns).sum(), 0.0, np.sin(turns).sum()])
    inertias = [links.model.inertias[0], *(rod(1.0, mass) for mass in masses)]
    light = replace(links, model=with_inertias(links.model, inertias), postures={"held": q})
    scene = Scene(light, [Loop(f"joint{n + 1}_tip", "hook")])
    v = project_velocity(scene, q, rng.normal(size=n + 2))
    return Case(scene, q, v, rng.normal(size=n + 2))


def _zigzag(n: int, rng: np.random.Generator) -> Array:
    """Return angles of n rods that are far from stretched."""
    return (-1.0) ** np.arange(n) * rng.uniform(0.5, 1.5, size=n)
