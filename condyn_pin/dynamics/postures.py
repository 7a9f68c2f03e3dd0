"""Postures: configurations that the description of a robot names."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.errors import InvalidArgument, unknown_name

if TYPE_CHECKING:
    from condyn_pin.dynamics.scene import Scene


def described_posture(scene: Scene, posture: str | None = None) -> Array:
    """Return a posture of the robot as it is in the description; neutral if it has none.

    Parameters
    ----------
    scene : Scene
    posture : str, optional
        Its name; the first one by default.

    Returns
    -------
    q : (nq,) array
        Configuration [rad, m].

    Raises
    ------
    InvalidArgument
        If the name is no text.
    UnknownName
        If there is no such posture.
    """
    postures = scene.robot.postures
    if posture is None:
        q = next(iter(postures.values()), None)
        return np.array(pin.neutral(scene.robot.model) if q is None else q)
    if not isinstance(posture, str):
        raise InvalidArgument(
            f"posture = {posture!r}: the name of a posture is needed; to start from values of "
            "joints, scene.assemble(robot.configuration({joint: value})).q"
        )
    if posture not in postures:
        raise unknown_name("posture", posture, postures)
    return np.array(postures[posture])
