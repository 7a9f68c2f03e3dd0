"""Robots locked, cut, put together, weighed anew.

A smaller robot: joints welded at a configuration, or bodies cut off, and what hangs on them.

The body of a welded joint becomes part of its parent's body, at the placement that q gives it; that
of a joint that is cut off disappears with its frames. Pinocchio's `buildReducedModel` welds too,
but needs a frame of type JOINT for every joint, crashes in Pinocchio 4 where one is missing, and
cuts nothing off.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from condyn_pin._core import _pin, tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import checked_names
from condyn_pin._core.arrays import Array, Indices
from condyn_pin._core.models import indices, whole_data
from condyn_pin.constraints.constraint import Constraint
from condyn_pin.constraints.kinds import bind
from condyn_pin.constraints.places import WORLD, place_of
from condyn_pin.constraints.rows.bound import gap_of
from condyn_pin.constraints.rows.equations import Equations
from condyn_pin.errors import InvalidArgument, InvalidModel, UnknownName
from condyn_pin.model.joints import CoupledMotor
from condyn_pin.model.robot import Robot
from condyn_pin.model.springs import SpringDamper

_AnyConstraint = TypeVar("_AnyConstraint", bound=Constraint)


def smaller_robot(
    robot: Robot, joints: Sequence[str], q: Array, remark: str, *, cut: bool = False
) -> Robot:
    """Return the robot with some joints welded at q, or with their bodies `cut` off."""
    # Everything that belongs to the other joints is kept: postures, motors, springs, armature,
    # damping, friction, rotors, limits. Loops and contacts that no longer constrain anything go.
    # Each joint that is cut has to end a branch once the others are gone. `remark` is what the
    # summary says about it.
    left = [name for name in robot.joints if name not in joints]
    index_q, _ = indices(robot.model, left)
    model = smaller_tree(robot.model, joints, q, cut=cut)
    known = {*(frame.name for frame in model.frames), *left, *WORLD}
    bare = replace(
        robot,
        model=model,
        postures={name: posture[index_q] for name, posture in robot.postures.items()},
        loops=(),
        contacts=(),
        actuated=tuple(name for name in robot.actuated if name not in joints),
        coupled_motors=tuple(_on_others(robot.coupled_motors, joints)),
        springs=tuple(spring for spring in robot.springs if spring.joint not in joints),
        spring_dampers=(),
        unused=(*robot.unused, remark),
        exclusions=[here for each in robot.exclusions if len(here := known.intersection(each)) > 1],
    )
    loops, _ = split_constraints(
        bare, robot.loops if cut else with_held(robot, robot.loops, joints, q)
    )
    contacts, _ = split_constraints(bare, robot.contacts)
    dampers = tuple(each for each in robot.spring_dampers if _connects_bodies(bare, each))
    return replace(bare, loops=loops, contacts=contacts, spring_dampers=dampers)


def _on_others(motors: Sequence[CoupledMotor], joints: Sequence[str]) -> Iterator[CoupledMotor]:
    """Yield the motors that act on other joints too, on those alone."""
    for motor in motors:
        if left := {joint: w for joint, w in motor.weights.items() if joint not in joints}:
            yield replace(motor, joints=left)


def with_held(
    robot: Robot, constraints: Sequence[Constraint], joints: Sequence[str], q: Array
) -> tuple[Constraint, ...]:
    """Constraints with some joints held at q."""
    model = robot.model
    places = {name: model.joints[model.getJointId(name)] for name in joints}
    values = {name: float(q[joint.idx_q]) for name, joint in places.items() if joint.nq == 1}
    return tuple(constraint.with_held(values) for constraint in constraints)


def split_constraints(
    robot: Robot, constraints: Sequence[_AnyConstraint]
) -> tuple[tuple[_AnyConstraint, ...], tuple[_AnyConstraint, ...]]:
    """Constraints between bodies of this robot, and the others."""
    # A constraint is idle if both of its sides belong to one body, or if a body of it was cut off.
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


def _connects_bodies(robot: Robot, each: SpringDamper) -> bool:
    """True if the ends of a spring-damper are on two bodies of this robot."""
    try:
        return robot.frame(each.frame_a)[0] != robot.frame(each.frame_b)[0]
    except UnknownName:
        return False


def free_flyers(robot: Robot) -> tuple[str, ...]:
    """Names of the free-flyer joints by which the robot floats in the world."""
    model = robot.model
    return tuple(
        str(name)
        for name, joint, parent in zip(model.names, model.joints, model.parents, strict=True)
        if parent == 0 and joint.shortname() == "JointModelFreeFlyer"
    )


def smaller_tree(model: Any, joints: Collection[str], q: Array, *, cut: bool = False) -> Any:
    """Model without some joints, as `smaller_robot`; the others are depth-first."""
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
    """Yield all joints depth-first: the children of a joint before its siblings."""
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
    # a built model has joints without frames, which constraints name all the same
    framed = {f.name for f in model.frames if f.type == pin.FrameType.JOINT}
    for i in range(1, model.njoints):
        if not cut and model.names[i] in joints and model.names[i] not in framed:
            fixed = pin.FrameType.FIXED_JOINT
            small.addFrame(pin.Frame(model.names[i], carriers[i][0], 0, carriers[i][1], fixed))


def copy_numbers(model: Any, made: Any, joints: Sequence[str]) -> None:
    """Copy limits, armatures and other numbers of some joints from one model to another."""
    of_q, of_v = zip(indices(model, joints), indices(made, joints), strict=True)
    for (old, new), numbers in ((of_q, _pin.NUMBERS_OF_Q), (of_v, _pin.NUMBERS_OF_V)):
        for each in numbers:
            values = np.array(getattr(made, each))
            values[new] = np.array(getattr(model, each))[old]
            setattr(made, each, values)


# Joints of a description locked where their springs rest: a smaller robot, every frame kept.


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
    locked = checked_names("lock", names, robot.joints, "joint")
    if not locked:
        return robot
    if len(locked) == len(robot.joints):
        raise InvalidModel("lock: these are all joints of the robot; leave one that moves")
    _check_couplings(robot, locked)
    q = _spring_references(robot)
    small = smaller_robot(
        robot, locked, q, f"joints that are locked: {', '.join(map(repr, locked))}"
    )
    _check_idle(robot, small, q)
    return small


def _spring_references(robot: Robot) -> Array:
    """Configuration (nq,) with every spring at its reference, and neutral elsewhere."""
    q = np.array(pin.neutral(robot.model))
    for spring in robot.springs:
        q[robot.model.joints[robot.model.getJointId(spring.joint)].idx_q] = spring.reference
    return q


def _check_couplings(robot: Robot, locked: Sequence[str]) -> None:
    """Raise InvalidModel if one joint of a coupling is locked without the other."""
    for loop in robot.loops:
        if 0 < len(set(loop.joints) & set(locked)) < len(set(loop.joints)):
            raise InvalidModel(
                f"lock: {' and '.join(map(repr, loop.joints))} are coupled by {loop.name!r}; "
                "lock both, or leave the coupling out"
            )


def _check_idle(robot: Robot, small: Robot, q: Array) -> None:
    """Raise InvalidModel if locked joints hold a loop open."""
    for loop in robot.loops:
        if loop in small.loops:
            continue
        (bound,) = bind(robot, [loop])
        gap = gap_of(robot.model, bound, Equations(robot.model, [bound]).violation(q))
        if gap.size > tolerances.CLOSED:
            raise InvalidModel(
                f"lock: {loop.name!r} would be held open by {gap}; lock fewer joints"
            )


# Several robots as one, for contacts and loops between them.
#
# q = (q_1, q_2, ...),        M = diag(M_1, M_2, ...)


def together(robots: Mapping[str, Robot]) -> Robot:
    """Return several robots as one, without constraints between them.

    Parameters
    ----------
    robots : mapping of str to Robot
        By the names that are put before those of their joints, frames, loops and contacts:
        ``together({"left": arm, "right": arm})`` has the frames ``left/tool`` and ``right/tool``.
        The world keeps its name, and is one.

    Returns
    -------
    Robot
        With the postures of any of them, the first one's first; a robot that has none of that name
        takes its own first one.

    Raises
    ------
    InvalidArgument
        If there is no robot, or they fall with different gravity.
    """
    if not isinstance(robots, Mapping) or not robots:
        raise InvalidArgument(f"robots = {robots!r}: robots by their names are needed")
    for name, robot in robots.items():
        if not isinstance(name, str) or not name or not isinstance(robot, Robot):
            raise InvalidArgument(f"robots[{name!r}] = {robot!r}: a name and a Robot are needed")
        robot.check_unedited()
    first = next(iter(robots.values()))
    for name, robot in robots.items():
        if not np.array_equal(robot.model.gravity.vector, first.model.gravity.vector):
            raise InvalidArgument(
                f"robots[{name!r}]: its gravity is {robot.model.gravity.linear}, and "
                f"that of {next(iter(robots))!r} is {first.model.gravity.linear} [m/s^2]"
            )
    renames = {name: _prefixed(name) for name in robots}
    pairs = [(renames[name], robot) for name, robot in robots.items()]
    return Robot(
        " + ".join(robots),
        _model(robots, renames),
        postures=_postures(robots),
        loops=[loop.renamed(new) for new, robot in pairs for loop in robot.loops],
        contacts=[contact.renamed(new) for new, robot in pairs for contact in robot.contacts],
        actuated=[new(joint) for new, robot in pairs for joint in robot.actuated],
        coupled_motors=[_renamed(m, new) for new, robot in pairs for m in robot.coupled_motors],
        springs=[
            replace(each, joint=new(each.joint)) for new, robot in pairs for each in robot.springs
        ],
        unused=[f"{name}: {text}" for name, robot in robots.items() for text in robot.unused],
        unmodelled=[
            f"{name}: {text}" for name, robot in robots.items() for text in robot.unmodelled
        ],
        source="; ".join(dict.fromkeys(robot.source for robot in robots.values())),
        licence="; ".join(dict.fromkeys(robot.licence for robot in robots.values())),
        spring_dampers=[
            replace(each, frame_a=new(each.frame_a), frame_b=new(each.frame_b))
            for new, robot in pairs
            for each in robot.spring_dampers
        ],
        precision=max(robot.precision for robot in robots.values()),
        lost_rows=[f"{name}: {text}" for name, robot in robots.items() for text in robot.lost_rows],
        exclusions=[[*map(new, names)] for new, robot in pairs for names in robot.exclusions],
    )


def _renamed(motor: CoupledMotor, new: Callable[[str], str]) -> CoupledMotor:
    weights = {new(joint): weight for joint, weight in motor.weights.items()}
    return replace(motor, name=new(motor.name), joints=weights)


def _prefixed(prefix: str) -> Callable[[str], str]:
    def prefixed(name: str) -> str:
        place = place_of(name)
        in_world = name in WORLD or (place is not None and place.base in WORLD)
        return name if in_world else f"{prefix}/{name}"

    return prefixed


def _model(robots: Mapping[str, Robot], renames: Mapping[str, Callable[[str], str]]) -> Any:
    """Model with the trees of all robots side by side, with all their numbers."""
    made = pin.Model()
    made.name = " + ".join(robots)
    for name, robot in robots.items():
        model, new = robot.model, renames[name]
        made.gravity = pin.Motion(model.gravity.vector.copy())
        made.appendBodyToJoint(0, model.inertias[0], pin.SE3.Identity())
        carriers = _add_joints(model, made, new)
        _add_frames(model, made, carriers, new)
    return made


def _add_joints(model: Any, made: Any, new: Callable[[str], str]) -> list[int]:
    """Add the joints and bodies of a model; return their new numbers."""
    numbers, nq, nv = [0], int(made.nq), int(made.nv)
    for i in range(1, model.njoints):
        carrier = numbers[model.parents[i]]
        number = made.addJoint(
            carrier, model.joints[i], model.jointPlacements[i], new(model.names[i])
        )
        made.appendBodyToJoint(number, model.inertias[i], pin.SE3.Identity())
        numbers.append(number)
    for start, names in ((nq, _pin.NUMBERS_OF_Q), (nv, _pin.NUMBERS_OF_V)):
        for each in names:
            values = np.array(getattr(made, each))
            values[start:] = getattr(model, each)
            setattr(made, each, values)
    return numbers


def _add_frames(model: Any, made: Any, joints: list[int], new: Callable[[str], str]) -> None:
    numbers = [0]  # of each frame in what is made
    for frame in list(model.frames)[1:]:
        parent = numbers[frame.parentFrame] if frame.parentFrame < len(numbers) else 0
        copy = pin.Frame(
            new(frame.name), joints[frame.parentJoint], parent, frame.placement, frame.type,
            frame.inertia,
        )  # fmt: skip
        # the inertia is on the joint already
        numbers.append(made.addFrame(copy, False))


def _postures(robots: Mapping[str, Robot]) -> dict[str, Array]:
    def posture(robot: Robot, name: str) -> Array:
        if name in robot.postures:
            return robot.postures[name]
        return next(iter(robot.postures.values()), np.array(pin.neutral(robot.model)))

    names = dict.fromkeys(name for robot in robots.values() for name in robot.postures)
    return {
        name: np.concatenate([posture(robot, name) for robot in robots.values()]) for name in names
    }


# The same robot with other inertial parameters.


def weighing(robot: Robot, inertias: Array) -> Robot:
    """Robot with other inertial parameters (bodies, 10)."""
    # InvalidModel if no body has them.
    model = pin.Model(robot.unedited)
    for i, pi in enumerate(inertias, start=1):
        if pi.any():
            model.inertias[i] = pin.Inertia.FromDynamicParameters(pi)
        else:  # a joint that carries nothing has no centre
            model.inertias[i] = pin.Inertia.Zero()
    return replace(robot, model=model)
