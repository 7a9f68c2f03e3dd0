"""Places: frames that no model has, each a joint and a placement on it, written as a text.

    knee + [0.1 0 0]                  0.1 m along x of the joint `knee`, in its axes
    knee + [0.1 0 0 0 0 0.6 0.8]      and turned by the quaternion x y z w

A frame is a text wherever one is held, in constraints, files and messages, so that these know of
nothing else. A pair (joint, `pin.SE3`) becomes such a text with all digits of its numbers. Where no
model is known yet a joint that is given by its number stays one, and a `pin.Frame` keeps its name:

    #3 + [0.1 0 0]                    joint 3
    sole (#3 + [0.1 0 0])             the pin.Frame `sole`

A scene, and a robot, put names in place of numbers, which differ in a smaller one. `find_frame` has
the joint that carries a frame, and the placement on it.
"""

from __future__ import annotations

import math
import re
from dataclasses import is_dataclass, replace
from operator import index
from typing import Any, Final, NamedTuple, TypeAlias, TypeVar

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import text_of
from condyn_pin._core.models import rotation_fault
from condyn_pin.errors import InvalidArgument, InvalidModel, UnknownName, unknown_name

Value = TypeVar("Value")

# Names of the world.
WORLD: Final = ("world", "universe")

# A frame as users give it: its name, a pair (joint, pin.SE3), or a pin.Frame. The latter have no
# types, and a field of this type holds the text of the frame: any value may be set, a text is read.
FrameLike: TypeAlias = str | Any

_NUMBERS: Final = r"\[([-+.0-9eE ]+)\]"
_NUMBER: Final = "#[0-9]{1,9}"
_PLACE: Final = re.compile(rf"(.+) \+ {_NUMBERS}", re.DOTALL)
_LABELLED: Final = re.compile(rf"(.+) \(({_NUMBER} \+ {_NUMBERS})\)", re.DOTALL)
_NUMBERED: Final = re.compile(rf"{_NUMBER}(?= \+ \[)")

_DEEPEST: Final = 3  # places on places that a text may have


class Place(NamedTuple):
    """A joint or a frame, and a placement on it."""

    base: str
    placement: Any  # pin.SE3


def frame_text(argument: str, value: Any) -> str:
    """Text of a frame: of a name, a pair (joint, pin.SE3) or a pin.Frame; or InvalidArgument."""
    if isinstance(value, str) and value:
        return value
    if isinstance(value, pin.Frame):
        at = _text(argument, _joint(argument, value.parentJoint), value.placement)
        return f"{value.name} ({at})" if at.startswith("#") and value.name else at
    pair = isinstance(value, tuple | list) and len(value) == 2
    if pair and isinstance(value[1], pin.SE3):
        return _text(argument, _joint(argument, value[0]), value[1])
    raise InvalidArgument(
        f"{argument} = {text_of(value)}: the name of a frame is needed, or (joint, pin.SE3), or a "
        "pin.Frame"
    )


def set_frames(value: Any, *fields: str) -> None:
    """Set fields of a frozen value, each a frame in any form, to the texts of them."""
    for field in fields:
        object.__setattr__(value, field, frame_text(field, getattr(value, field)))


def _joint(argument: str, joint: Any) -> str:
    """Joint of a pair as a text: its name, or #number; the world for joint 0."""
    if isinstance(joint, str) and joint:
        return joint
    try:
        number = -1 if isinstance(joint, bool) else index(joint)
    except TypeError:
        number = -1
    if not 0 <= number < 10**9:
        raise InvalidArgument(f"{argument}: joint {text_of(joint)}: its name or number is needed")
    return f"#{number}" if number else "world"


def _text(argument: str, base: str, placement: Any) -> str:
    """Text of a placement on a base: three numbers, or seven where it is turned."""
    p, R = placement.translation, placement.rotation
    if not (np.abs(p) <= tolerances.HUGE).all():
        raise InvalidArgument(
            f"{argument}: its placement is at {p.tolist()}: finite numbers [m] are needed"
        )
    if fault := rotation_fault(R):
        raise InvalidArgument(f"{argument}: its placement has no valid rotation: {fault}")
    numbers = p if (np.eye(3) == R).all() else pin.SE3ToXYZQUAT(placement)
    # 0.0 for -0.0, and whole numbers without a point
    return f"{base} + [{' '.join(f'{x + 0.0!r}'.removesuffix('.0') for x in numbers.tolist())}]"


def place_of(text: str) -> Place | None:
    """Base and placement of a text; None for a plain name."""
    labelled = _LABELLED.fullmatch(text)
    found = _PLACE.fullmatch(labelled[2] if labelled else text)
    if not found:
        return None
    if found[1].count(" + [") > _DEEPEST:
        raise InvalidArgument(
            f"frame = {text_of(text)}: a place on a place on a place; name one with "
            "Robot.with_frame"
        )
    try:
        numbers = [float(number) for number in found[2].split()]
    except ValueError:
        return None
    p, turn = np.array(numbers[:3]), np.array(numbers[3:] or [0.0, 0.0, 0.0, 1.0])
    largest = float(np.abs(turn).max())
    known = len(p) == 3 and len(turn) == 4 and 0.0 < largest < math.inf
    if not known or np.abs(p).max() > tolerances.HUGE:
        raise InvalidArgument(
            f"frame = {text!r}: x y z [m] are needed in brackets, or x y z and a quaternion x y z w"
        )
    turn /= largest  # its square may be too small, or too large, for a number
    placement = pin.XYZQUATToSE3(np.concatenate((p, turn / np.linalg.norm(turn))))
    return Place(found[1], placement)


def number_of(base: str) -> int | None:
    """Number of a joint that is given by one; None for a name."""
    return int(base[1:]) if re.fullmatch(_NUMBER, base) else None


def short_frames(text: str) -> str:
    """Text of frames for names: four digits of each number, and a pin.Frame by its name."""
    text = re.sub(rf" \({_NUMBER} \+ {_NUMBERS}\)", "", text)
    return re.sub(rf"(?<= \+ ){_NUMBERS}", _four_digits, text)


def _four_digits(found: re.Match[str]) -> str:
    return f"[{' '.join(f'{float(x):.4g}' for x in found[1].split())}]"


# Names for numbers, once there is a model.


def by_name(machine: Any, text: str) -> str:
    """Text of a frame with the name of its joint, or a pin.Frame's own name where it is that."""
    labelled = _LABELLED.fullmatch(text)
    if labelled:
        joint, placement = machine.frame(text)
        label, text = labelled[1], labelled[2]
        there = [f for f in machine.model.frames if f.name == label]
        if there and all(f.parentJoint == joint and f.placement.isApprox(placement) for f in there):
            return label
    if not _NUMBERED.match(text):
        return text
    joint, _ = machine.frame(text)
    return _NUMBERED.sub(lambda _: str(machine.model.names[joint]), text, count=1)


def with_joint_names(value: Value, machine: Any) -> Value:
    """Constraint, contact or spring of a machine whose frames name joints, and do not number them.

    A name that it has from its frames follows them.
    """
    if not is_dataclass(value):
        return value
    given: Any = value
    changed: dict[str, Any] = {}
    name = getattr(given, "name", "")
    for field, old in vars(given).items():
        if field != "name" and isinstance(old, str):
            new = by_name(machine, old)
            if new != old:
                changed[field] = new
                if not _LABELLED.fullmatch(old):
                    name = name.replace(short_frames(old), short_frames(new))
        elif field == "through":  # the frames of a cable
            through = tuple(by_name(machine, frame) for frame in old)
            if through != old:
                changed[field] = through
                name = "-".join(through) if name == short_frames("-".join(old)) else name
        elif hasattr(old, "frames"):  # the constraint that is driven
            inner = with_joint_names(old, machine)
            if inner is not old:
                changed[field] = inner
                name = inner.name if name == old.name else name
    if not changed:
        return value
    if name:
        changed["name"] = name
    made: Value = replace(given, **changed)
    return made


# Where a frame is on a robot.


def find_frame(robot: Any, frame: FrameLike) -> tuple[int, Any]:
    """Joint that carries a frame, and the frame's placement on it; see `Robot.frame`."""
    name = frame_text("frame", frame)
    found = [frame for frame in robot.model.frames if frame.name == name]
    if name in WORLD:
        elsewhere = any(f.parentJoint or f.placement != pin.SE3.Identity() for f in found)
        if elsewhere or name in robot.joints:
            raise InvalidModel(
                f"frame {name!r} of {robot.name} has the world's name and is elsewhere; rename it"
            )
        return 0, pin.SE3.Identity()
    if not found and name in robot.joints:  # a model that was built has joints, and no frames
        return int(robot.model.getJointId(name)), pin.SE3.Identity()
    if not found:
        if (placed := _place_on_joint(robot, name)) is None:
            raise unknown_name("frame", name, robot.frames)
        return placed
    first = found[0]
    for other in found[1:]:
        if other.parentJoint != first.parentJoint or other.placement != first.placement:
            raise InvalidModel(
                f"frame {name!r} of {robot.name} exists {len(found)} times in different "
                "places; rename one of them or add your own with Robot.with_frame"
            )
    _check_text(robot, first)
    return int(first.parentJoint), pin.SE3(first.placement)


def _place_on_joint(robot: Any, text: str) -> tuple[int, Any] | None:
    """Joint of a place, and the placement on it; None for a plain name."""
    place = place_of(text)
    if place is None:
        return None
    joint, placement = _carrier(robot, place.base)
    return joint, placement * place.placement


def _check_text(robot: Any, frame: Any) -> None:
    """Raise InvalidModel for a frame with the text of a place that is elsewhere."""
    try:
        placed = _place_on_joint(robot, frame.name)
    except (InvalidArgument, UnknownName):  # of a place that nobody can mean
        return
    if placed and not (placed[0] == frame.parentJoint and placed[1].isApprox(frame.placement)):
        raise InvalidModel(
            f"frame {frame.name!r} of {robot.name} has the text of a place and is elsewhere; "
            "rename it"
        )


def _carrier(robot: Any, base: str) -> tuple[int, Any]:
    """Joint of a place, by its name or number, or else the frame of that name."""
    if base in WORLD:
        return find_frame(robot, base)
    number = number_of(base)
    if number is None:
        if base in robot.joints:
            return int(robot.model.getJointId(base)), pin.SE3.Identity()
        for each in robot.model.frames:  # a joint that was welded
            if each.name == base and each.type == pin.FrameType.FIXED_JOINT:
                return int(each.parentJoint), pin.SE3(each.placement)
        return find_frame(robot, base)
    if base in robot.joints:
        raise InvalidModel(f"joint {base!r} of {robot.name} is named as a number; rename it")
    if number > len(robot.joints):
        raise InvalidArgument(
            f"joint {number}: {robot.name} has joints 1 to {len(robot.joints)}, and the world, 0"
        )
    return number, pin.SE3.Identity()
