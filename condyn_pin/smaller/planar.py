"""A ball that closes a planar linkage as a planar pin: two independent rows in place of three."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from condyn_pin import tolerances
from condyn_pin.arrays import Array
from condyn_pin.constraints import Loop
from condyn_pin.errors import InvalidConstraint
from condyn_pin.rows.bound import Bound
from condyn_pin.scene import Scene
from condyn_pin.smaller.reduction import ReducedScene, reduced


def as_planar(scene: Scene, name: str) -> ReducedScene:
    """Return the scene in which a ball loop says nothing across the plane of its linkage.

    The three rows of the ball have rank 2; the direction in which they say nothing is the normal of
    the plane. It becomes the z axis of a new frame on the body of `frame_a`.

    Raises
    ------
    InvalidConstraint
        If the loop is no ball, or its rows are independent.
    """
    loop = next((c for c in scene.constraints if c.name == name), None)
    bound = next((b for b in scene.bounds if b.name == name), None)
    if not isinstance(loop, Loop) or loop.kind != "ball" or not isinstance(bound, Bound):
        raise InvalidConstraint(f"{name}: a loop of kind ball is needed")
    U, S, _ = np.linalg.svd(scene.audit.terms.J[bound.rows])
    if S[2] > tolerances.RANK * S[0]:
        raise InvalidConstraint(f"{name}: its three rows are independent: no plane is left free")
    first, second = loop.frame_a, loop.frame_b
    if bound.sign < 0:  # the world was named first: the rows are in the axes of the other frame
        first, second = second, first
    frame = f"{name}/plane"
    robot = scene.robot.with_frame(frame, first, np.zeros(3), _axes(U[:, 2]))
    pin_joint = Loop(frame, second, "planar", axis="z", name=name)
    if loop in robot.loops:
        loops = [pin_joint if known == loop else known for known in robot.loops]
        robot = replace(robot, loops=loops)
    constraints = [pin_joint if c.name == name else c for c in scene.constraints]
    words = f"loop {name}: a planar pin, the row across the plane being redundant"
    return reduced(scene, robot, constraints, scene.guess(), (words,))


def _axes(normal: Array) -> Array:
    """Return axes with z along the normal."""
    x = np.cross(np.eye(3)[int(np.argmin(np.abs(normal)))], normal)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(normal, x), normal])
