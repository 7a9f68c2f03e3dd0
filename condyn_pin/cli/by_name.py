"""What a line gives by name: values of joints, and forces on frames."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.cli.words import pairs_in
from condyn_pin.constraints.forces import AppliedForce
from condyn_pin.dynamics.nominal import described_posture
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import InvalidArgument, NotAssembled

Texts = Sequence[str] | None


def values_in(option: str, texts: Texts) -> dict[str, list[float]]:
    """Return the numbers of texts NAME=NUMBER or NAME=NUMBER,NUMBER,... by name."""
    example = {"--q": "knee=0.3", "--tau": "knee=60"}.get(option, "foot=0,0,100")
    pairs = pairs_in(option, texts, f"NAME=NUMBER is needed, such as {example}")
    return {name: _numbers(f"{option} {name}", value) for name, value in pairs.items()}


def posture_of(scene: Scene, posture: str | None, q: Texts) -> tuple[Array, list[str]]:
    """Return a posture with the joints of `--q` set, loops as they are, and those joints."""
    values = values_in("--q", q)
    start = described_posture(scene, posture)
    return scene.robot.configuration(_by_joint(values), start=start), list(values)


def state_of(scene: Scene, posture: str | None, q: Texts) -> tuple[Array, Array]:
    """Return (q, v) at a posture with the joints of `--q` set: closed, and at rest."""
    if not q:
        return scene.state(posture)
    start, fixed = posture_of(scene, posture, q)
    try:
        closed = scene.assemble(start, fixed=fixed)
    except NotAssembled as error:
        raise NotAssembled(f"--q {' '.join(q)}: {error}", error.assembly) from error
    return closed.q, np.zeros(scene.robot.nv)


def torque_of(scene: Scene, tau: Texts) -> Array:
    """Return the torques of `--tau`, zero for the other joints."""
    return scene.robot.joint_vector(_by_joint(values_in("--tau", tau)))


def forces_of(scene: Scene, forces: Texts) -> list[AppliedForce]:
    """Return the forces of `--force`, in the axes of the world."""
    values = values_in("--force", forces)
    for frame in values:
        scene.robot.frame(frame)  # a name that is unknown is said with those that are near
    return [AppliedForce(frame, numbers) for frame, numbers in values.items()]


def _by_joint(values: dict[str, list[float]]) -> dict[str, float | list[float]]:
    return {name: x[0] if len(x) == 1 else x for name, x in values.items()}


def _numbers(where: str, text: str) -> list[float]:
    try:
        return [float(word) for word in text.split(",")]
    except ValueError as error:
        raise InvalidArgument(f"{where}={text}: numbers with commas between are needed") from error
