"""Joints: what they let move, and whether a motor moves it.

A hinge is a drum about its axis, a slider a bar along it, all else a ball; what has a motor is
orange. The joint of a floating base is not marked.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from condyn_pin.model.robot import Robot
from condyn_pin.viewing import meshes
from condyn_pin.viewing.palette import ACTUATED, PASSIVE
from condyn_pin.viewing.part import Part, joint_pose, span


def joint_parts(robot: Robot, size: float) -> Iterator[Part]:
    """Return a mark for each joint."""
    for name in robot.joints:
        i = robot.model.getJointId(name)
        joint = robot.model.joints[i]
        if joint.nv == 6:
            continue
        motor = name in robot.actuated
        kind = "actuated" if motor else "passive"
        yield Part(
            f"joints/{kind}/{name}",
            joint_pose(i),
            ((_mark(joint, 0.011 * size), ACTUATED if motor else PASSIVE),),
            opacity=0.9,
            on_top=True,
        )


def _mark(joint: Any, radius: float) -> meshes.Mesh:
    if joint.nv != 1:
        return meshes.sphere(1.2 * radius)
    data = joint.createData()
    joint.calc(data, np.array([1.0, 0.0]) if joint.nq == 2 else np.zeros(1))
    S = np.array(data.S).reshape(6)
    linear, angular = S[:3], S[3:]
    if np.linalg.norm(angular) > 0.0:
        mark, axis = meshes.cylinder(radius, 2.4 * radius), angular
    else:
        mark, axis = meshes.box(radius, radius, 5.0 * radius), linear
    return mark.moved(span(np.zeros(3), axis / np.linalg.norm(axis)))
