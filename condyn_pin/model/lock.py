"""Joints of a description locked where their springs rest: a smaller robot, every frame kept."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import checked
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.kinds import bind
from condyn_pin.constraints.rows.bound import gap_of
from condyn_pin.constraints.rows.equations import Equations
from condyn_pin.errors import InvalidModel
from condyn_pin.model.robot import Robot
from condyn_pin.model.smaller_robot import smaller_robot


def lock_joints(robot: Robot, names: Sequence[str]) -> Robot:
    """Return a robot without the freedom of some of its joints.

    Parameters
    ----------
    robot : Robot
    names : sequence of str
        Joints to lock: at the reference of their spring, else at neutral.

    Returns
    -------
    Robot
        The bodies of a locked joint move as one. All frames are kept. Postures lose the values of
        locked joints; springs and motors on them are gone, and so are loops and contacts between
        bodies that do not move against each other any more.

    Raises
    ------
    UnknownName
        If there is no such joint.
    InvalidModel
        If nothing would be left to move, a loop would be held open, or a joint is locked and the
        one coupled to it is not.
    """
    locked = checked("lock", names, robot.joints, "joint")
    if not locked:
        return robot
    if len(locked) == len(robot.joints):
        raise InvalidModel("lock: these are all joints of the robot; leave one that moves")
    _check_couplings(robot, locked)
    q = _rest(robot)
    small = smaller_robot(
        robot, locked, q, f"joints that are locked: {', '.join(map(repr, locked))}"
    )
    _check_idle(robot, small, q)
    return small


def _rest(robot: Robot) -> Array:
    """Return the configuration with every spring at its reference, and neutral otherwise."""
    q = np.array(pin.neutral(robot.model))
    for spring in robot.springs:
        q[robot.model.joints[robot.model.getJointId(spring.joint)].idx_q] = spring.reference
    return q


def _check_couplings(robot: Robot, locked: Sequence[str]) -> None:
    """Refuse to lock one joint of a coupling without the other."""
    for loop in robot.loops:
        if 0 < len(set(loop.joints) & set(locked)) < len(set(loop.joints)):
            raise InvalidModel(
                f"lock: {' and '.join(map(repr, loop.joints))} are coupled by {loop.name!r}; "
                "lock both, or leave the coupling out"
            )


def _check_idle(robot: Robot, small: Robot, q: Array) -> None:
    """Refuse locked joints that hold a loop open which has nothing left to close it."""
    for loop in robot.loops:
        if loop in small.loops:
            continue
        (bound,) = bind(robot, [loop])
        gap = gap_of(robot.model, bound, Equations(robot.model, [bound]).violation(q))
        if gap.size > tolerances.CLOSED:
            raise InvalidModel(
                f"lock: {loop.name!r} would be held open by {gap}; lock fewer joints"
            )
