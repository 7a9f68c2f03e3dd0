"""Joints locked where their springs rest: a smaller robot, every frame where it was."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from condyn_pin import tolerances
from condyn_pin._pin import pin
from condyn_pin.arrays import Array
from condyn_pin.constraints import WORLD, Coupling, Loop
from condyn_pin.errors import InvalidArgument, InvalidModel, unknown_name
from condyn_pin.robot import Robot
from condyn_pin.rows.binding import bind
from condyn_pin.rows.equations import Equations


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
        contacts. Postures lose the values of locked joints; springs and motors on them are gone,
        and so are loops between bodies that do not move against each other any more.

    Raises
    ------
    UnknownName
        If there is no such joint.
    InvalidModel
        If nothing would be left to move, a loop would be held open, or a joint is locked and the
        one coupled to it is not.
    """
    if isinstance(names, str) or not all(isinstance(name, str) for name in names):
        raise InvalidArgument(f"lock = {names!r}: a list of names of joints is needed")
    for name in names:
        if name not in robot.joints:
            raise unknown_name("joint", name, robot.joints)
    if not names:
        return robot
    q = _rest(robot)
    model = _reduced(robot, names, q)
    sentence = f"joints that are locked: {', '.join(map(repr, names))}"
    return replace(
        robot,
        model=model,
        postures={key: _without(robot.model, model, q) for key, q in robot.postures.items()},
        loops=[loop for loop in robot.loops if not _is_idle(loop, robot, model, names, q)],
        actuated=[joint for joint in robot.actuated if joint not in names],
        springs=[spring for spring in robot.springs if spring.joint not in names],
        unused=(*robot.unused, sentence),
    )


def _rest(robot: Robot) -> Array:
    """Return the configuration with every spring at its reference, and neutral otherwise."""
    q = np.array(pin.neutral(robot.model))
    for spring in robot.springs:
        q[robot.model.joints[robot.model.getJointId(spring.joint)].idx_q] = spring.reference
    return q


def _reduced(robot: Robot, names: Sequence[str], q: Array) -> Any:
    """Return the model without the joints of these names, which stay where q has them."""
    if set(robot.joints) <= set(names):
        raise InvalidModel("lock: these are all joints of the robot; leave one that moves")
    model = robot.model
    return pin.buildReducedModel(model, sorted({int(model.getJointId(n)) for n in names}), q)


def _without(model: Any, reduced: Any, q: Array) -> Array:
    """Return the part of q that belongs to the joints of the reduced model."""
    parts = []
    for name in tuple(reduced.names)[1:]:
        joint = model.joints[model.getJointId(name)]
        parts.append(q[joint.idx_q : joint.idx_q + joint.nq])
    return np.concatenate(parts)


def _is_idle(
    loop: Loop | Coupling, robot: Robot, reduced: Any, names: Sequence[str], q: Array
) -> bool:
    """Whether a loop has nothing left to hold, because what it joins is locked; it must be met."""
    if isinstance(loop, Coupling):
        held = [joint in names for joint in (loop.joint_a, loop.joint_b)]
        if any(held) and not all(held):
            raise InvalidModel(
                f"lock: {loop.joint_a!r} and {loop.joint_b!r} are coupled by {loop.name!r}; "
                "lock both, or leave the coupling out"
            )
    else:
        held = [_carrier(reduced, loop.frame_a) == _carrier(reduced, loop.frame_b)]
    if not all(held):
        return False
    gap = np.abs(Equations(robot.model, bind(robot, [loop])).violation(q)).max()
    if gap > tolerances.CLOSED:
        raise InvalidModel(
            f"lock: {loop.name!r} would be held open by {gap:.3g} m or rad; lock fewer joints"
        )
    return True


def _carrier(model: Any, frame: str) -> int:
    """Return the joint that a frame moves with."""
    return 0 if frame in WORLD else int(model.frames[model.getFrameId(frame)].parentJoint)
