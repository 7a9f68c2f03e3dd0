"""What the fields of a constraint have to be."""

from __future__ import annotations

import math
from collections.abc import Sequence
from numbers import Real
from typing import Any, Literal, get_args

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import finite, shown
from condyn_pin._core.joints import rotation_fault
from condyn_pin.errors import InvalidArgument

Axis = Literal["x", "y", "z"]
Vector3 = tuple[float, float, float]
Placement = tuple[float, float, float, float, float, float, float]


def floats(argument: str, value: Any, size: int) -> tuple[float, ...]:
    """Return a sequence of numbers as a tuple, or raise InvalidArgument."""
    try:
        array = finite(argument, value, size)
    except InvalidArgument as error:
        raise InvalidArgument(
            f"{argument} = {shown(value)}: {size} finite numbers are needed"
        ) from error
    check_size(argument, *array)
    return tuple(float(x) for x in array)


def not_negative(argument: str, value: Any) -> float:
    """Return a number that is not negative, or raise InvalidArgument."""
    number = float(finite(argument, value, ()))
    if number < 0:
        raise InvalidArgument(f"{argument} = {shown(value)}: a number >= 0 is needed")
    check_size(argument, number)
    return number


def check_size(argument: str, *numbers: float) -> None:
    """Refuse numbers so large that what is computed from them overflows."""
    for number in numbers:
        if abs(number) > tolerances.HUGE:
            raise InvalidArgument(
                f"{argument} = {number:g}: no machine has that; {tolerances.HUGE:g} is the largest "
                "number"
            )


def direction(argument: str, value: Any) -> tuple[float, ...]:
    """Return three numbers as a vector of unit length, or raise InvalidArgument."""
    return unit(floats(argument, value, 3), f"{argument} = (0, 0, 0): a direction is needed")


def unit(vector: Sequence[float], fault: str) -> tuple[float, ...]:
    """Return a vector at unit length; InvalidArgument says the fault of one that is zero."""
    exponent = math.frexp(max(map(abs, vector)))[1]
    scaled = [math.ldexp(x, -exponent) for x in vector]  # exact, and no longer subnormal
    norm = math.hypot(*scaled)
    if norm == 0.0:
        raise InvalidArgument(fault)
    return tuple(x / norm for x in scaled)


def text(argument: str, value: Any, what: str = "frame") -> str:
    """Return the name of something, or raise InvalidArgument."""
    if not isinstance(value, str) or not value:
        raise InvalidArgument(f"{argument} = {shown(value)}: the name of a {what} is needed")
    return value


def check_positive(kind: str = "number", /, **values: float) -> None:
    """Refuse values, by name, that are not positive."""
    for name, value in values.items():
        try:
            number = isinstance(value, Real) and not isinstance(value, bool)
            size = float(value) if number else 0.0
        except OverflowError:  # a whole number beyond a double
            size = math.inf
        if not 0.0 < size < math.inf:
            raise InvalidArgument(f"{name} = {shown(value)}: a positive {kind} is needed")
        check_size(name, size)


def check_lengths(**lengths: float | None) -> None:
    """Refuse lengths, by name, that are not positive; None is left out."""
    said = {name: length for name, length in lengths.items() if length is not None}
    check_positive("length [m]", **said)


def check_axis(axis: Any) -> None:
    """Refuse what is not the name of an axis."""
    if axis not in get_args(Axis):
        raise InvalidArgument(f"axis = {shown(axis)}: one of {', '.join(get_args(Axis))} is needed")


def placement(argument: str, value: object) -> Placement | None:
    """Return a placement in the world with a unit quaternion, or raise InvalidArgument."""
    if value is None:
        return None
    if isinstance(value, pin.SE3):
        fault = rotation_fault(value.rotation)
        if fault and np.isfinite(value.rotation).all():
            raise InvalidArgument(f"{argument}: it has no valid rotation: {fault}")
    x, y, z, *quaternion = floats(
        argument, pin.SE3ToXYZQUAT(value) if isinstance(value, pin.SE3) else value, 7
    )
    fault = f"{argument}: its quaternion (x y z w) is zero; use 0 0 0 1"
    qx, qy, qz, qw = unit(quaternion, fault)
    return x, y, z, qx, qy, qz, qw
