"""The fingerprint of a scene: the same for the same content, in every process.

sha256 of the model as Pinocchio writes it, the constraints, the motors, the springs and the nominal
posture: what accelerations and motions depend on, and what states are drawn from.
"""

from __future__ import annotations

import hashlib

import numpy as np

from condyn_pin.dynamics.nominal import described_posture
from condyn_pin.dynamics.scene import Scene


def fingerprint(scene: Scene) -> str:
    """Return 64 hexadecimal digits; takes about a millisecond."""
    robot = scene.robot
    robot.check_unedited()
    nominal = np.ascontiguousarray(described_posture(scene), dtype="<f8")
    named: tuple[object, ...] = (scene.constraints, tuple(robot.actuated), robot.springs)
    if robot.spring_dampers:  # those of robots without stay as they were
        named += (robot.spring_dampers,)
    parts = (robot.model.saveToString(), *map(repr, named))
    digest = hashlib.sha256()
    for part in (*(text.encode() for text in parts), nominal.tobytes()):
        digest.update(len(part).to_bytes(8, "little"))  # so that parts cannot run together
        digest.update(part)
    return digest.hexdigest()
