"""Collision shapes of a robot's file as contacts.

    sphere, box, capsule, cylinder, ellipsoid      the shape itself
    mesh                                           its convex hull

A plane touches of a mesh what it touches of the hull, so that nothing is lost over planes. Between
the shapes of one robot cylinders are prisms, and what a mesh leaves hollow is filled.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from itertools import combinations
from typing import Any, Final, NamedTuple

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import check_type
from condyn_pin.constraints.constraint import Constraint
from condyn_pin.constraints.contacts.candidates import Distance
from condyn_pin.constraints.contacts.frictional_contact import FrictionalContact
from condyn_pin.constraints.contacts.ground import Ground
from condyn_pin.constraints.contacts.shapes import (
    Ball,
    Box,
    Capsule,
    Convex,
    Cylinder,
    Ellipsoid,
    Plane,
    Shape,
)
from condyn_pin.constraints.places import WORLD, FrameLike
from condyn_pin.errors import CondynError, InvalidModel, unknown_name
from condyn_pin.io.shapes import Shape as FileShape
from condyn_pin.io.shapes import shapes_of
from condyn_pin.model.robot import Robot, members


class LinkShape(NamedTuple):
    """A collision shape of a link that moves."""

    name: str
    link: str
    joint: int
    frame: FrameLike
    offset: tuple[float, float, float]  # in the axes of the frame [m]
    shape: Shape


def collisions(
    robot: Robot, friction: float, ground: Plane | Ground, shapes: Sequence[str] | None
) -> tuple[FrictionalContact, ...]:
    """Contacts of the collision shapes of a file with a ground; see `Robot.collisions`."""
    check_type("ground", ground, Plane | Ground, "a Plane(normal, height) or a Ground is needed")
    return tuple(
        FrictionalContact(
            each.frame, each.shape, each.offset, ground, friction=friction, name=each.name
        )
        for each in link_shapes(robot, shapes)
        if not _passes(robot, each.link)
    )


def self_collisions(
    robot: Robot, friction: float, shapes: Sequence[str] | None, without: Sequence[Sequence[str]]
) -> tuple[FrictionalContact, ...]:
    """Contacts between collision shapes of a file; see `Robot.self_collisions`."""
    each = link_shapes(robot, shapes)
    known = {key for shape in each for key in (shape.name, shape.link)}
    apart = [frozenset(members("without", names, (str,))) for names in without]
    for names in apart:
        for name in sorted(names - known):
            raise unknown_name("shape", name, sorted(known))
    apart += map(frozenset, robot.exclusions)
    pairs = [
        (one, other)
        for one, other in combinations(each, 2)
        if _may_meet(robot, one, other) and not _left_out(one, other, apart)
    ]
    contacts = tuple(
        FrictionalContact(
            one.frame, _prism(one.shape), one.offset, _at(robot, other), _prism(other.shape),
            friction=friction,
            name=f"{one.name} - {other.name}",
        )
        for one, other in pairs
    )  # fmt: skip
    inside = _overlapping(robot, contacts)
    if any(inside):
        overlap = [
            (one.name, other.name)
            for (one, other), is_in in zip(pairs, inside, strict=True)
            if is_in
        ]
        raise InvalidModel(
            f"{robot.name}: shapes of the file overlap where the robot is in its posture of the "
            f"file: without={overlap} leaves these pairs out"
        )
    return contacts


def _may_meet(robot: Robot, one: LinkShape, other: LinkShape) -> bool:
    """True if two shapes are on joints that are not the same and not neighbours."""
    parents = robot.model.parents
    return one.joint != other.joint and not (
        parents[one.joint] == other.joint or parents[other.joint] == one.joint
    )


def _left_out(one: LinkShape, other: LinkShape, apart: Sequence[frozenset[str]]) -> bool:
    """True if some bodies that do not touch are those of two shapes."""
    return any(names & {one.name, one.link} and names & {other.name, other.link} for names in apart)


def _prism(shape: Shape) -> Shape:
    """Prism in a cylinder, which does not touch other shapes; another shape as it is."""
    if not isinstance(shape, Cylinder):
        return shape
    turns = 2.0 * np.pi * np.arange(_SIDES) / _SIDES
    rim = shape.radius * np.column_stack([np.cos(turns), np.sin(turns)])
    ends = (shape.half_length, -shape.half_length)
    return Convex(tuple((x, y, z) for z in ends for x, y in rim.tolist()))


# Sides of the prism in a cylinder: it is smaller by 0.5 % of the radius.
_SIDES: Final = 32


def _at(robot: Robot, shape: LinkShape) -> FrameLike:
    """Frame at the origin of a shape."""
    joint, placement = robot.frame(shape.frame)
    shift = pin.SE3(np.eye(3), np.array(shape.offset))
    return str(robot.model.names[joint]), placement * shift


def _overlapping(robot: Robot, contacts: Sequence[FrictionalContact]) -> list[bool]:
    """Flag of each pair of shapes: they overlap in the first posture of the file."""
    postures = [*robot.postures.values()]
    q = postures[0] if postures else pin.neutral(robot.model)
    bounds = [contact.bind(robot) for contact in contacts]
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, q)
    shapes: dict[int, Any] = {}
    return [
        bool(Distance(pair, shapes)(data).gaps[0] < -tolerances.NEARLY_CLOSED)
        for bound in bounds
        for pair in bound.pairs
    ]


def _passes(robot: Robot, link: str) -> bool:
    """True if the description lets a link through the world."""
    return any(link in names and names & {*WORLD} for names in map(set, robot.exclusions))


def link_shapes(robot: Robot, chosen: Sequence[str] | None) -> tuple[LinkShape, ...]:
    """Collision shapes of the links that move, in the order of the file; those `chosen` by name."""
    read, missing = shapes_of(
        robot.description, "collision", model=robot.name, package_dirs=robot.package_dirs
    )
    if not read and not missing:
        raise InvalidModel(
            f"{robot.name}: no file with collision shapes: description = {robot.description!r}; "
            "write a FrictionalContact for each shape yourself"
        )
    if missing and chosen is None:
        raise InvalidModel(
            f"{robot.name}: a collision shape cannot be read: {missing[0]}; package_dirs= of "
            "load_robot says where meshes lie, and shapes=[...] names the shapes to take"
        )
    named = list(_named(robot, read))
    if chosen is not None:
        wanted = set(members("shapes", chosen, (str,)))
        known = {key for name, _, shape in named for key in (name, shape.link)}
        for name in sorted(wanted - known):
            raise unknown_name("shape", name, sorted(known))
        named = [each for each in named if wanted & {each[0], each[2].link}]
    return tuple(_placed(robot, *each) for each in named)


def _named(robot: Robot, read: Sequence[FileShape]) -> Iterator[tuple[str, int, FileShape]]:
    """Yield the name and the joint of each shape of a link that moves.

    That on which a ready-made contact stands has the name of its first foot, as in
    `Robot.frictional_contacts`: a scene with both is refused.
    """
    found = []
    for shape in read:
        joint, placement = _link(robot, shape.link)
        if joint:
            found.append((joint, placement, shape))
    count = Counter(f"{shape.link} {shape.kind}" for _, _, shape in found)
    feet = {
        _foot_shape(robot, contact.frames[0], found): _first_foot(contact)
        for contact in robot.contacts
        if contact.frames
    }
    seen: Counter[str] = Counter()
    for i, (joint, _, shape) in enumerate(found):
        name = f"{shape.link} {shape.kind}"
        seen[name] += 1
        numbered = f"{name} {seen[name]}" if count[name] > 1 else name
        yield feet.get(i, numbered), joint, shape


def _first_foot(contact: Constraint) -> str:
    """Name of the first point of a contact that touches; its own if it has none."""
    try:
        return contact.feet[0].name if contact.feet else contact.name
    except CondynError:  # without a size
        return contact.name


def _foot_shape(
    robot: Robot, frame: str, found: Sequence[tuple[int, Any, FileShape]]
) -> int | None:
    """Number of the shape on which a foot stands: of its link, or the next one of its joint."""
    joint, at = robot.frame(frame)
    of_joint = [i for i, (carrier, _, _) in enumerate(found) if carrier == joint]
    away = {
        i: (
            found[i][2].link != frame,
            float(
                np.linalg.norm((found[i][1] * found[i][2].placement).translation - at.translation)
            ),
        )
        for i in of_joint
    }
    return min(away, key=lambda i: away[i]) if away else None


def _placed(robot: Robot, name: str, joint: int, of_file: FileShape) -> LinkShape:
    """Shape in the words of contacts: its frame, its offset there, and its sizes."""
    of_link, frame = _link(robot, of_file.link)[1], _frame(robot, of_file.link)
    try:
        if of_file.kind == "mesh":
            hull = Convex.hull(of_file.mesh().vertices)
            return LinkShape(name, of_file.link, joint, frame, (0.0, 0.0, 0.0), hull)
        shape = _SHAPES[of_file.kind](*of_file.size)
    except (CondynError, ValueError, OSError) as error:
        raise InvalidModel(
            f"{robot.name}: shape {name!r} cannot touch: {error}; shapes=[...] names the others"
        ) from error
    at = of_file.placement
    if isinstance(shape, Ball) or (at.rotation == np.eye(3)).all():
        x, y, z = at.translation.tolist()
        return LinkShape(name, of_file.link, joint, frame, (x, y, z), shape)
    turned = str(robot.model.names[joint]), of_link * at
    return LinkShape(name, of_file.link, joint, turned, (0.0, 0.0, 0.0), shape)


def _link(robot: Robot, link: str) -> tuple[int, Any]:
    """Joint that carries a link, and its placement there: a joint may have the same name."""
    model = robot.model
    if model.existFrame(link, pin.FrameType.BODY):
        frame = model.frames[model.getFrameId(link, pin.FrameType.BODY)]
        return int(frame.parentJoint), frame.placement
    return robot.frame(link)


def _frame(robot: Robot, link: str) -> FrameLike:
    """Link as a frame: its name, or its place where the name has several."""
    joint, placement = _link(robot, link)
    try:
        named = robot.frame(link)
    except CondynError:
        named = None
    if named is not None and named[0] == joint and named[1] == placement:
        return link
    return str(robot.model.names[joint]), placement


# Sizes as a file has them: edges of boxes, half axes of ellipsoids, radius and length.
_SHAPES: Final[dict[str, Callable[..., Shape]]] = {
    "sphere": Ball,
    "box": lambda x, y, z: Box(x / 2, y / 2, z / 2),
    "capsule": lambda radius, length: Capsule(radius, length / 2),
    "cylinder": lambda radius, length: Cylinder(radius, length / 2),
    "ellipsoid": Ellipsoid,
}
