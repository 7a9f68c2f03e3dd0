"""put_down: a floating robot on the ground that its contacts may touch."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import normalised
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.contacts.candidates import Candidates
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.scene_checks import check_scene
from condyn_pin.errors import InvalidArgument

# Shifts until every plane is clear: one for each of those that form a wedge, and some.
_SHIFTS = 20


def put_down(scene: Scene, q: ArrayLike) -> Array:
    """Return a configuration with the floating base shifted until the lowest contact just touches.

    x <- x - gap n,  with gap and n of the contact that is lowest, until none is below its plane

    Parameters
    ----------
    scene : Scene
        With contacts that may let go.
    q : (nq,) array_like
        Only the base moves; the joints, and with them the loops, stay as they are.

    Returns
    -------
    q : (nq,) array
        q as given, if the robot has no floating base or no contact has a plane below it.

    Raises
    ------
    InvalidArgument
        If q is no configuration, or the contacts of the scene are constraints, which never let go.
    """
    check_scene(scene)
    model = scene.robot.unedited
    placed = normalised(model, "q", q)
    if not scene.contacts and any(each.presses for each in scene.constraints):
        raise InvalidArgument(
            "scene: its contacts are held where they are; one with contacts that may let go is "
            "needed, Scene(robot, contacts=robot.frictional_contacts(friction=0.7))"
        )
    candidates = Candidates(model, scene.contact_bounds)
    if not candidates.cones or model.joints[1].shortname() != "JointModelFreeFlyer":
        return placed
    data = model.createData()
    for _ in range(_SHIFTS):
        pin.forwardKinematics(model, data, placed)
        gaps = candidates.gaps(data, placed)[: candidates.cones]
        lowest = int(gaps.argmin())
        if not tolerances.CLOSED < abs(gaps[lowest]) < np.inf:
            break
        placed[:3] -= gaps[lowest] * candidates.axes(data, placed)[lowest, :, 2]
    return placed
