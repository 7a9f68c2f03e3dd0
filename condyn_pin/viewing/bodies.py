"""The bodies of a robot, as its description draws them; and what stands for those it does not.

That is rods between joints, and the inertia of each body: the solid ellipsoid of even density with
its mass and inertia. With principal moments I_k at its centre of mass, its half axes are

    r_k = sqrt(5 (I_1 + I_2 + I_3 - 2 I_k) / (2 m))

One that is larger than the rods of its body, as of a problem that is given in a plane, is clear.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.io import meshes
from condyn_pin.io.meshes import Mesh
from condyn_pin.io.shapes import WORLD, shapes_of
from condyn_pin.model.robot import Robot
from condyn_pin.viewing.palette import BODY, GHOST, Colour
from condyn_pin.viewing.part import Part, joint_pose, span

_LIGHT: Final = 30_000  # triangles of a robot that is to be light
_SWIFT: Final = 10_000  # and of one that a processor is to draw thirty times a second
_CLEAR: Final = 0.15  # opacity of an inertia that is larger than the body it stands for


def body_parts(robot: Robot, size: float) -> tuple[tuple[Part, ...], tuple[str, ...]]:
    """Return a part for each joint, with all that it carries, and what could not be drawn."""
    shapes, missing = shapes_of(
        robot.description, model=robot.name, package_dirs=robot.package_dirs
    )
    frames = robot.model.frames
    carriers = {f.name: f for f in frames if f.type == pin.FrameType.BODY} | {WORLD: frames[0]}
    drawn: dict[int, dict[Colour, Mesh]] = {}
    for shape in shapes:
        if (frame := carriers.get(shape.link)) is None:
            continue  # what was left out of the robot is not to be seen
        try:
            mesh = shape.mesh().moved(frame.placement.homogeneous)
        except ValueError as error:
            missing = (*missing, f"link {shape.link!r} is not drawn whole: {error}")
            continue
        of_joint = drawn.setdefault(int(frame.parentJoint), {})
        old = of_joint.get(shape.colour)
        of_joint[shape.colour] = mesh if old is None else old + mesh
    return tuple(_parts(robot, drawn, size)), missing


def _parts(robot: Robot, drawn: dict[int, dict[Colour, Mesh]], size: float) -> Iterator[Part]:
    """Yield what is drawn, and a skeleton of the bodies with mass that nobody drew."""
    heavy = {i for i, inertia in enumerate(robot.model.inertias) if i and inertia.mass > 0.0}
    yield from skeleton(robot, size, only=heavy - drawn.keys() if drawn else None)
    for i, by_colour in drawn.items():
        meshes = tuple((mesh, colour) for colour, mesh in by_colour.items())
        yield Part(f"robot/{robot.model.names[i]}", joint_pose(i), meshes)


def lighter(parts: Sequence[Part], size: float, most: int = _LIGHT) -> tuple[Part, ...]:
    """Return parts with at most so many triangles together, in cells as small as that allows."""
    cell = size / (2.3 * most**0.5)  # smaller ones are too many on a surface of this size
    while True:
        if sum(len(m.faces) for part in parts for m, _ in part.meshes) <= most:
            return tuple(parts)
        parts = [
            replace(part, meshes=tuple((m.simplified(cell), c) for m, c in part.meshes))
            for part in parts
        ]
        cell *= 1.2


def with_coarse(parts: Sequence[Part], size: float) -> Iterator[Part]:
    """Yield parts that know what to show while they move, where a processor draws them."""
    for part, few in zip(parts, lighter(parts, size, _SWIFT), strict=True):
        coarse = () if few is part else tuple(mesh for mesh, _ in few.meshes)
        yield replace(part, coarse=coarse)


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
