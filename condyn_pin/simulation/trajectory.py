"""Trajectory: a motion that was simulated."""

from __future__ import annotations

from dataclasses import dataclass

from condyn_pin.arrays import Array
from condyn_pin.scene import Scene


@dataclass(frozen=True, eq=False)
class Trajectory:
    """A motion, one sample a row."""

    scene: Scene
    t: Array
    q: Array
    v: Array
    a: Array
    lam: Array
