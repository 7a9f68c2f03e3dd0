"""Where the camera is at first: from the middle of what is seen, along the normal of a linkage."""

from __future__ import annotations

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.viewing.labels import Eye

_FAR = 1.15  # of the size of a scene, from its middle to the camera
FROM = np.array([0.78, 0.55, 0.3])  # the direction from there to the camera
_FLAT = 0.9  # of the normal's z: above this a plane is seen as a floor is
_TILT = 0.2  # of a linkage in a plane: how far above its normal, and beside it, the camera is


def eye_at(middle: Array, size: float, toward: Array) -> Eye:
    """Return the camera that sees all of a size from a direction."""
    return Eye(middle + _FAR * size * toward, middle)


def toward_of(normal: Array | None) -> Array:
    """Return where the camera is from the middle: nearly along the normal of a linkage's plane."""
    if normal is None:
        return FROM
    if abs(normal[2]) > _FLAT:  # from above, y going up
        toward = np.sign(normal[2]) * normal - [0.0, _TILT, 0.0]
    else:
        right = np.cross([0.0, 0.0, 1.0], normal)
        sign = 1.0 if right.sum() >= 0.0 else -1.0  # x, or y, goes to the right
        toward = sign * (normal + _TILT * right) + [0.0, 0.0, _TILT]
    found: Array = toward / np.linalg.norm(toward)
    return found
