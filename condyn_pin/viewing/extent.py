"""Extent: where a scene is, and how large, for the camera and for the size of its marks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.joints import axes
from condyn_pin.model.robot import Robot
from condyn_pin.viewing.instant import Instant

_ALONG = 1e-6  # of a unit axis: what it may be off a plane, or off its normal, by
_TINY = 0.05  # [m] a scene is drawn as if it were at least this large


def touched(instants: Sequence[Instant]) -> list[Array]:
    """Return what contacts that may let go pass through: their points, and those of their planes.

    A fall is seen with the ground, and what slides with where it comes to rest.
    """
    touching = [each for at in instants for each in at.touching.values()]
    return [point for each in touching for point in (each.at, each.on_plane())]


def extent(
    robot: Robot, instants: Sequence[Instant], also: Sequence[Array] = ()
) -> tuple[Array, float]:
    """Return the middle and the size of what joints, frames and masses span, and points [m].

    A body reaches as far from its centre of mass as a ball of its mass m and inertia I does:
    r^2 = 5 trace(I) / (6 m).
    """
    points = list(also)
    for at in instants:
        points += [oMi.translation for oMi in at.joints[1:]]
        points += [
            at.joints[frame.parentJoint].act(frame.placement.translation)
            for frame in robot.model.frames
            if frame.parentJoint
        ]
        for oMi, inertia in zip(at.joints[1:], list(robot.model.inertias)[1:], strict=True):
            if inertia.mass > 0.0:
                r = np.sqrt(max(np.trace(inertia.inertia), 0.0) / (1.2 * inertia.mass))
                points += [oMi.act(inertia.lever) + r, oMi.act(inertia.lever) - r]
    low, high = np.min(points, axis=0), np.max(points, axis=0)
    return 0.5 * (low + high), max(float(np.linalg.norm(high - low)), _TINY)


def plane_normal(robot: Robot, at: Instant) -> Array | None:
    """Return the normal of the plane in which all joints move (3,); None if there is none.

    Every axis of turning is along it, and every direction of sliding across it.
    """
    still = pin.neutral(robot.model)
    slides, turns = [], []
    for joint, oMi in zip(robot.model.joints[1:], at.joints[1:], strict=True):
        S = axes(joint, still)
        slides += [oMi.rotation @ column for column in S[:3].T if np.linalg.norm(column) > _ALONG]
        turns += [oMi.rotation @ column for column in S[3:].T if np.linalg.norm(column) > _ALONG]
    if not turns:
        return None
    normal: Array = turns[0] / np.linalg.norm(turns[0])
    across = [np.linalg.norm(np.cross(normal, axis)) for axis in turns]
    along = [abs(normal @ direction) for direction in slides]
    return normal if max(across + along) < _ALONG else None
