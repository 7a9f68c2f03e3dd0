"""A row that constrains nothing but for rounding."""

from __future__ import annotations

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.constraints.loop import Loop
from condyn_pin.dynamics.scene import Scene
from condyn_pin.lab.extremes.base import Case, extreme, powers
from condyn_pin.lab.extremes.planar_chain import accelerations
from condyn_pin.model.mechanisms.chain import chain


@extreme(severities=(1.0, *powers(-1, -17, -1), 0.0))
def empty_row(severity: float, rng: np.random.Generator) -> Case:
    """Distance of the hub of a rod from the pivot that its tip turns about [m].

    The rod holds its arm still: a = 0 there. At zero it keeps a distance that nothing changes, and
    the arm is free; its row of J is rounding then.
    """
    links = chain(2)
    links = links.with_frame("hub", "world", [0.0, 0.0, severity])
    q = rng.normal(size=2)
    tip = np.array([np.cos(q[0]), 0.0, np.sin(q[0]) - severity])
    scene = Scene(links, [Loop("joint0_tip", "hub", "rod", length=float(np.linalg.norm(tip)))])
    v, tau = np.array([0.0, rng.normal()]), rng.normal(size=2)
    free = accelerations(q, v, tau)
    held = np.array([0.0, _second_alone(q, tau)])
    right = (free,) if severity == 0.0 else (held,) if severity > 1e-12 else (held, free)
    return Case(scene, q, v, tau, right)


def _second_alone(q: Array, tau: Array) -> float:
    """Return the acceleration of the outer rod with the inner one held: m L^2 / 3 about its end."""
    return float(3.0 * (tau[1] - 9.81 / 2 * np.cos(q[0] + q[1])))
