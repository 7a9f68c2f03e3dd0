"""Configurations of MJCF in Pinocchio's order: quaternions w x y z become x y z w.

MuJoCo calls the configuration in which a file draws the model qpos0. It is zero only where no joint
has a `ref`: MuJoCo takes it for where each joint starts, and for what its soft constraints weigh.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING, Final

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.errors import InvalidModel
from condyn_pin.io.mjcf_types import COORDINATES, Joint

if TYPE_CHECKING:
    from condyn_pin.model.robot import Robot

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
    found.pop(DRAWN, None)  # the name is taken
    return found | {DRAWN: drawn}


def hidden(found: Mapping[str, Array], joints: Collection[Joint], qpos: Array | None) -> str:
    """Say that a keyframe of the name ``qpos0`` is another pose than the one that is drawn."""
    if qpos is None:
        return ""
    apart = np.abs(_configuration(joints, DRAWN, qpos) - found[DRAWN]).max(initial=0.0)
    if apart <= tolerances.DRAWN:
        return ""
    return (
        f"keyframe {DRAWN!r}: the pose in which the file draws the model has this name; rename it"
    )


def drawn(robot: Robot) -> Array:
    """Return the configuration (nq,) in which an MJCF of the robot draws it.

    That of its posture ``qpos0``, which comes with every MJCF, else neutral. A ball has no `ref`:
    in MuJoCo it is drawn at 1 0 0 0.
    """
    neutral = np.array(pin.neutral(robot.model))
    q = np.array(robot.postures.get(DRAWN, neutral))
    for joint in robot.model.joints[1:]:
        if joint.nq == 4 and joint.nv == 3:
            turned = slice(joint.idx_q, joint.idx_q + 4)
            q[turned] = neutral[turned]
    return q


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
