"""Quaternions that are not of unit length."""

from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import InvalidArgument
from condyn_pin.lab.extremes.base import Case, Rng, by_reference, extreme, moving, powers


@extreme(*powers(-16, -7), 9e-7, *powers(-6, -1), -1.0)
def loose_quaternion(severity: float, rng: Rng, scene: Scene) -> Case:
    """How far the length of every quaternion of q is from one; -1 makes it zero."""
    q, v, tau = moving(scene, rng)
    at = [offset // q.itemsize for offset in scene.robot.arguments.quaternions]
    if not at:
        raise InvalidArgument(f"{scene.robot.name} has no quaternion")
    # with quaternions of unit length
    right = (by_reference(scene, q, v, tau),) if severity < 0.1 else ()
    for start in at:
        q[start : start + 4] *= 1.0 + severity
    return Case(scene, q, v, tau, right)
