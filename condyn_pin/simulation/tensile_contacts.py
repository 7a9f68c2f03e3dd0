"""Contacts that pull in a motion, as no ground does.

A run keeps its contacts until an event takes them off: between events they are bilateral.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.base import Constraint
from condyn_pin.dynamics.force import pull_text, upward
from condyn_pin.simulation.measures import gauge_of

if TYPE_CHECKING:
    from condyn_pin.dynamics.scene import Scene
    from condyn_pin.simulation.trajectory import Trajectory


def tensile_contact_notices(trajectory: Trajectory) -> list[str]:
    """Return a sentence for each contact that pulls, with the largest pull and its time."""
    forces = trajectory.forces
    worst: dict[str, tuple[float, float, Constraint]] = {}  # normal force [N], t [s]
    for phase in trajectory.phases:
        t, q = trajectory.t[phase.samples], trajectory.q[phase.samples]
        for i, constraint in enumerate(phase.scene.constraints):
            force = forces[constraint.name][phase.samples]
            if not constraint.presses:
                continue
            along = force[:, :3]
            normal = force[:, 2] if constraint.has_normal else _upwards(phase.scene, i, q, along)
            k = int(normal.argmin())
            if constraint.name not in worst or normal[k] < worst[constraint.name][0]:
                worst[constraint.name] = float(normal[k]), float(t[k]), constraint
    least = -tolerances.SOLVED * float(np.abs(trajectory.lam).max(initial=0.0))
    return [
        f"{pull_text(constraint, f'{-normal:.4g} N at t = {t:.4g} s')}; an Event takes it off"
        for normal, t, constraint in worst.values()
        if normal < least
    ]


def _upwards(scene: Scene, i: int, q: Array, force: Array) -> Array:
    """Return the parts (k,) against gravity of the forces (k, 3) of constraint i, its own axes."""
    up, equations = upward(scene), gauge_of(scene).equations
    ends: list[Any] = [equations.placements(each)[i] for each in q]
    return np.array([up @ one.rotation @ f for (one, _), f in zip(ends, force, strict=True)])
