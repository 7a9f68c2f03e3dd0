"""Motors that act on several joints at once: differentials, belts, cables.

tau_i = w_i u,    speed of the motor = sum w_i v_i
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf
from typing import Any

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import text_of
from condyn_pin.constraints.constraint import floats, text
from condyn_pin.errors import InvalidArgument
from condyn_pin.model.joints import joint_of


@dataclass(frozen=True)
class CoupledMotor:
    """A motor that acts on several joints: through a differential, a belt, or a cable.

    tau_i = w_i u,    its speed is sum w_i v_i

    ``CoupledMotor("left", {"yaw": 1.0, "pitch": 1.0})`` and ``CoupledMotor("right", {"yaw": 1.0,
    "pitch": -1.0})`` are the motors of a differential.

    Parameters
    ----------
    name : str
        Name of the motor, which no joint of the robot has.
    joints : mapping of str to float
        Weight w_i of each joint, all with one degree of freedom: turns of the motor for a turn of
        the joint [1], and of a cable its lever arm [m].
    limits : (float, float)
        Least and largest u [N m, N]; ``(0.0, 80.0)`` of a cable that only pulls. None by default.

    Raises
    ------
    InvalidArgument
        If there is no joint, a weight is zero, or the least u is not below the largest.
    """

    name: str
    joints: Mapping[str, float]
    limits: Sequence[float] = (-inf, inf)  # [N m, N]

    def __post_init__(self) -> None:
        text("name", self.name, "motor")
        object.__setattr__(self, "joints", _weights(self.joints))
        object.__setattr__(self, "limits", _limits(self.limits))

    @property
    def weights(self) -> dict[str, float]:
        """Weight w_i of each joint."""
        return dict(self.joints)


def check_coupled(model: Any, motors: Sequence[CoupledMotor]) -> None:
    """Raise UnknownName or InvalidArgument unless motors have joints, and names of their own."""
    names = [motor.name for motor in motors]
    for motor in motors:
        if names.count(motor.name) > 1:
            raise InvalidArgument(f"motors: two are named {motor.name!r}; rename one of them")
        if motor.name in model.names:
            raise InvalidArgument(f"motor {motor.name!r}: a joint has this name; rename the motor")
        for joint in motor.weights:
            if (nv := joint_of(model, joint).nv) != 1:
                raise InvalidArgument(
                    f"motor {motor.name!r}: joint {joint!r} has {nv} degrees of freedom; joints "
                    "with one are needed"
                )


def _weights(given: Any) -> tuple[tuple[str, float], ...]:
    """Pairs of joints and their weights."""
    try:
        pairs = [*(given.items() if isinstance(given, Mapping) else given)]
        found = {text("joints", name, "joint"): weight for name, weight in pairs}
    except (TypeError, ValueError) as error:
        raise InvalidArgument(f"joints = {text_of(given)}: a weight by joint is needed") from error
    if not found:
        raise InvalidArgument(f"joints = {text_of(given)}: one joint at least is needed")
    if len(found) < len(pairs):
        raise InvalidArgument(f"joints = {text_of(given)}: a joint is named twice; name it once")
    for name, weight in zip(found, floats("joints", [*found.values()], len(found)), strict=True):
        if abs(weight) < 1.0 / tolerances.HUGE:
            raise InvalidArgument(f"joints: the weight of {name!r} is {weight:g}; leave it out")
        found[name] = weight
    return tuple(found.items())


def _limits(given: Any) -> tuple[float, float]:
    """Least and largest torque, the least below the largest; infinite for none."""
    try:
        least, largest = (float(x) for x in given if not isinstance(x, str | bool))
    except (TypeError, ValueError, OverflowError) as error:
        raise InvalidArgument(
            f"limits = {text_of(given)}: the least and the largest torque are needed"
        ) from error
    if not least < largest:
        raise InvalidArgument(f"limits = {text_of(given)}: the least has to be below the largest")
    return least, largest
