"""Pressure: where a robot touches a floor, and how it presses on it there.

A contact exerts the force f and the moment m about its point p on the robot. On a floor of normal e
its centre of pressure is

    p + e x m / (f . e)        if it presses: f . e > 0.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array
from condyn_pin.control.support import touching_points
from condyn_pin.dynamics.solution import Sites, upward


class Pressure(NamedTuple):
    """What touches a floor at one instant, and how it presses on it.

    Attributes
    ----------
    points : (k, 3) array
        The corners of what touches, in the world [m].
    exerted : (6,) array
        The wrench on the robot about the origin of the world, force first [N, N m].
    cops : dict of str to (3,) array
        Centre of pressure of each contact; NaN of those that do not press [m].
    forces : dict of str to (3,) array
        On the robot, of those that press, in the world [N].
    """

    points: Array
    exerted: Array
    cops: dict[str, Array]
    forces: dict[str, Array]


def pressed(at: Sites, lam: Array) -> Pressure:
    """Return how the contacts of a scene press on the floor with the forces lam (m,)."""
    exerted, cops, pressing = np.zeros(6), {}, {}
    robot = at.scene.robot
    weight = robot.mass * float(np.linalg.norm(robot.unedited.gravity.linear))
    noise = tolerances.SOLVED * max(weight, float(np.abs(lam).max(initial=0.0)))
    forces, up = at.forces(lam), upward(at.scene)
    for contact in at.scene.constraints:
        if not contact.presses:
            continue
        force = forces[contact.name]
        whole = np.zeros(6)
        whole[: len(force)] = force.in_world()
        f, m, p = whole[:3], whole[3:], force.at
        exerted += np.concatenate((f, m + np.cross(p, f)))
        normal = force.rotation[:, 2] if contact.has_normal else up
        load = float(f @ normal)
        if load > noise:
            cops[contact.name] = p + np.cross(normal, m) / load
            pressing[contact.name] = f
        else:
            cops[contact.name] = np.full(3, np.nan)
    return Pressure(touching_points(at), exerted, cops, pressing)
