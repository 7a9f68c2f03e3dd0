"""What stands for a robot that nobody drew: rods between its joints, and the inertia of each body.

The ellipsoid is the solid one of even density with the mass and the inertia of the body: with
principal moments I_k at its centre of mass, its half axes are

    r_k = sqrt(5 (I_1 + I_2 + I_3 - 2 I_k) / (2 m))

One that is larger than the rods of its body, as of a problem that is given in a plane, is clear.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import Any

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.model.robot import Robot
from condyn_pin.viewing import meshes
from condyn_pin.viewing.palette import BODY, GHOST, Colour
from condyn_pin.viewing.part import Part, joint_pose, span

_CLEAR = 0.15  # opacity of an inertia that is larger than the body it stands for


def skeleton(robot: Robot, size: float, only: Collection[int] | None = None) -> Iterator[Part]:
    """Yield a part for each joint, or `only` some: rods to what it carries, and its inertia."""
    model = robot.model
    for i in range(model.njoints) if only is None else sorted(only):
        points = _points(robot, i)
        start = points[0] if i == 0 and points else np.zeros(3)
        rods = [_rod(start, p, 0.006 * size) for p in points if np.linalg.norm(p - start) > 0.0]
        drawn: list[tuple[meshes.Mesh, Colour]] = [(rod, BODY) for rod in rods]
        if i and model.inertias[i].mass > 0.0:
            inertia = _ellipsoid(model.inertias[i], 0.012 * size)
            reach = max((float(np.linalg.norm(p - start)) for p in points), default=0.0)
            if 0.0 < reach < np.ptp(inertia.vertices, axis=0).min():  # it would hide the rods
                path = f"inertia/{model.names[i]}"
                yield Part(path, joint_pose(i), ((inertia, GHOST),), opacity=_CLEAR)
            else:
                drawn.append((inertia, GHOST))
        if drawn:
            yield Part(f"robot/{model.names[i]}", joint_pose(i), tuple(drawn))


def _points(robot: Robot, i: int) -> list[Array]:
    """Return where other things are on joint i: joints, loops, contacts; else its own mass."""
    model = robot.model
    found = [model.jointPlacements[j].translation for j in range(1, model.njoints)
             if model.parents[j] == i and model.joints[j].nq != 7]  # fmt: skip
    names = [name for each in (*robot.loops, *robot.contacts) for name in each.frames]
    ends = (robot.frame(name) for name in names)
    found += [placement.translation for joint, placement in ends if joint == i]
    if i and not any(np.linalg.norm(p) > 0.0 for p in found):
        found.append(model.inertias[i].lever)
    return [np.array(p) for p in found]


def _rod(start: Array, end: Array, radius: float) -> meshes.Mesh:
    length = float(np.linalg.norm(end - start))
    T = span(start, end)
    T[:3, 2] /= length
    return meshes.capsule(radius, length).moved(T)


def _ellipsoid(inertia: Any, least: float) -> meshes.Mesh:
    moments, axes = np.linalg.eigh(inertia.inertia)
    squares = 2.5 * (moments.sum() - 2.0 * moments) / inertia.mass
    radii = np.maximum(np.sqrt(np.maximum(squares, 0.0)), least)
    T = np.eye(4)
    T[:3, :3] = axes * radii
    T[:3, 3] = inertia.lever
    return meshes.sphere(1.0).moved(T)
