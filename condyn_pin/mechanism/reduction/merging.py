"""Point contacts of one body as the edge or the surface that they span: fewer rows, same motion.

The velocities of points that do not lie on a line leave a body no freedom, as a surface does
(6 rows); those of points on a line leave the turn about it, as an edge does (5 rows).
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from itertools import count
from typing import Any

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.base import Constraint
from condyn_pin.constraints.line_contact import LineContact
from condyn_pin.constraints.surface_contact import SurfaceContact
from condyn_pin.dynamics.nominal import described_posture
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import InvalidModel
from condyn_pin.mechanism.reduction.reduced_scene import ReducedScene, reduced
from condyn_pin.model.robot import Robot

_FLAT = 1e-6  # singular values of the points' spread below this, relative to the largest, are zero


def merge_points(scene: Scene, *, edges: bool = True) -> ReducedScene:
    """Return the scene with the points on each frame merged into an edge or a surface: exact.

    Only points without an anchor: they say nothing about where the body is, so nothing is lost.
    The merged contact has the name of the frame, or ``frame/edge``, an edge being on a new
    frame; with a number behind it if that name is another's.

    Parameters
    ----------
    scene : Scene
    edges : bool
        Merge points on a line too. Solvers that know no edges make two points of it again.

    Returns
    -------
    ReducedScene
    """
    robot, constraints, dropped = scene.robot, list(scene.constraints), []
    for frame, points in _groups(constraints).items():
        if not edges and _on_a_line(points):
            continue
        at = constraints.index(points[0])
        constraints = [c for c in constraints if c not in points]
        robot, merged = _merge(robot, frame, points, {c.name for c in constraints})
        constraints.insert(at, merged)
        rows = sum(p.rows for p in points)
        dropped.append(f"contacts on {frame}: {rows} rows of points as {merged.rows} of one")
    return reduced(scene, robot, constraints, described_posture(scene), dropped)


def _groups(constraints: Sequence[Constraint]) -> dict[str, list[Constraint]]:
    found: dict[str, list[Constraint]] = {}
    for constraint in constraints:
        if constraint.point is not None:
            (frame,) = constraint.frames
            found.setdefault(frame, []).append(constraint)
    return {frame: points for frame, points in found.items() if _spread(points)[1][0] > 0}


def _spread(points: Sequence[Constraint]) -> tuple[Array, Array, Array]:
    """Return the middle of the points, the singular values of their spread, and the directions."""
    offsets = np.array([point.point for point in points])
    middle = offsets.mean(axis=0)
    _, S, directions = np.linalg.svd(offsets - middle)
    return middle, np.pad(S, (0, 3 - len(S))), directions


def _on_a_line(points: Sequence[Constraint]) -> bool:
    _, S, _ = _spread(points)
    return bool(S[1] <= _FLAT * S[0])


def _merge(
    robot: Robot, frame: str, points: Sequence[Constraint], taken: Collection[str]
) -> tuple[Robot, Constraint]:
    """Return the contact that the points make, and the robot with its frame; `taken` are names."""
    if not _on_a_line(points):
        name = next(name for name in _numbered(frame) if name not in taken)
        return robot, SurfaceContact(frame, name=name)
    middle, _, directions = _spread(points)
    x, y = directions[0], directions[1]
    R = np.column_stack([x, y, np.cross(x, y)])
    joint, placement = robot.frame(frame)
    place = joint, placement * pin.SE3(R, middle)
    name = next(
        name
        for name in _numbered(f"{frame}/edge")
        if name not in taken and (name not in robot.frames or _is_at(robot, name, place))
    )
    if name not in robot.frames:
        robot = robot.with_frame(name, frame, middle, R)
    half = max(abs(float((np.array(p.point) - middle) @ x)) for p in points)
    return robot, LineContact(name, axis="x", half_length=half)


def _numbered(name: str) -> Iterator[str]:
    """Yield a name, and then the same with numbers from 2 on."""
    yield name
    yield from (f"{name} {i}" for i in count(2))


def _is_at(robot: Robot, frame: str, place: tuple[int, Any]) -> bool:
    """Whether a frame is on a joint and at a placement, as one of an earlier merge can be."""
    try:
        joint, placement = robot.frame(frame)
    except InvalidModel:  # several frames of this name
        return False
    return joint == place[0] and bool(placement == place[1])
