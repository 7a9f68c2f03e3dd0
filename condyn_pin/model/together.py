"""Several robots as one, for contacts and loops between them.

q = (q_1, q_2, ...),        M = diag(M_1, M_2, ...)
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from condyn_pin._core import _pin
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.base import WORLD
from condyn_pin.errors import InvalidArgument
from condyn_pin.model.robot import Robot


def together(robots: Mapping[str, Robot]) -> Robot:
    """Return several robots as one; nothing holds them together.

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
    )


def _prefixed(prefix: str) -> Callable[[str], str]:
    return lambda name: name if name in WORLD else f"{prefix}/{name}"


def _model(robots: Mapping[str, Robot], renames: Mapping[str, Callable[[str], str]]) -> Any:
    """Return the trees beside each other, every number of them kept."""
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
    """Add the joints and bodies of a model; return their numbers in what is made."""
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
