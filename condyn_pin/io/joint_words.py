"""Pinocchio's joints in words and numbers, and back, the same to the bit.

{"type": "RevoluteUnaligned", "axis": [x, y, z]}
{"type": "Composite", "parts": [{"type": "PX", "placement": [R | p]}, ...]}
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array, finite
from condyn_pin._core.tolerances import HUGE

_PREFIX: Final = "JointModel"
_PLAIN: Final = (
    "RX", "RY", "RZ", "RUBX", "RUBY", "RUBZ", "PX", "PY", "PZ",
    "Translation", "Spherical", "SphericalZYX", "Planar", "FreeFlyer",
)  # fmt: skip
# What a type is made of, and how many numbers each has; () is one number.
_AXIS: Final[dict[str, tuple[int, ...]]] = {"axis": (3,)}
_MADE_OF: Final[dict[str, dict[str, tuple[int, ...]]]] = {
    **{kind: {} for kind in _PLAIN},
    **{kind: {"pitch": ()} for kind in ("HX", "HY", "HZ")},
    "HelicalUnaligned": _AXIS | {"pitch": ()},
    "RevoluteUnaligned": _AXIS,
    "RevoluteUnboundedUnaligned": _AXIS,
    "PrismaticUnaligned": _AXIS,
    "Universal": {"axis1": (3,), "axis2": (3,)},
    "Ellipsoid": {"radius_x": (), "radius_y": (), "radius_z": ()},
}
_COMPOSITE: Final = "Composite"
_ANY_ANGLE: Final = "RevoluteUnboundedUnaligned"


def joint_words(joint: Any) -> Words:
    """Return a joint as words and numbers."""
    joint = joint.extract() if hasattr(joint, "extract") else joint
    kind = joint.shortname().removeprefix(_PREFIX)
    if kind == _COMPOSITE:
        parts = zip(joint.joints, joint.jointPlacements, strict=True)
        placed = ((joint_words(part), _placement_numbers(M)) for part, M in parts)
        return {"type": kind, "parts": [part | {"placement": at} for part, at in placed]}
    if kind == _ANY_ANGLE:  # which does not tell its axis, but turns about it
        return {"type": kind, "axis": _axis_of(joint).tolist()}
    if kind not in _MADE_OF:
        raise ValueError(f"a joint of type {kind} cannot be written to a file")
    numbers = {name: getattr(joint, name) for name in _MADE_OF[kind]}
    return {"type": kind} | {name: np.asarray(x).tolist() for name, x in numbers.items()}


def joint_of(words: Mapping[str, Any]) -> Any:
    """Return the joint of words and numbers that may come from a stranger.

    Raises
    ------
    ValueError, LookupError, TypeError
        If they are of no joint.
    """
    kind = words["type"]
    if kind == _COMPOSITE:
        return _composite(words["parts"])
    if kind not in _MADE_OF:
        raise ValueError(f"no joint type {kind!r} is known")
    numbers = {name: _numbers(name, words[name], n) for name, n in _MADE_OF[kind].items()}
    if kind == _ANY_ANGLE:
        return _about(numbers["axis"])
    values = (array if array.ndim else float(array) for array in numbers.values())
    return getattr(pin, _PREFIX + kind)(*values)


def _composite(parts: Any) -> Any:
    if not isinstance(parts, list) or not parts:
        raise ValueError("a composite joint without parts")
    composite = pin.JointModelComposite()
    for part in parts:
        if part["type"] == _COMPOSITE:
            raise ValueError("a composite joint in a composite joint")
        R_p = _numbers("placement", part["placement"], (12,)).reshape(3, 4)
        composite.addJoint(joint_of(part), pin.SE3(R_p[:, :3].copy(), R_p[:, 3].copy()))
    return composite


def _placement_numbers(M: Any) -> list[float]:
    numbers: list[float] = M.homogeneous[:3].ravel().tolist()
    return numbers


def _numbers(name: str, value: Any, shape: tuple[int, ...]) -> Array:
    array = finite(name, value, shape)
    if (np.abs(array) > HUGE).any() or (name.startswith("axis") and not array.any()):
        raise ValueError(f"{name} = {value!r} of a joint")
    return array


def _axis_of(joint: Any) -> Array:
    """Return the axis of a hinge whose q is (cos, sin)."""
    alone = pin.JointModel(joint)
    alone.setIndexes(1, 0, 0)
    data = alone.createData()
    alone.calc(data, np.array([1.0, 0.0]))
    axis: Array = np.array(data.S, dtype=float).ravel()[3:]
    return axis


def _about(axis: Array) -> Any:
    """Return a hinge about an axis whose q is (cos, sin).

    Pinocchio makes one only from a URDF, and normalises its axis once more. So a URDF with another
    axis is read, and the axis is put in its place in Pinocchio's own text of that model.
    """
    model = pin.buildModelFromXML(_ANY_ANGLE_URDF)
    text = model.saveToString()
    for old, new in zip(_axis_of(model.joints[1].extract()), axis, strict=True):
        text = text.replace(_written(old), _written(new))
    model.loadFromString(text)
    return model.joints[1].extract()


def _written(number: float) -> str:
    """Return a number as Pinocchio writes it, exactly."""
    return f"{number:.17e}"


# Its axis has numbers that nothing else in the model has; its limits are finite, for 3.9 reads back
# no other.
_ANY_ANGLE_URDF: Final = """
<robot name="r">
  <link name="a"/>
  <link name="b"/>
  <joint name="j" type="continuous">
    <parent link="a"/><child link="b"/>
    <axis xyz="0.2345 0.3456 0.4567"/>
    <limit effort="1" velocity="1"/>
  </joint>
</robot>
"""
