"""Keyframes of MJCF as configurations of Pinocchio: quaternions w x y z become x y z w."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Final

import numpy as np

from condyn_pin.arrays import Array
from condyn_pin.errors import InvalidModel
from condyn_pin.io.mjcf_types import COORDINATES, Joint

DRAWN: Final = "qpos0"


def postures(
    joints: Collection[Joint], keyframes: Mapping[str, Array], drawn: Array
) -> dict[str, Array]:
    """Return the keyframes in Pinocchio's order, and last the pose of the file, ``qpos0``.

    Parameters
    ----------
    joints : collection of Joint
        In the order of the file.
    keyframes : mapping of str to array
        Numbers in MuJoCo's order.
    drawn : (nq,) array
        The configuration in which the file draws the model.
    """
    found = {name: _configuration(joints, name, qpos) for name, qpos in keyframes.items()}
    found.setdefault(DRAWN, drawn)
    return found


def _configuration(joints: Collection[Joint], name: str, qpos: Array) -> Array:
    size = sum(COORDINATES[joint.kind] for joint in joints)
    if qpos.size != size:
        raise InvalidModel(f"keyframe {name!r}: qpos has {qpos.size} numbers; {size} are needed")
    q = qpos.copy()
    start = 0
    for joint in joints:
        stop = start + COORDINATES[joint.kind]
        if joint.kind in ("free", "ball"):
            wxyz = q[stop - 4 : stop]
            norm = np.linalg.norm(wxyz)
            # zero is no rotation: MuJoCo reads it as 1 0 0 0, and files count on that
            xyzw = np.roll(wxyz, -1) / norm if norm > 0 else np.array([0.0, 0.0, 0.0, 1.0])
            q[stop - 4 : stop] = xyzw
        start = stop
    return q
