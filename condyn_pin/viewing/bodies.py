"""The bodies of a robot, as its description draws them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Final

from condyn_pin._core._pin import pin
from condyn_pin.model.robot import Robot
from condyn_pin.viewing.descriptions import shapes_of
from condyn_pin.viewing.geoms import WORLD
from condyn_pin.viewing.meshes import Mesh
from condyn_pin.viewing.palette import Colour
from condyn_pin.viewing.part import Part, joint_pose
from condyn_pin.viewing.skeleton import skeleton

_LIGHT: Final = 30_000  # triangles of a robot that is to be light
_SWIFT: Final = 10_000  # and of one that a processor is to draw thirty times a second


def body_parts(robot: Robot, size: float) -> tuple[tuple[Part, ...], tuple[str, ...]]:
    """Return a part for each joint, with all that it carries, and what could not be drawn."""
    shapes, missing = shapes_of(robot.description)
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
    """Return parts that know what to show while they move, where a processor draws them."""
    for part, few in zip(parts, lighter(parts, size, _SWIFT), strict=True):
        coarse = () if few is part else tuple(mesh for mesh, _ in few.meshes)
        yield replace(part, coarse=coarse)
