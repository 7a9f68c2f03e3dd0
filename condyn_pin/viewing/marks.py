"""Marks on every scene: joints, spring-dampers, the centre of mass, and the floor.

A hinge is a drum about its axis, a slider a bar along it, any other joint a ball; what has a motor
is orange. The joint of a floating base is not marked. A spring-damper is bellows from one frame to
the other. The floor is a grid in the plane z = 0, or below what hangs from there; its squares give
the scale. meshcat's own grid is of lines, which software renderers drop where they pass behind the
camera.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.io import meshes
from condyn_pin.model.robot import Robot
from condyn_pin.viewing.instant import Instant
from condyn_pin.viewing.labels import label
from condyn_pin.viewing.palette import ACTUATED, GRID, MASS, PASSIVE, SPRING
from condyn_pin.viewing.part import Part, Pose, at_point, joint_pose, span

_FOLDS = 12  # of bellows
_HALF = 8  # squares from the middle of the floor to its edge


def joint_parts(robot: Robot, size: float) -> Iterator[Part]:
    """Yield a mark for each joint of a robot in a scene of this size [m]."""
    for name in robot.joints:
        i = robot.model.getJointId(name)
        joint = robot.model.joints[i]
        if joint.nv == 6:
            continue
        kind, colour = ("actuated", ACTUATED) if name in robot.actuated else ("passive", PASSIVE)
        shape = ((_joint_mark(joint, 0.011 * size), colour),)
        yield Part(f"joints/{kind}/{name}", joint_pose(i), shape, opacity=0.9, on_top=True)


def _joint_mark(joint: Any, radius: float) -> meshes.Mesh:
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


def spring_parts(robot: Robot, size: float) -> Iterator[Part]:
    """Yield a part for each spring-damper of a robot in a scene of this size [m]."""
    heights = np.linspace(0.0, 1.0, 2 * _FOLDS + 1)
    radii = 0.008 * size * np.where(np.arange(len(heights)) % 2, 1.0, 0.4)
    radii[[0, -1]] = 0.0
    bellows = meshes.turned(np.column_stack([radii, heights]), 12)
    for each in robot.spring_dampers:
        pose = _between(robot.frame(each.frame_a), robot.frame(each.frame_b))
        yield Part(f"springs/{each.frame_a} - {each.frame_b}", pose, ((bellows, SPRING),))


def _between(*frames: tuple[int, Any]) -> Pose:
    def pose(at: Instant) -> Array:
        return span(*((at.joints[joint] * placement).translation for joint, placement in frames))

    return pose


def mass_parts(size: float) -> Iterator[Part]:
    """Yield a ball in the centre of mass, and its label."""

    def pose(at: Instant) -> Array:
        return at_point(at.com)

    ball = meshes.sphere(0.015 * size)
    yield Part("mass/centre", pose, ((ball, MASS),), opacity=0.9, on_top=True)
    yield label("mass/label", "centre of mass", MASS, pose, 0.024 * size)


def spacing(size: float) -> float:
    """Return the edge of a square [m]: 1, 2 or 5 times a power of ten, near a sixth of `size`."""
    power = 10.0 ** math.floor(math.log10(size / 6.0))
    return power * max(step for step in (1, 2, 5) if step * power <= size / 6.0)


def floor_part(middle: Array, size: float) -> Part:
    """Return the grid under a scene, its lines on whole multiples of the spacing."""
    height = 0.0 if middle[2] >= 0.0 else middle[2] - 0.5 * size
    step = spacing(size)
    centre = np.round(middle[:2] / step) * step
    long, thin = 2.0 * _HALF * step, 0.0025 * size
    corners = np.array([(-0.5, -0.5, 0.0), (0.5, -0.5, 0.0), (0.5, 0.5, 0.0), (-0.5, 0.5, 0.0)])
    line = meshes.Mesh(corners, np.array([(0, 1, 2), (0, 2, 3)], dtype=np.uint32))
    lines = meshes.Mesh(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.uint32))
    for i in range(-_HALF, _HALF + 1):
        for x, y, at in ((long, thin, (0.0, i * step)), (thin, long, (i * step, 0.0))):
            T = np.diag([x, y, 1.0, 1.0])
            T[:3, 3] = *(centre + at), height
            lines = lines + line.moved(T)
    return Part("floor", lambda _: np.eye(4), ((lines, GRID),))
