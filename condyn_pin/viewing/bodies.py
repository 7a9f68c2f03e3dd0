"""Bodies as they are drawn, and contacts where they touch.

The bodies of a robot, as its description draws them; and what stands for those it does not.

That is rods between joints, and the inertia of each body: the solid ellipsoid of even density with
its mass and inertia. With principal moments I_k at its centre of mass, its half axes are

    r_k = sqrt(5 (I_1 + I_2 + I_3 - 2 I_k) / (2 m))

One that is larger than the rods of its body, as of a problem that is given in a plane, is clear.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise
from typing import Any, Final

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.contacts.frictional_contact import FrictionalContact
from condyn_pin.constraints.contacts.ground import Facets, Ground
from condyn_pin.constraints.contacts.shapes import Plane
from condyn_pin.constraints.contacts.touches import BoundContact, PlaneContact
from condyn_pin.dynamics.scene import Scene
from condyn_pin.io import meshes
from condyn_pin.io.meshes import Mesh
from condyn_pin.io.shapes import WORLD, shapes_of
from condyn_pin.model.robot import Robot
from condyn_pin.viewing.instant import ContactView, Instant
from condyn_pin.viewing.marks import patch_mesh
from condyn_pin.viewing.part import (
    BODY,
    CONE,
    GHOST,
    GROUND,
    Colour,
    Part,
    at_point,
    joint_pose,
    mode_colour,
    pose_from,
    span,
)

_LIGHT: Final = 30_000  # triangles of a robot that is to be light
_SWIFT: Final = 10_000  # and of one that a processor is to draw thirty times a second
_CLEAR: Final = 0.15  # opacity of an inertia that is larger than the body it stands for


def body_parts(robot: Robot, size: float) -> tuple[tuple[Part, ...], tuple[str, ...]]:
    """Return a part for each joint with its shapes, and notes on shapes that cannot be drawn."""
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
    """Parts of the drawn shapes, and the skeleton of bodies with mass but without a shape."""
    heavy = {i for i, inertia in enumerate(robot.model.inertias) if i and inertia.mass > 0.0}
    yield from skeleton(robot, size, only=heavy - drawn.keys() if drawn else None)
    for i, by_colour in drawn.items():
        meshes = tuple((mesh, colour) for colour, mesh in by_colour.items())
        yield Part(f"robot/{robot.model.names[i]}", joint_pose(i), meshes)


def lighter(parts: Sequence[Part], size: float, most: int = _LIGHT) -> tuple[Part, ...]:
    """Return parts with at most `most` triangles together, simplified in the smallest cells."""
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
    """Yield parts with coarse meshes, for motion without a graphics card."""
    for part, few in zip(parts, lighter(parts, size, _SWIFT), strict=True):
        coarse = () if few is part else tuple(mesh for mesh, _ in few.meshes)
        yield replace(part, coarse=coarse)


def skeleton(robot: Robot, size: float, only: Collection[int] | None = None) -> Iterator[Part]:
    """Yield a part for each joint, or `only` some: rods to its child frames, and its inertia."""
    model = robot.model
    for i in range(model.njoints) if only is None else sorted(only):
        points = _points(robot, i)
        start = points[0] if i == 0 and points else np.zeros(3)
        ends = _outline(points) if i == 0 else [(start, p) for p in points]
        rods = [_rod(a, b, 0.006 * size) for a, b in ends if np.linalg.norm(b - a) > 0.0]
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
    """Positions of child joints, loops and contacts on joint i; else its centre of mass [m]."""
    model = robot.model
    found = [model.jointPlacements[j].translation for j in range(1, model.njoints)
             if model.parents[j] == i and model.joints[j].nq != 7]  # fmt: skip
    names = [name for each in (*robot.loops, *robot.contacts) for name in each.frames]
    ends = (robot.frame(name) for name in names)
    found += [placement.translation for joint, placement in ends if joint == i]
    if i and not any(np.linalg.norm(p) > 0.0 for p in found):
        found.append(model.inertias[i].lever)
    return [np.array(p) for p in found]


def _outline(points: list[Array]) -> list[tuple[Array, Array]]:
    """Edges of the polygon around the points of a base, in the plane that fits them best."""
    if len(points) < 3:
        return list(pairwise(points))
    x = np.array(points) - np.mean(points, axis=0)
    across = np.linalg.svd(x)[2]
    order = np.argsort(np.arctan2(x @ across[1], x @ across[0]))
    return [(points[i], points[j]) for i, j in zip(order, np.roll(order, -1), strict=True)]


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


# Contacts that may open: their shapes and points, the planes they may touch, their cones.
#
# A point is grey while it is open, and told apart by its colour while it sticks and while it
# slides; a shape is what the worst of its points is. A cone holds the forces that friction can
# give, |lam_t| <= mu lam_n; it is not seen while its contact is open.


_POINT = 0.012  # radius of a contact point, of the size of the scene
_CABLE = 0.004  # radius of a cable, of the size of the scene
_CONE = 0.1  # length of the side of a cone, of the size of the scene
_MARGIN = 0.25  # from the outermost contact point to the edge of a plane, of the size of the scene
_UNDER = 2e-3  # by which a plane is drawn too low, of the size of the scene: a grid may lie in it
_SURFACE_OPACITY = 0.5  # opacity of what would hide the robot
_ORDER = ("slide", "stick", "open")  # the worst first


def touch_parts(
    scene: Scene, instants: Sequence[Instant], size: float, *, cones: bool = False
) -> Iterator[Part]:
    """Yield the parts of all unilateral contacts of a scene of a `size` [m]."""
    # A plane is drawn so large that every contact point is above it at all instants.
    for bound in scene.contact_bounds:
        for i, solid in enumerate(bound.solids):
            shape = patch_mesh(solid.patch).moved(solid.placement.homogeneous)
            path = f"{_folder(bound, instants)}/{bound.name}/shape {i}"
            yield Part(
                path, joint_pose(solid.joint), ((shape, mode_colour("")),),
                opacity=_SURFACE_OPACITY, tint=partial(_shape_colour, bound),
            )  # fmt: skip
        for name, _ in bound.cones:
            path = f"{_folder(bound, instants)}/{name}/point"
            ball = ((meshes.sphere(_POINT * size), mode_colour("")),)
            pose = pose_from(_of(name), lambda here: at_point(here.at))
            yield Part(path, pose, ball, on_top=True, tint=partial(_point_colour, name))
            if cones:
                yield _cone_part(name, size)
    yield from _ground_parts(scene, instants, size)
    yield from _cable_parts(scene, instants, size)


def _folder(bound: BoundContact, instants: Sequence[Instant]) -> str:
    """Legend group of a contact: "touching" if its modes are known, else "candidates"."""
    known = any(mode for at in instants for mode in _modes(bound, at))
    return "touching" if known else "candidates"


def _modes(bound: BoundContact, at: Instant) -> set[str]:
    return {at.touching[name].mode for name, _ in bound.cones if name in at.touching}


def _of(name: str) -> Callable[[Instant], ContactView | None]:
    return lambda at: at.touching.get(name)


def _point_colour(name: str, at: Instant) -> Colour:
    return mode_colour(at.touching[name].mode if name in at.touching else "")


def _shape_colour(bound: BoundContact, at: Instant) -> Colour:
    modes = _modes(bound, at)
    return mode_colour(next((mode for mode in _ORDER if mode in modes), ""))


def _cone_part(name: str, size: float) -> Part:
    """Friction cone of a contact, its slant height the same for all friction coefficients."""
    unit = ((meshes.solid_of_revolution([(0.0, 0.0), (1.0, 1.0), (0.0, 1.0)]), CONE),)

    def pose(at: Instant) -> Array | None:
        here = at.touching.get(name)
        if here is None or here.mode == "open":
            return None
        height = _CONE * size / np.hypot(1.0, here.friction)
        radius = height * max(here.friction, 0.01)  # a needle on ice
        T = at_point(here.at)
        T[:3, :3] = here.axes * (radius, radius, height)
        return T

    return Part(f"cones/{name}", pose, unit, opacity=_SURFACE_OPACITY)


def _cable_parts(scene: Scene, instants: Sequence[Instant], size: float) -> Iterator[Part]:
    """Yield each span of each cable, grey where it is slack."""
    own = {*scene.names, *(line.name for bound in scene.contact_bounds for line in bound.lines)}
    views = [(name, line) for at in instants for name, (line, _) in at.cables.items()]
    spans = {name: len(line) - 1 for name, line in views if name in own}
    rod = meshes.rod(_CABLE * size, 1.0, 8)

    def pose(name: str, i: int, at: Instant) -> Array | None:
        line, _ = at.cables.get(name, (None, False))
        return None if line is None else span(line[i], line[i + 1])

    def tint(name: str, at: Instant) -> Colour:
        return mode_colour("stick" if at.cables.get(name, (None, False))[1] else "open")

    for name, count in spans.items():
        for i in range(count):
            yield Part(
                f"cables/{name}/span {i}", partial(pose, name, i), ((rod, mode_colour("")),),
                tint=partial(tint, name),
            )  # fmt: skip


def _ground_parts(scene: Scene, instants: Sequence[Instant], size: float) -> Iterator[Part]:
    """Square in each contact plane, below all points that may touch it; faces of each ground."""
    above: dict[tuple[int, bytes], list[PlaneContact]] = {}
    for bound in scene.contact_bounds:
        for touch in bound.touches:
            above.setdefault((touch.ground, touch.plane.homogeneous.tobytes()), []).append(touch)
    for (ground, _), touches in above.items():
        plane = touches[0].plane
        points = np.array([
            (at.joints[ground] * plane).actInv(at.touching[touch.name].at)[:2]
            for at in instants for touch in touches if touch.name in at.touching
        ])  # fmt: skip
        square = _square(plane, points, size)
        path = f"grounds/of {touches[0].name}"
        yield Part(path, joint_pose(ground), ((square, GROUND),), sheet=True)
    touched = [here.at for at in instants for here in at.touching.values()]
    for i, each in enumerate(dict.fromkeys(_grounds(scene))):
        parts = [
            _square(part.placement, np.array([part.placement.actInv(x)[:2] for x in touched]), size)
            if isinstance(part, Plane)
            else _facets_mesh(part)
            for part in each.parts
        ]
        shape = tuple((mesh, GROUND) for mesh in parts)
        yield Part(f"grounds/{i}", joint_pose(0), shape, sheet=True)


def _grounds(scene: Scene) -> Iterator[Ground]:
    """Yield the ground of each contact of a scene that is on one."""
    for contact in scene.contacts:
        if isinstance(contact, FrictionalContact) and isinstance(contact.on, Ground):
            yield contact.on


def _facets_mesh(facets: Facets) -> Mesh:
    """Triangles of the faces of a ground."""
    triangles = [
        (face[0], *face[k : k + 2]) for face in facets.faces for k in range(1, len(face) - 1)
    ]
    return Mesh(np.array(facets.vertices), np.array(triangles, dtype=np.uint32))


def _square(plane: Any, points: Array, size: float) -> Mesh:
    """Square in a plane, round all points of it (k, 2)."""
    points = points.reshape(-1, 2) if len(points) else np.zeros((1, 2))
    low, high = points.min(axis=0) - _MARGIN * size, points.max(axis=0) + _MARGIN * size
    x, y = np.meshgrid((low[0], high[0]), (low[1], high[1]))
    corners = np.column_stack([x.ravel(), y.ravel(), np.full(4, -_UNDER * size)])
    square = Mesh(corners, np.array([(0, 1, 3), (0, 3, 2)], dtype=np.uint32))
    return square.moved(plane.homogeneous)
