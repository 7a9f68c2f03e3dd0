"""put_down: a floating robot on the ground that its contacts may touch."""

from __future__ import annotations

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.contacts.candidates import Candidates
from condyn_pin.dynamics.scene import Scene

# Shifts until every plane is clear: one for each of those that form a wedge, and some.
_SHIFTS = 20


def put_down(scene: Scene, q: Array) -> Array:
    """Return q (nq,) with the floating base shifted until the lowest contact just touches.

    q + n (-gap) along the normal of the contact with the least gap, until none is below zero. What
    does not float, and what touches no plane, stays where it is.
    """
    model = scene.robot.unedited
    candidates = Candidates(model, scene.contact_bounds)
    if not candidates.cones or model.joints[1].shortname() != "JointModelFreeFlyer":
        return q
    q, data = q.copy(), model.createData()
    for _ in range(_SHIFTS):
        pin.forwardKinematics(model, data, q)
        gaps = candidates.gaps(data, q)[: candidates.cones]
        lowest = int(gaps.argmin())
        if abs(gaps[lowest]) <= tolerances.CLOSED:
            break
        q[:3] -= gaps[lowest] * candidates.axes(data, q)[lowest, :, 2]
    return np.asarray(q)
