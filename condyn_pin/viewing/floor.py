"""The floor: a grid in the plane z = 0, or below what hangs from there; its squares give the scale.

meshcat's own grid is of lines, which software renderers drop where they pass behind the camera.
"""

from __future__ import annotations

import math

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.viewing import meshes
from condyn_pin.viewing.palette import Colour
from condyn_pin.viewing.part import Part

_LINE: Colour = (0.88, 0.88, 0.88)
_HALF = 8  # squares from the middle to the edge


def spacing(size: float) -> float:
    """Return the edge of a square [m]: 1, 2 or 5 times a power of ten, near a sixth of `size`."""
    power = 10.0 ** math.floor(math.log10(size / 6.0))
    return power * max(step for step in (1, 2, 5) if step * power <= size / 6.0)


def floor_part(middle: Array, size: float) -> Part:
    """Return the grid under a scene, its lines on whole multiples of the spacing."""
    height = 0.0 if middle[2] >= 0.0 else middle[2] - 0.5 * size
    step = spacing(size)
    centre = np.round(middle[:2] / step) * step
    long, thin = 2.0 * _HALF * step, 0.0025 * size
    corners = np.array([(-0.5, -0.5, 0.0), (0.5, -0.5, 0.0), (0.5, 0.5, 0.0), (-0.5, 0.5, 0.0)])
    line = meshes.Mesh(corners, np.array([(0, 1, 2), (0, 2, 3)], dtype=np.uint32))
    lines = meshes.Mesh(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.uint32))
    for i in range(-_HALF, _HALF + 1):
        for x, y, at in ((long, thin, (0.0, i * step)), (thin, long, (i * step, 0.0))):
            T = np.diag([x, y, 1.0, 1.0])
            T[:3, 3] = *(centre + at), height
            lines = lines + line.moved(T)
    return Part("floor", lambda _: np.eye(4), ((lines, _LINE),))
