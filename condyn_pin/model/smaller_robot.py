"""A smaller robot: joints welded at a configuration, or bodies cut off, and what hangs on them.

The body of a welded joint becomes part of its parent's body, at the placement that q gives it; that
of a joint that is cut off disappears with its frames. Pinocchio's `buildReducedModel` welds too,
but needs a frame of type JOINT for every joint, crashes in Pinocchio 4 where one is missing, and
cuts nothing off.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from condyn_pin._core import _pin
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array, Indices
from condyn_pin._core.joints import indices
from condyn_pin._core.trees import whole_data
from condyn_pin.constraints.base import Constraint
from condyn_pin.errors import InvalidArgument, UnknownName
from condyn_pin.model.robot import Robot
from condyn_pin.model.spring import SpringDamper

_AnyConstraint = TypeVar("_AnyConstraint", bound=Constraint)


def smaller_robot(
    robot: Robot, joints: Sequence[str], q: Array, remark: str, *, cut: bool = False
) -> Robot:
    """Return the robot with some joints welded at q, or with their bodies cut off.

    Everything that belongs to the other joints is kept: postures, motors, springs, armature,
    damping, friction, rotors, limits. Loops and contacts that no longer constrain anything go.

    Parameters
    ----------
    robot : Robot
    joints : sequence of str
    q : (nq,) array
        Configuration [rad, m].
    remark : str
        What the summary says about it.
    cut : bool
        Cut the bodies off, with all that is on them. Each joint has to end a branch once the
        others are gone.
    """
    left = [name for name in robot.joints if name not in joints]
    index_q, _ = indices(robot.model, left)
    bare = replace(
        robot,
        model=smaller_tree(robot.model, joints, q, cut=cut),
        postures={name: posture[index_q] for name, posture in robot.postures.items()},
        loops=(),
        contacts=(),
        actuated=tuple(name for name in robot.actuated if name not in joints),
        springs=tuple(spring for spring in robot.springs if spring.joint not in joints),
        spring_dampers=(),
        unused=(*robot.unused, remark),
    )
    loops, _ = sifted(bare, robot.loops if cut else with_held(robot, robot.loops, joints, q))
    contacts, _ = sifted(bare, robot.contacts)
    dampers = tuple(each for each in robot.spring_dampers if _pulls(bare, each))
    return replace(bare, loops=loops, contacts=contacts, spring_dampers=dampers)


def with_held(
    robot: Robot, constraints: Sequence[Constraint], joints: Sequence[str], q: Array
) -> tuple[Constraint, ...]:
    """Constraints with some joints held at q."""
    model = robot.model
    places = {name: model.joints[model.getJointId(name)] for name in joints}
    values = {name: float(q[joint.idx_q]) for name, joint in places.items() if joint.nq == 1}
    return tuple(constraint.with_held(values) for constraint in constraints)


def sifted(
    robot: Robot, constraints: Sequence[_AnyConstraint]
) -> tuple[tuple[_AnyConstraint, ...], tuple[_AnyConstraint, ...]]:
    """Return the constraints that constrain this robot, and those that do not.

    A constraint is idle if both of its sides belong to one body, or if a body of it was cut off.
    """
    at_work: list[_AnyConstraint] = []
    idle: list[_AnyConstraint] = []
    for constraint in constraints:
        (at_work if _constrains(robot, constraint) else idle).append(constraint)
    return tuple(at_work), tuple(idle)


def _constrains(robot: Robot, constraint: Constraint) -> bool:
    try:
        return len(set(constraint.sides(robot))) > 1
    except UnknownName:
        return False


def _pulls(robot: Robot, each: SpringDamper) -> bool:
    """Whether a spring-damper has its ends on two bodies of this robot."""
    try:
        return robot.frame(each.frame_a)[0] != robot.frame(each.frame_b)[0]
    except UnknownName:
        return False


def free_flyers(robot: Robot) -> tuple[str, ...]:
    """Return the joints by which the robot floats in the world."""
    model = robot.model
    return tuple(
        str(name)
        for name, joint, parent in zip(model.names, model.joints, model.parents, strict=True)
        if parent == 0 and joint.shortname() == "JointModelFreeFlyer"
    )


def smaller_tree(model: Any, joints: Collection[str], q: Array, *, cut: bool = False) -> Any:
    """Return a model without some joints, the others depth-first, every other number of it kept.

    Parameters
    ----------
    model : pin.Model
    joints : collection of str
        What goes.
    q : (nq,) array
        Where the joints are welded.
    cut : bool
        Cut their bodies off, with all that is on them, instead of welding them. Each joint has to
        end a branch once the others are gone.
    """
    small = pin.Model()
    small.name = model.name
    small.gravity = pin.Motion(model.gravity.vector.copy())
    small.inertias[0] = pin.Inertia(model.inertias[0])
    data = whole_data(model)
    pin.forwardKinematics(model, data, q)
    # joint of the small tree, and the old joint's place on it
    carriers = [(0, pin.SE3.Identity())] * model.njoints
    for i in _depth_first(model):
        carrier, placement = carriers[model.parents[i]]
        if model.names[i] in joints:
            carriers[i] = carrier, placement * data.liMi[i]
        else:
            on_carrier = placement * model.jointPlacements[i]
            number = small.addJoint(carrier, model.joints[i], on_carrier, model.names[i])
            carriers[i] = number, pin.SE3.Identity()
        if not (cut and model.names[i] in joints):
            small.appendBodyToJoint(carriers[i][0], model.inertias[i], carriers[i][1])
    _copy_frames(model, small, carriers, joints, cut)
    kept = list(small.names)[1:]
    copy_numbers(model, small, kept)
    index_q, _ = indices(model, kept)
    for entry in model.referenceConfigurations:
        small.referenceConfigurations[entry.key()] = np.array(entry.data())[index_q]
    return small


def depth_first(model: Any) -> tuple[Any, Indices, Indices]:
    """Return a model whose joints are in the order that Pinocchio's algorithms need.

    The children of a joint come before its siblings.

    Parameters
    ----------
    model : pin.Model
        With joints in any order.

    Returns
    -------
    model : pin.Model
        The same machine.
    index_q, index_v : (nq,), (nv,) array of int
        ``q[index_q]`` and ``v[index_v]`` are those of it, for q and v of the given model.

    Raises
    ------
    InvalidArgument
        If it is no model.
    """
    if not isinstance(model, pin.Model):
        raise InvalidArgument(f"model = {type(model).__name__}: a pinocchio.Model is needed")
    ordered = smaller_tree(model, (), np.array(pin.neutral(model)))
    return ordered, *indices(model, list(ordered.names)[1:])


def _depth_first(model: Any) -> Iterator[int]:
    """Yield all joints, each before what it carries, and that before what is beside it."""
    children = [list[int]() for _ in range(model.njoints)]
    for i in range(model.njoints - 1, 0, -1):
        children[model.parents[i]].append(i)
    waiting = children[0]
    while waiting:
        i = waiting.pop()
        yield i
        waiting += children[i]


def _copy_frames(
    model: Any, small: Any, carriers: Sequence[Any], joints: Collection[str], cut: bool
) -> None:
    numbers = [0]  # of each old frame in the small tree; frames that are gone count as the world's
    for frame in list(model.frames)[1:]:
        gone = frame.parentJoint > 0 and model.names[frame.parentJoint] in joints
        if gone and cut:
            numbers.append(0)
            continue
        carrier, placement = carriers[frame.parentJoint]
        welded_joint = frame.type == pin.FrameType.JOINT and frame.name in joints
        kind = pin.FrameType.FIXED_JOINT if welded_joint else frame.type
        parent = numbers[frame.parentFrame] if frame.parentFrame < len(numbers) else 0
        made = pin.Frame(
            frame.name, carrier, parent, placement * frame.placement, kind, frame.inertia
        )
        # the inertia is on the joint already
        numbers.append(small.addFrame(made, False))


def copy_numbers(model: Any, made: Any, joints: Sequence[str]) -> None:
    """Give a model the limits, armatures and so on that another one has of these joints."""
    of_q, of_v = zip(indices(model, joints), indices(made, joints), strict=True)
    for (old, new), numbers in ((of_q, _pin.NUMBERS_OF_Q), (of_v, _pin.NUMBERS_OF_V)):
        for each in numbers:
            values = np.array(getattr(made, each))
            values[new] = np.array(getattr(model, each))[old]
            setattr(made, each, values)
