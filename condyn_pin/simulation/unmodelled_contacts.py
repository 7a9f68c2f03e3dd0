"""Parts of the robot's file that a motion reaches and its scene leaves out: stops, and shapes.

    out   = max(lower - q, q - upper) > 0          a joint without a stop
    depth = height - min_k n . (R x_k + p) > 0     corners x_k of a shape in ground n . x <= height

and of the convex parts of a `Ground` the least depth under all their faces.

Shapes are looked at where they are at some samples; those that cannot be read are passed over.
"""

from __future__ import annotations

from functools import lru_cache
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.trees import algorithms, data_of
from condyn_pin.constraints.contacts.touches import Pair, PlaneContact
from condyn_pin.constraints.places import WORLD
from condyn_pin.constraints.rows.bound import ConstraintViolation, beyond_text
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import CondynError
from condyn_pin.io.shapes import shapes_of
from condyn_pin.model.joints import Limits
from condyn_pin.model.robot import Robot

if TYPE_CHECKING:
    from condyn_pin.simulation.trajectory import Trajectory

# Samples at which shapes are looked at: a body that falls by 1 m moves 2 cm from one to the next.
_LOOKS: Final = 100

# How many bodies a notice names.
_LISTED: Final = 3


def limits_passed(trajectory: Trajectory) -> list[str]:
    """Sentences on joints that leave their limits, unless they began so."""
    q, limits = trajectory.q, Limits.of(trajectory.scene.robot.model)
    inside = limits.beyond(q[0]).keys()
    most = limits.beyond(q.min(axis=0)) | limits.beyond(q.max(axis=0))
    stops = {stop.iq for bound in trajectory.scene.contact_bounds for stop in bound.stops}
    held = {joint for joint, iq in zip(limits.joints, limits.iq, strict=True) if iq in stops}
    beyond: dict[bool, dict[str, ConstraintViolation]] = {True: {}, False: {}}
    for joint, gap in most.items():
        least = tolerances.NEARLY_CLOSED if joint in held else tolerances.CLOSED
        if joint not in inside and gap.size > least:
            beyond[joint in held][joint] = gap
    said = []
    if beyond[False]:
        said.append(
            f"{beyond_text(beyond[False])}, and the scene has no stops there: "
            "Scene(..., contacts=[..., *robot.limits()]) adds them"
        )
    if beyond[True]:
        said.append(f"{beyond_text(beyond[True])}, although the scene has stops: use a smaller dt")
    return said


class _Solid(NamedTuple):
    """A collision shape of the file on a joint."""

    link: str
    joint: int
    corners: Array  # (k, 3), on the joint [m]
    middle: Array  # (3,) [m]
    radius: float  # of the ball around the middle that holds all corners [m]
    kind: str


class _Ground(NamedTuple):
    """A plane that contacts of a scene may touch."""

    name: str
    made: str  # how `Robot.collisions` names it; empty where that is the default
    ground: int  # the joint that carries it
    placement: Any  # z out of the ground
    friction: float
    allowed: dict[int, float]  # by joint: how deep its shapes may be [m]
    apart: frozenset[str]  # bodies that do not touch it, by the description
    surface: Any = None  # of a `Ground`


class _Passed(NamedTuple):
    """Deepest penetration of a collision shape into a plane of the ground."""

    solid: _Solid
    plane: _Ground
    depth: float  # [m]
    t: float  # [s], when it was deepest
    first: float  # [s], when it was first seen inside


def bodies_passed(trajectory: Trajectory) -> list[str]:
    """Sentences on bodies whose collision shape of the file goes into the ground of the scene."""
    if not any(_planes(phase.scene) + _worlds(phase.scene) for phase in trajectory.phases):
        return []
    solids = _solids(trajectory.scene.robot)
    looks = np.unique(np.linspace(0, len(trajectory.t) - 1, _LOOKS).astype(int))
    worst: dict[tuple[str, str], _Passed] = {}
    for phase in trajectory.phases if solids else ():
        start, stop, _ = phase.samples.indices(len(trajectory.t))
        here = looks[(start <= looks) & (looks < stop)]
        for found in _penetrating_bodies(trajectory, phase.scene, here, solids):
            key = found.solid.link, found.plane.name
            before = worst.get(key)
            first = min(found.first, before.first) if before else found.first
            deepest = found if before is None or found.depth > before.depth else before
            worst[key] = deepest._replace(first=first)
    deepest_first = sorted(worst.values(), key=lambda each: -each.depth)
    return [_text(each, float(trajectory.t[0])) for each in deepest_first[:_LISTED]]


def _text(found: _Passed, t0: float) -> str:
    solid, plane = found.solid, found.plane
    when = "from the start" if found.first <= t0 else f"from t = {found.first:.3g} s on"
    cure = "a FrictionalContact(..., on=..., on_shape=Plane(...)) of its shape does too"
    if not plane.ground:
        named = f'friction={plane.friction:g}{plane.made}, shapes=["{solid.link}"]'
        cure = f"Scene(..., contacts=[..., *robot.collisions({named})]) adds its shapes"
    return (
        f"{solid.link} (a {solid.kind} in the file) is in the ground {plane.name} {when}, "
        f"{1e3 * found.depth:.3g} mm deep at t = {found.t:.3g} s: only the scene's contacts touch; "
        f"{cure}"
    )


def _penetrating_bodies(
    trajectory: Trajectory, scene: Scene, looks: NDArray[np.int_], solids: tuple[_Solid, ...]
) -> list[_Passed]:
    """Bodies that are in a plane of a scene at some samples, by more than they may be."""
    planes, worlds = _planes(scene), _worlds(scene)
    model = scene.robot.unedited
    data = data_of(model)
    found: dict[tuple[int, int], _Passed] = {}
    for i in looks:
        algorithms(data).forwardKinematics(model, data, trajectory.q[i])
        t = float(trajectory.t[i])
        for k, plane in enumerate(planes):
            oMp = data.oMi[plane.ground] * plane.placement
            n, height = oMp.rotation[:, 2], float(oMp.rotation[:, 2] @ oMp.translation)
            for s, solid in enumerate(solids):
                if solid.joint == plane.ground or solid.link in plane.apart:
                    continue
                oMi = data.oMi[solid.joint]
                down = oMi.rotation.T @ n
                level = height - float(n @ oMi.translation)
                allowed = plane.allowed.get(solid.joint, tolerances.IN_THE_GROUND)
                if level + solid.radius - float(down @ solid.middle) <= allowed:
                    continue
                depth = level - float((solid.corners @ down).min())
                before = found.get((k, s))
                if depth > allowed and (before is None or depth > before.depth):
                    first = before.first if before else t
                    found[k, s] = _Passed(solid, plane, depth, t, first)
        for k, world in enumerate(worlds, start=len(planes)):
            for s, solid in enumerate(solids):
                if solid.link in world.apart:
                    continue
                depth = _depth(world.surface, solid, data.oMi[solid.joint])
                before = found.get((k, s))
                allowed = world.allowed.get(solid.joint, tolerances.IN_THE_GROUND)
                if depth > allowed and (before is None or depth > before.depth):
                    found[k, s] = _Passed(solid, world, depth, t, before.first if before else t)
    return list(found.values())


def _depth(surface: Any, solid: _Solid, at: Any) -> float:
    """How deep the deepest corner of a solid is in the convex parts of a ground [m]."""
    middle, (low, high) = at.act(solid.middle), surface.bounds
    near = (low <= middle + solid.radius) & (high >= middle - solid.radius)
    corners, deepest = None, 0.0
    for part in np.flatnonzero(near.all(axis=1)).tolist():
        if surface.solids[part] is None:
            continue
        n, heights, _ = surface.solids[part]
        if (n.dot(middle) - heights).max() < solid.radius:
            if corners is None:
                corners = solid.corners.dot(at.rotation.T) + at.translation
            deepest = max(deepest, -float((corners.dot(n.T) - heights).max(axis=1).min()))
    return deepest


def _planes(scene: Scene) -> list[_Ground]:
    """Planes of the contacts of a scene, each once."""
    found: dict[tuple[Any, ...], _Ground] = {}
    for bound in scene.contact_bounds:
        over: list[tuple[PlaneContact | Pair, Any]] = [
            (touch, touch.plane) for touch in bound.touches
        ]
        over += [(p, p.ground_placement) for p in bound.pairs if p.ground_shape.is_plane]
        for touch, plane in over:
            n, height = plane.rotation[:, 2], float(plane.rotation[:, 2] @ plane.translation)
            key = (touch.ground, *np.round([*n, height], 9).tolist())
            if key not in found:
                words = _plane_in_words(scene, touch.ground, n, height)
                apart = _excluded_bodies(scene.robot, touch.ground)
                found[key] = _Ground(*words, touch.ground, plane, touch.friction, {}, apart)
            found[key].allowed[touch.joint] = tolerances.FEET_IN_THE_GROUND
    return list(found.values())


def _worlds(scene: Scene) -> list[_Ground]:
    """Grounds of the contacts of a scene that are no planes, each once."""
    found: dict[int, _Ground] = {}
    for bound in scene.contact_bounds:
        for pair in bound.pairs:
            if pair.surface is not None:
                apart = _excluded_bodies(scene.robot, 0)
                world = found.setdefault(
                    id(pair.surface),
                    _Ground("of the scene", ", ground=...", 0, None, pair.friction, {}, apart,
                            pair.surface),
                )  # fmt: skip
                world.allowed[pair.joint] = tolerances.FEET_IN_THE_GROUND
    return list(found.values())


def _excluded_bodies(robot: Robot, joint: int) -> frozenset[str]:
    """Bodies that a description lets pass through the world, or through those on a joint."""
    here = {*WORLD}
    if joint:
        here = {frame.name for frame in robot.model.frames if frame.parentJoint == joint}
    return frozenset().union(*(names for names in robot.exclusions if here.intersection(names)))


def _plane_in_words(scene: Scene, ground: int, n: Array, height: float) -> tuple[str, str]:
    """Name of a plane, and how `Robot.collisions` names it."""
    if ground:
        return f"that {scene.robot.model.names[ground]} carries", ""
    normal = ", ".join(f"{x:.6g}" for x in n)
    if n[2] < 1.0 - tolerances.CLOSED:
        return f"({normal}) . x = {height:.4g} m", f", ground=Plane(({normal}), {height:.6g})"
    made = f", ground=Plane(height={height:.6g})" if abs(height) > tolerances.CLOSED else ""
    return f"z = {height:.4g} m", made


def _solids(robot: Robot) -> tuple[_Solid, ...]:
    """Collision shapes of a robot's file on the joints that move."""
    frames = {f.name: f for f in robot.model.frames if f.type == pin.FrameType.BODY}
    made = []
    file = robot.description
    for link, kind, corners in _collision_corners(
        file, robot.name, (*robot.package_dirs,), _age(file)
    ):
        frame = frames.get(link)
        if frame is None or not frame.parentJoint:
            continue
        placed = corners @ frame.placement.rotation.T + frame.placement.translation
        middle = (placed.min(axis=0) + placed.max(axis=0)) / 2.0
        radius = float(np.linalg.norm(placed - middle, axis=1).max())
        made.append(
            _Solid(
                link=link,
                joint=int(frame.parentJoint),
                corners=placed,
                middle=middle,
                radius=radius,
                kind=kind,
            )
        )
    return tuple(made)


def _age(description: str) -> float:
    """When a file was written last; never if there is none."""
    try:
        return Path(description).stat().st_mtime
    except (OSError, ValueError):
        return -inf


@lru_cache(maxsize=16)
def _collision_corners(
    description: str, model: str, package_dirs: tuple[str, ...], _age: float
) -> tuple[tuple[str, str, Array], ...]:
    """Link, kind and corners (k, 3) in the axes of the link of each collision shape of a file."""
    if _age == -inf:
        return ()
    found = []
    shapes, _ = shapes_of(description, "collision", model=model, package_dirs=package_dirs)
    for shape in shapes:
        try:
            found.append((shape.link, shape.kind, shape.mesh().vertices))
        except (CondynError, ValueError, OSError):
            continue
    return tuple(found)
