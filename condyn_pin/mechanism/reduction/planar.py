"""A ball that closes a planar linkage as a planar pin: two independent rows in place of three.

    J_ball = U S V^T,     S = (s1, s2, 0),     n = u3

The third column of U is the direction in which the ball says nothing, the normal of the plane. It
becomes the z axis of a new frame at `frame_a`, so that the force is still the one on that body.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array
from condyn_pin._core.linalg.pivots import first_of_largest
from condyn_pin._core.names import checked
from condyn_pin.constraints.rows.any_bound import AnyBound
from condyn_pin.constraints.rows.equations import Equations
from condyn_pin.dynamics.nominal import described_posture
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import InvalidConstraint
from condyn_pin.mechanism.reduction.reduced_scene import ReducedScene, reduced


def as_planar(scene: Scene, name: str) -> ReducedScene:
    """Return the scene in which a ball loop says nothing across the plane of its linkage.

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
    rank = int(np.count_nonzero(tolerances.RANK * S[0] < S))
    if rank != 2:
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
    placements = Equations(scene.robot.model, scene.bounds).placements(scene.nominal.q)
    ends = placements[scene.bounds.index(bound)]
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
