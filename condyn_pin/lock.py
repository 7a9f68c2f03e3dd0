"""Joints locked where their springs rest: a smaller robot, every frame where it was."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from condyn_pin._pin import pin
from condyn_pin.arrays import Array
from condyn_pin.constraints import Coupling
from condyn_pin.errors import InvalidArgument, InvalidModel, unknown_name
from condyn_pin.robot import Robot


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
        The bodies of a locked joint move as one. All frames are kept, and with them loops and
        contacts. Postures lose the values of locked joints; springs and motors on them are gone.

    Raises
    ------
    UnknownName
        If there is no such joint.
    InvalidModel
        If nothing would be left to move, or a joint is locked and the one coupled to it is not.
    """
    if isinstance(names, str) or not all(isinstance(name, str) for name in names):
        raise InvalidArgument(f"lock = {names!r}: a list of names of joints is needed")
    for name in names:
        if name not in robot.joints:
            raise unknown_name("joint", name, robot.joints)
    if not names:
        return robot
    model = _reduced(robot, names)
    sentence = f"joints that are locked: {', '.join(map(repr, names))}"
    return replace(
        robot,
        model=model,
        postures={key: _without(robot.model, model, q) for key, q in robot.postures.items()},
        loops=[loop for loop in robot.loops if not _holds(loop, names)],
        actuated=[joint for joint in robot.actuated if joint not in names],
        springs=[spring for spring in robot.springs if spring.joint not in names],
        unused=(*robot.unused, sentence),
    )


def _reduced(robot: Robot, names: Sequence[str]) -> Any:
    """Return the model with the joints at rest in place of joints that move."""
    if set(robot.joints) <= set(names):
        raise InvalidModel("lock: these are all joints of the robot; leave one that moves")
    model = robot.model
    q = np.array(pin.neutral(model))
    for spring in robot.springs:
        q[model.joints[model.getJointId(spring.joint)].idx_q] = spring.reference
    return pin.buildReducedModel(model, sorted({int(model.getJointId(n)) for n in names}), q)


def _without(model: Any, reduced: Any, q: Array) -> Array:
    """Return the part of q that belongs to the joints of the reduced model."""
    parts = []
    for name in tuple(reduced.names)[1:]:
        joint = model.joints[model.getJointId(name)]
        parts.append(q[joint.idx_q : joint.idx_q + joint.nq])
    return np.concatenate(parts)


def _holds(loop: Any, names: Sequence[str]) -> bool:
    """Whether a loop is a coupling of two joints that are both locked."""
    if not isinstance(loop, Coupling):
        return False
    locked = [joint in names for joint in (loop.joint_a, loop.joint_b)]
    if any(locked) and not all(locked):
        raise InvalidModel(
            f"lock: {loop.joint_a!r} and {loop.joint_b!r} are coupled by {loop.name!r}; "
            "lock both, or leave the coupling out"
        )
    return all(locked)
