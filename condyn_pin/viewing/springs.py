"""Spring-dampers: bellows from one frame to the other."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.model.robot import Robot
from condyn_pin.viewing import meshes
from condyn_pin.viewing.moment import Moment
from condyn_pin.viewing.palette import SPRING
from condyn_pin.viewing.part import Part, Pose, span

_FOLDS: Final = 12


def spring_parts(robot: Robot, size: float) -> Iterator[Part]:
    """Yield a part for each spring-damper.

    Parameters
    ----------
    robot : Robot
    size : float
        Of the scene [m].
    """
    heights = np.linspace(0.0, 1.0, 2 * _FOLDS + 1)
    radii = 0.008 * size * np.where(np.arange(len(heights)) % 2, 1.0, 0.4)
    radii[[0, -1]] = 0.0
    bellows = meshes.turned(np.column_stack([radii, heights]), 12)
    for each in robot.spring_dampers:
        pose = _between(robot.frame(each.frame_a), robot.frame(each.frame_b))
        yield Part(f"springs/{each.frame_a} - {each.frame_b}", pose, ((bellows, SPRING),))


def _between(one: tuple[int, Any], two: tuple[int, Any]) -> Pose:
    def pose(at: Moment) -> Array | None:
        a, b = ((at.joints[joint] * placement).translation for joint, placement in (one, two))
        return span(a, b)

    return pose
