"""A Pinocchio model as words and arrays, and back, the same to the bit and with either Pinocchio.

    words    its name; each joint's name, parent, type; each frame's name, type, joint, parent
    arrays   placements [R | p], inertias, gravity, limits and what else it knows of each joint

What is read may come from a stranger: every index and every size is checked before Pinocchio, which
checks none, sees it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core._pin import VERSION_TEXT, pin
from condyn_pin._core.arrays import Array, finite
from condyn_pin._core.models import UNLIMITED
from condyn_pin._core.tolerances import HUGE
from condyn_pin.errors import InvalidModel

Kind = TypeVar("Kind")
Words = dict[str, Any]
Arrays = dict[str, NDArray[Any]]

_MOST_BODIES: Final = 100_000
_TRIANGLE: Final = np.tril_indices(3)
# What one Pinocchio knows of a joint and another does not, and what it is where nothing is said.
# Pinocchio 4.1 gives the lower limit of a velocity the sign of the upper one.
_BOTH_WAYS: Final = {
    "lowerDryFrictionLimit": ("friction", -1.0),
    "lowerEffortLimit": ("effortLimit", -1.0),
    "lowerVelocityLimit": ("velocityLimit", 1.0),
}
_MARGIN: Final = "positionLimitMargin"
_OF_Q: Final = ("lowerPositionLimit", "upperPositionLimit", _MARGIN)
_OF_V: Final = (
    "armature", "rotorInertia", "rotorGearRatio", "damping",
    "friction", "effortLimit", "velocityLimit", *_BOTH_WAYS,
)  # fmt: skip
_ALWAYS: Final = ("lowerPositionLimit", "upperPositionLimit", *_OF_V[:7])  # of every Pinocchio


def model_words(model: Any) -> tuple[Words, Arrays]:
    """Return a model as words and arrays; InvalidModel if it would not come back as it is."""
    joints, frames = range(1, model.njoints), list(model.frames)
    references = {entry.key(): np.array(entry.data()) for entry in model.referenceConfigurations}
    try:
        words = {
            "name": model.name,
            "bodies": model.nbodies,
            "joints": [
                {"name": model.names[i], "parent": model.parents[i], **joint_words(model.joints[i])}
                for i in joints
            ],
            "frames": [
                {"name": f.name, "type": str(f.type), "joint": f.parentJoint, "in": f.parentFrame}
                for f in frames[1:]
            ],
            "references": list(references),
        }
        arrays = {
            "placements": _placements([model.jointPlacements[i] for i in joints]),
            "inertias": _inertias(model.inertias),
            "frame_placements": _placements([frame.placement for frame in frames[1:]]),
            "frame_inertias": _inertias([frame.inertia for frame in frames[1:]]),
            "gravity": np.array(model.gravity.vector),
            "references": np.array([*references.values()]).reshape(len(references), model.nq),
            **{n: np.array(getattr(model, n)) for n in (*_OF_Q, *_OF_V) if hasattr(model, n)},
        }
        again, _ = model_of(words, arrays)
    except (LookupError, TypeError, ValueError, RuntimeError) as error:
        raise InvalidModel(f"the model of {model.name!r} cannot be saved: {error}") from error
    # == forgets the radii of an ellipsoid
    if not _same_numbers(again.saveToString().split(), model.saveToString().split()):
        raise InvalidModel(
            f"the model of {model.name!r} cannot be saved: it would come back changed, for its "
            "frames or joints were edited by hand; add them by addFrame and addJoint"
        )
    return words, arrays


def _same_numbers(again: Sequence[str], first: Sequence[str]) -> bool:
    """True for equal texts of models, but for limits that are infinite in what was read again."""
    # Of acceleration and jerk, which Pinocchio 4 keeps and Python cannot reach.
    pairs = zip(again, first, strict=False)
    changed = {new for new, old in pairs if new != old} - {"inf", "-inf"}
    return len(again) == len(first) and not changed


def model_of(words: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> tuple[Any, list[str]]:
    """Return the model of untrusted words and arrays, and the numbers it lost, a sentence each."""
    # LookupError, TypeError, ValueError or RuntimeError if they are of no model.
    joints, frames = _a(list, words["joints"]), _a(list, words["frames"])
    n, f = len(joints), len(frames)
    model = pin.Model()
    model.name = _a(str, words["name"])
    model.gravity = pin.Motion(_array(arrays, "gravity", (6,)))
    placements = _array(arrays, "placements", (n, 3, 4))
    for i, (joint, R_p) in enumerate(zip(joints, placements, strict=True), 1):
        parent = _index(joint["parent"], i)
        model.addJoint(parent, joint_of(joint), _se3(R_p), _a(str, joint["name"]))
    for _ in range(_index(words["bodies"], _MOST_BODIES) - 1):  # Pinocchio counts them, no more
        model.appendBodyToJoint(0, pin.Inertia.Zero(), pin.SE3.Identity())
    for i, numbers in enumerate(_array(arrays, "inertias", (n + 1, 10))):
        model.inertias[i] = _inertia(numbers)
    placements = _array(arrays, "frame_placements", (f, 3, 4))
    inertias = _array(arrays, "frame_inertias", (f, 10))
    for frame, R_p, numbers in zip(frames, placements, inertias, strict=True):
        kind = pin.FrameType.names[_a(str, frame["type"])]
        parents = _index(frame["joint"], n + 1), _index(frame["in"], f + 1)
        made = pin.Frame(_a(str, frame["name"]), *parents, _se3(R_p), kind, _inertia(numbers))
        model.addFrame(made, False)  # its inertia is on the joint already
    if model.nframes != f + 1:
        raise ValueError("two frames of one type have the same name")
    names = [_a(str, name) for name in _a(list, words["references"])]
    for name, q in zip(names, _array(arrays, "references", (len(names), model.nq)), strict=True):
        model.referenceConfigurations[name] = q.copy()
    return model, _set_numbers(model, arrays)


def _set_numbers(model: Any, arrays: Mapping[str, NDArray[Any]]) -> list[str]:
    """Set limits and other numbers of joints; return those that this Pinocchio has no place for."""
    sizes = dict.fromkeys(_OF_Q, (model.nq,)) | dict.fromkeys(_OF_V, (model.nv,))
    read = {
        name: _array(arrays, name, size)
        for name, size in sizes.items()
        if name in arrays or name in _ALWAYS
    }
    usual = {_MARGIN: np.zeros(model.nq)}
    usual |= {lower: sign * read[upper] for lower, (upper, sign) in _BOTH_WAYS.items()}
    lost = []
    for name, values in (usual | read).items():
        if hasattr(model, name):
            setattr(model, name, values.copy())
        elif ((np.abs(values) != np.abs(usual[name])) & (np.abs(values) < UNLIMITED)).any():
            lost.append(f"{name} of the joints, for which Pinocchio {VERSION_TEXT} has no place")
    return lost


def _placements(placements: Sequence[Any]) -> Array:
    return np.array([M.homogeneous[:3] for M in placements]).reshape(len(placements), 3, 4)


def _inertias(inertias: Any) -> Array:
    rows = [[Y.mass, *Y.lever, *Y.inertia[_TRIANGLE]] for Y in inertias]
    return np.array(rows).reshape(len(rows), 10)


def _se3(R_p: Array) -> Any:
    return pin.SE3(R_p[:, :3].copy(), R_p[:, 3].copy())


def _inertia(numbers: Array) -> Any:
    """Inertia of exactly these numbers: the constructor refuses a rod's after rounding."""
    inertia, matrix = pin.Inertia.Zero(), np.zeros((3, 3))
    matrix[_TRIANGLE] = matrix.T[_TRIANGLE] = numbers[4:]
    inertia.mass, inertia.lever, inertia.inertia = float(numbers[0]), numbers[1:4], matrix
    return inertia


def _array(arrays: Mapping[str, NDArray[Any]], name: str, shape: tuple[int, ...]) -> Array:
    array = arrays[name]
    if array.shape != shape or array.dtype != np.float64:
        raise ValueError(f"{name} has shape {array.shape} of {array.dtype}: {shape} is needed")
    return array


def _a(kind: type[Kind], value: Any) -> Kind:
    if not isinstance(value, kind):
        raise TypeError(f"{value!r}: a {kind.__name__} is needed")
    return value


def _index(value: Any, count: int) -> int:
    if type(value) is not int or value not in range(count):
        raise ValueError(f"{value!r}: a number from 0 to {count - 1} is needed")
    return value


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
        placed = ((joint_words(part), M.homogeneous[:3].ravel()) for part, M in parts)
        return {"type": kind, "parts": [part | {"placement": x.tolist()} for part, x in placed]}
    if kind == _ANY_ANGLE:  # which does not tell its axis, but turns about it
        return {"type": kind, "axis": _axis_of(joint).tolist()}
    if kind not in _MADE_OF:
        raise ValueError(f"a joint of type {kind} cannot be written to a file")
    numbers = {name: getattr(joint, name) for name in _MADE_OF[kind]}
    return {"type": kind} | {name: np.asarray(x).tolist() for name, x in numbers.items()}


def joint_of(words: Mapping[str, Any]) -> Any:
    """Return the joint of untrusted words and numbers; any error if they are of none."""
    kind = words["type"]
    if kind == _COMPOSITE:
        return _composite(words["parts"])
    if kind not in _MADE_OF:
        raise ValueError(f"no joint type {kind!r} is known")
    numbers = {name: _numbers(name, words[name], n) for name, n in _MADE_OF[kind].items()}
    if kind == _ANY_ANGLE:
        return _hinge_about(numbers["axis"])
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
        composite.addJoint(joint_of(part), _se3(R_p))
    return composite


def _numbers(name: str, value: Any, shape: tuple[int, ...]) -> Array:
    array = finite(name, value, shape)
    if (np.abs(array) > HUGE).any() or (name.startswith("axis") and not array.any()):
        raise ValueError(f"{name} = {value!r} of a joint")
    return array


def _axis_of(joint: Any) -> Array:
    """Axis of a hinge whose q is (cos, sin)."""
    alone = pin.JointModel(joint)
    alone.setIndexes(1, 0, 0)
    data = alone.createData()
    alone.calc(data, np.array([1.0, 0.0]))
    axis: Array = np.array(data.S, dtype=float).ravel()[3:]
    return axis


def _hinge_about(axis: Array) -> Any:
    """Hinge about an axis, its q being (cos, sin)."""
    # Pinocchio makes one only from a URDF, and normalises its axis once more. So a URDF with
    # another axis is read, and the axis is put in its place in Pinocchio's own text of that model.
    model = pin.buildModelFromXML(_ANY_ANGLE_URDF)
    text = model.saveToString()
    for old, new in zip(_axis_of(model.joints[1].extract()), axis, strict=True):
        text = text.replace(f"{old:.17e}", f"{new:.17e}")  # exact, in Pinocchio's format
    model.loadFromString(text)
    return model.joints[1].extract()


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
