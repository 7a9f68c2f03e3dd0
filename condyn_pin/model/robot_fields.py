"""What the fields of a Robot have to be."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final

from numpy.typing import ArrayLike

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import normalised
from condyn_pin._core.arrays import Array, finite
from condyn_pin.constraints.base import Constraint
from condyn_pin.constraints.kinds import of_loops
from condyn_pin.errors import InvalidArgument, InvalidModel
from condyn_pin.model.robot_joints import joint_of
from condyn_pin.model.soundness import check_model
from condyn_pin.model.spring import Spring, SpringDamper

if TYPE_CHECKING:
    from condyn_pin.model.robot import Robot

# The fields that are lists, and what is in them, but for loops: of these kinds may be more.
_MEMBERS: Final[Mapping[str, tuple[type, ...]]] = {
    "contacts": (Constraint,),
    "actuated": (str,),
    "springs": (Spring,),
    "spring_dampers": (SpringDamper,),
    "unused": (str,),
    "unmodelled": (str,),
    "package_dirs": (str,),
}


def lists() -> Mapping[str, tuple[type, ...]]:
    """Return the fields that are lists, and what is in them."""
    return {"loops": of_loops(), **_MEMBERS}


def members(argument: str, value: Any, kinds: tuple[type, ...]) -> tuple[Any, ...]:
    """Return a list of things of some kinds as a tuple, or raise InvalidArgument."""
    wanted = " or ".join(kind.__name__ for kind in kinds)
    if isinstance(value, (str, Mapping)) or not isinstance(value, Iterable):
        raise InvalidArgument(f"{argument} = {value!r}: a list of {wanted} is needed")
    found = tuple(value)
    for member in found:
        if not isinstance(member, kinds):
            raise InvalidArgument(f"{argument}: {member!r} is not a {wanted}")
    return found


def check_origin(name: Any, model: Any) -> None:
    """Raise InvalidArgument or InvalidModel unless a name is a text, and a model is sound."""
    if not isinstance(model, pin.Model):
        raise InvalidArgument(
            f"model = {type(model).__name__}: a pinocchio.Model is needed; "
            "load_robot reads one from a file"
        )
    if not isinstance(name, str):
        raise InvalidArgument(f"name = {name!r}: a text is needed")
    check_model(model)


def check_precision(precision: Any) -> None:
    """Raise InvalidArgument unless a precision is a number that leaves rows to count."""
    if not 0.0 <= finite("precision", precision, ()) <= tolerances.LEAST_PRECISE:
        raise InvalidArgument(
            f"precision = {precision!r}: a number from 0 to {tolerances.LEAST_PRECISE:g} is "
            "needed, 1e-5 for a file with five digits"
        )


def check_joints(robot: Robot) -> None:
    """Raise UnknownName, InvalidArgument or InvalidModel unless motors and springs have joints."""
    for joint in robot.actuated:
        joint_of(robot.model, joint)
        if robot.actuated.count(joint) > 1:
            raise InvalidArgument(f"actuated: {joint!r} is named twice; name it once")
    for spring in robot.springs:
        if joint_of(robot.model, spring.joint).nq != 1:
            raise InvalidModel(
                f"spring on {spring.joint!r}: a joint with one degree of freedom is needed"
            )


def check_ends(robot: Robot) -> None:
    """Raise UnknownName or InvalidModel unless spring-dampers are between frames of two bodies."""
    for each in robot.spring_dampers:
        if robot.frame(each.frame_a)[0] == robot.frame(each.frame_b)[0]:
            raise InvalidModel(
                f"spring-damper between {each.frame_a!r} and {each.frame_b!r}: both are on one "
                "body, where it does nothing; frames of two bodies are needed"
            )


def postures(model: Any, value: Any) -> Mapping[str, Array]:
    """Return configurations by name, normalised and not to be written, or raise InvalidArgument."""
    if not isinstance(value, Mapping):
        raise InvalidArgument(f"postures = {value!r}: a mapping of names is needed")
    return MappingProxyType({name: _posture(model, name, q) for name, q in value.items()})


def _posture(model: Any, name: str, q: ArrayLike) -> Array:
    if not isinstance(name, str):
        raise InvalidArgument(f"postures: {name!r} is not the name of a posture")
    array = normalised(model, f"posture {name!r}", q)
    array.flags.writeable = False
    return array
