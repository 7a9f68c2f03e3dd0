"""The scenes that every robot brings by itself, for benchmarks, tests and the command line."""

from __future__ import annotations

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.constraints.base import Constraint
from condyn_pin.dynamics.scene import Scene
from condyn_pin.model.robot import Robot


def standard_scenes(robot: Robot) -> dict[str, Scene]:
    """Return the scenes of a robot by label.

    Its loops alone; its loops with its ready-made contacts; and the same with each surface
    replaced by its four corners.
    """
    loops = tuple(robot.loops)
    scenes = {}
    if loops:
        scenes[f"{robot.name} loops"] = Scene(robot, loops)
    if robot.contacts:
        label = f"{robot.name} loops + contacts" if loops else f"{robot.name} contacts"
        scenes[label] = Scene(robot, (*loops, *robot.contacts))
    corners = _corners(robot)
    if corners != tuple(robot.contacts):
        scenes[f"{robot.name} corners"] = Scene(robot, (*loops, *corners))
    if not scenes:
        scenes[f"{robot.name} free"] = Scene(robot)
    return scenes


def _corners(robot: Robot) -> tuple[Constraint, ...]:
    found: list[Constraint] = []
    for contact in robot.contacts:
        flat = contact.support and contact.support.half_length and contact.support.half_width
        found.extend(contact.by_points(robot)[1] if flat else [contact])
    return tuple(found)


def motor_torque(robot: Robot, rng: np.random.Generator) -> Array:
    """Return random torques in the motors, a tenth of the robot's weight at one metre.

    Only in the motors: a torque of that size about the axis of a thin rod would spin it at a
    million radians per second squared, and no error elsewhere would be seen beside that.
    """
    tau = np.zeros(robot.nv)
    for name in robot.actuated:
        joint = robot.model.joints[robot.model.getJointId(name)]
        tau[joint.idx_v : joint.idx_v + joint.nv] = rng.normal(size=joint.nv)
    return 0.1 * 9.81 * robot.mass * tau
