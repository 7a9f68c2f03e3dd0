"""Quaternions that are not of unit length."""

from __future__ import annotations

import numpy as np

from condyn_pin._core.arguments import Arguments
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import InvalidArgument
from condyn_pin.lab.extremes.base import Case, by_reference, extreme, moving, powers


@extreme(severities=(*powers(-16, -7), 9e-7, *powers(-6, -1), -1.0), any_scene=True)
def loose_quaternion(severity: float, rng: np.random.Generator, scene: Scene) -> Case:
    """How far the length of every quaternion of q is from one; -1 makes it zero."""
    q, v, tau = moving(scene, rng)
    at = [offset // q.itemsize for offset in Arguments(scene.robot.model).quaternions]
    if not at:
        raise InvalidArgument(f"{scene.robot.name} has no quaternion")
    # with quaternions of unit length
    right = (by_reference(scene, q, v, tau),) if severity < 0.1 else ()
    for start in at:
        q[start : start + 4] *= 1.0 + severity
    return Case(scene, q, v, tau, right)
