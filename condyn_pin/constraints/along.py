"""What a path is at a time, and whether its rates are those of its values."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from condyn_pin._core.arguments import counted
from condyn_pin._core.arrays import Array, shown
from condyn_pin.constraints.path import Along
from condyn_pin.errors import InvalidArgument

# Where the derivatives of a path are compared with its differences [s], and what may be between.
_NEAR: Final = 1e-4
_OFF: Final = 0.05


def along_at(along: Along, t: float, rows: int, name: str) -> Array:
    """Return s, s' and s'' (3, rows) of a path, or say what is wrong with it."""
    value = along(t)
    try:
        found = np.array([np.atleast_1d(np.asarray(each, dtype=float)) for each in value])
    except (TypeError, ValueError):
        found = np.zeros(0)
    if found.shape != (3, rows):
        raise InvalidArgument(
            f"{name}: along({t:g}) = {shown(value)}: three arrays are needed, s, its rate and the "
            f"rate of that, {counted(rows, 'number')} each"
        )
    if not np.isfinite(found).all():
        raise InvalidArgument(f"{name}: along({t:g}) = {shown(value)} is not finite")
    return found


def check_along(along: Along, rows: int, name: str, at: Sequence[float] = (0.0,)) -> None:
    """Refuse what is no path: a wrong size, or rates that its own differences contradict.

    It is checked at some times [s], twice at each, because a path may have a kink.
    """
    if not callable(along):
        raise InvalidArgument(
            f"along = {shown(along)}: a Path is needed, or a function of t that returns s and its "
            "first two derivatives"
        )
    for t in at:
        faults = [_fault(along, rows, name, t + k * _NEAR) for k in (0, 4)]
        if all(faults):
            raise InvalidArgument(f"{name}: of along(t) the {faults[0]}")


def _fault(along: Along, rows: int, name: str, t: float) -> str:
    """Return what differences say against the rates of a path; empty if nothing."""
    before, here, after = (along_at(along, t + k * _NEAR, rows, name) for k in (0, 1, 2))
    size = np.abs([before, here, after]).max(axis=(0, 2))
    for i, what in ((0, "second value is not the rate of the first"),
                    (1, "third value is not the rate of the second")):  # fmt: skip
        rate = (after[i] - before[i]) / (2 * _NEAR)
        # what rounding leaves of a difference, and the bend within it
        least = 1e-12 * size[i] / _NEAR + 1e-6 * size[i + 1] + _NEAR * size[2]
        if (np.abs(rate - here[i + 1]) > _OFF * np.abs(rate) + least).any():
            return (
                f"{what}: {shown(here[i + 1])} at t = {t + _NEAR:g} s, where differences have "
                f"{shown(rate)}"
            )
    return ""
