"""A smaller robot: joints welded at a configuration, or bodies cut off, and what hangs on them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TypeVar

from condyn_pin._core.arrays import Array
from condyn_pin._core.joints import indices
from condyn_pin.constraints.base import Constraint
from condyn_pin.errors import UnknownName
from condyn_pin.model.robot import Robot
from condyn_pin.model.smaller_tree import smaller_tree
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
    loops, _ = sifted(bare, robot.loops)
    contacts, _ = sifted(bare, robot.contacts)
    dampers = tuple(each for each in robot.spring_dampers if _pulls(bare, each))
    return replace(bare, loops=loops, contacts=contacts, spring_dampers=dampers)


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
        first, second = constraint.sides(robot)
    except UnknownName:
        return False
    return first != second


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
