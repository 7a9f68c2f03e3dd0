"""The same motion by fewer rows: points of one body as one contact, a ball in a plane as a pin.

The velocities of points that do not lie on a line leave a body no freedom, as a surface does
(6 rows); those of points on a line leave the turn about it, as an edge does (5 rows).

A ball that closes a planar linkage has two independent rows in place of three,

    J_ball = U S V^T,     S = (s1, s2, 0),     n = u3.

The third column of U is the direction in which the ball says nothing, the normal of the plane. It
becomes the z axis of a new frame at `frame_a`, so that the force is still the one on that body.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from itertools import count
from typing import Any

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import checked
from condyn_pin._core.arrays import Array
from condyn_pin._core.linalg import first_of_largest, rank_of
from condyn_pin.constraints.base import Constraint
from condyn_pin.constraints.line_contact import LineContact
from condyn_pin.constraints.rows.bound import AnyBound
from condyn_pin.constraints.surface_contact import SurfaceContact
from condyn_pin.dynamics.at_state import equations_of
from condyn_pin.dynamics.nominal import described_posture
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import InvalidConstraint, InvalidModel
from condyn_pin.mechanism.reduction.reduced_scene import ReducedScene, reduced
from condyn_pin.model.robot import Robot

_FLAT = 1e-6  # singular values of the points' spread below this, relative to the largest, are zero


def merge_points(scene: Scene, *, edges: bool = True) -> ReducedScene:
    """Return the scene with the points on each frame merged into an edge or a surface: exact.

    Only points without an anchor are merged: they do not fix the position, so nothing is lost. The
    merged contact has the name of the frame, or ``frame/edge`` for an edge, which gets a new frame;
    if the name is taken, a number is appended.

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


def as_planar(scene: Scene, name: str) -> ReducedScene:
    """Return the scene with a ball loop made planar, without its row across the plane.

    Exact: of the three rows of such a ball, two are independent.

    Parameters
    ----------
    scene : Scene
    name : str
        Of the loop.

    Returns
    -------
    ReducedScene

    Raises
    ------
    UnknownName
        If there is no such constraint.
    InvalidConstraint
        If the loop is no ball, or its rows have another rank than 2.
    """
    (chosen,) = checked("name", [name], scene.names, "constraint")
    at = scene.names.index(chosen)
    loop, bound = scene.constraints[at], scene.bounds[at]
    frame = f"{name}/plane"
    pin_joint = loop.as_planar_pin(frame)
    if pin_joint is None:
        raise InvalidConstraint(f"{name}: a loop of kind ball is needed")
    U, S, _ = np.linalg.svd(scene.nominal.terms.J[bound.rows])
    if (rank := rank_of(S)) != 2:
        said = (
            "independent: no plane is left free" if rank == 3 else f"of rank {rank}: no one plane"
        )
        raise InvalidConstraint(f"{name}: its three rows are {said}")
    normal = _in_axes_of_first(scene, bound, U[:, 2])
    robot = scene.robot.with_frame(frame, loop.frames[0], np.zeros(3), _axes(normal))
    if loop in robot.loops:
        loops = [pin_joint if known == loop else known for known in robot.loops]
        robot = replace(robot, loops=loops)
    constraints = [pin_joint if c.name == name else c for c in scene.constraints]
    words = f"loop {name}: a planar pin, the row across the plane being redundant"
    return reduced(scene, robot, constraints, described_posture(scene), (words,))


def _in_axes_of_first(scene: Scene, bound: AnyBound, direction: Array) -> Array:
    """Return a direction in the axes of the rows in those of the frame that was named first.

    The two differ where that frame is the world's, which no row is written in.
    """
    if bound.sign > 0:
        return direction
    q = scene.nominal.q
    ends = equations_of(scene).placements(q)[scene.bounds.index(bound)]
    assert ends is not None  # a loop has two of them
    rows, first = ends
    turned: Array = first.rotation.T @ rows.rotation @ direction
    return turned


def _axes(normal: Array) -> Array:
    """Return axes with z along the normal, the way that its largest component is positive."""
    normal = normal * np.sign(normal[first_of_largest(np.abs(normal))])
    least_along = first_of_largest(1.0 - np.abs(normal))
    x = np.cross(np.eye(3)[least_along], normal)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(normal, x), normal])
