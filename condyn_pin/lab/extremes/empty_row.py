"""A row that constrains nothing but for rounding."""

import numpy as np

from condyn_pin.constraints.loop import Loop
from condyn_pin.dynamics.scene import Scene
from condyn_pin.lab.extremes.base import Case, Rng, extreme, near, powers
from condyn_pin.lab.extremes.planar_chain import accelerations
from condyn_pin.model.mechanisms.chain import chain


@extreme(1.0, *powers(-1, -17, -1), 0.0)
def empty_row(severity: float, rng: Rng) -> Case:
    """Distance of the hub of a rod from the pivot that its tip turns about [m].

    The rod holds its arm still: a = 0 there. At zero it keeps a distance that nothing changes, and
    the arm is free; its row of J is rounding then.
    """
    links = chain(2).with_frame("hub", "world", [0.0, 0.0, severity])
    q = rng.normal(size=2)
    tip = np.array([np.cos(q[0]), 0.0, np.sin(q[0]) - severity])
    scene = Scene(links, [Loop("joint0_tip", "hub", "rod", length=float(np.linalg.norm(tip)))])
    v, tau = np.array([0.0, rng.normal()]), rng.normal(size=2)
    # the outer rod alone: m L^2 / 3 about its end
    alone = float(3.0 * (tau[1] - 9.81 / 2 * np.cos(q[0] + q[1])))
    held, free = np.array([0.0, alone]), accelerations(q, v, tau)
    return Case(scene, q, v, tau, near(severity, held, free, 1e-12))
