"""Orientations as MJCF writes them.

quat       w x y z
axisangle  x y z, angle: the turn about (x, y, z)
euler      three angles, about the axes that `eulerseq` names: small letters turn with the
           body, R = R1 R2 R3; capitals stay with the parent, R = R3 R2 R1
xyaxes     x axis, y axis; what of y is along x is taken off
zaxis      the shortest turn that takes z there
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.io.mjcf_words import ORIENTATIONS
from condyn_pin.io.mjcf_xml import Attributes

_PARALLEL = 1e-9  # sine of an angle: the third axis would have lost half of its digits


@dataclass(frozen=True)
class Settings:
    """What <compiler> says about numbers.

    Attributes
    ----------
    angle : float
        Radians in a unit of angle of the file.
    eulerseq : str
        Axes of the three angles of `euler`.
    autolimits : bool
        Whether a range alone makes a limit.
    """

    angle: float = np.pi / 180
    eulerseq: str = "xyz"
    autolimits: bool = True


def pose(said: Attributes, settings: Settings) -> Any:
    """Return the pose that an element has."""
    return pin.SE3(_rotation(said, settings), said.floats("pos", 3, np.zeros(3)))


def direction(said: Attributes, key: str, values: Array) -> Array:
    """Return a vector of length 1."""
    if not values.any():
        said.refuse(key, "zero has no direction")
    values = values / np.abs(values).max()  # first, so that the squares cannot overflow or vanish
    return np.asarray(values / np.linalg.norm(values))


def _rotation(said: Attributes, settings: Settings) -> Array:
    given = list(said.given(*ORIENTATIONS))
    if len(given) > 1:
        said.refuse(given[1], f"{given[0]} is there as well; keep one of them")
    if not given:
        return np.eye(3)
    return _READERS[given[0]](said, settings)


def _quat(said: Attributes, _: Settings) -> Array:
    w, x, y, z = direction(said, "quat", said.floats("quat", 4))
    return np.array(pin.Quaternion(w, x, y, z).toRotationMatrix())


def _axisangle(said: Attributes, settings: Settings) -> Array:
    values = said.floats("axisangle", 4)
    return _turn(direction(said, "axisangle", values[:3]), values[3] * settings.angle)


def _euler(said: Attributes, settings: Settings) -> Array:
    R = np.eye(3)
    for letter, angle in zip(settings.eulerseq, said.floats("euler", 3), strict=True):
        turn = _turn(np.eye(3)["xyz".index(letter.lower())], angle * settings.angle)
        R = R @ turn if letter.islower() else turn @ R
    return R


def _xyaxes(said: Attributes, _: Settings) -> Array:
    values = said.floats("xyaxes", 6)
    x = direction(said, "xyaxes", values[:3])
    y = direction(said, "xyaxes", values[3:])
    y = y - x * (x @ y)
    if np.linalg.norm(y) < _PARALLEL:
        said.refuse("xyaxes", "two axes that are not parallel are needed")
    y /= np.linalg.norm(y)
    return np.column_stack([x, y, np.cross(x, y)])


def _zaxis(said: Attributes, _: Settings) -> Array:
    z = direction(said, "zaxis", said.floats("zaxis", 3))
    axis = np.cross([0.0, 0.0, 1.0], z)
    if not axis.any():
        axis = np.array([1.0, 0.0, 0.0])
    return _turn(axis / np.linalg.norm(axis), np.arctan2(np.hypot(z[0], z[1]), z[2]))


def _turn(axis: Array, angle: float) -> Array:
    return np.array(pin.exp3(axis * angle))


_READERS = {
    "quat": _quat,
    "axisangle": _axisangle,
    "euler": _euler,
    "xyaxes": _xyaxes,
    "zaxis": _zaxis,
}
