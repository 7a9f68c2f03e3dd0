"""Iterations of implicit steps: to the last digit, or an error that says what would do."""

from __future__ import annotations

from collections.abc import Callable
from math import isfinite

from condyn_pin.errors import SolveFailed, StepFailed

# What is left, in metres and radians, with which an iteration may end once it stops to shrink.
_SMALL = 1e-11

# Nothing below can be told from rounding.
_ROUNDING = 1e-16

_MOST = 60


def to_the_end(iteration: Callable[[], float], title: str, t: float, dt: float) -> None:
    """Iterate until what is left no longer halves.

    Parameters
    ----------
    iteration : callable
        Improves on what it has, and returns what was left before [m, rad].
    title, t, dt : str, float, float
        What is iterated, and where, for the error [s].

    Raises
    ------
    StepFailed
        If the iteration stops to converge too early.
    """
    size = float("inf")
    count = 0
    while count < _MOST:
        count += 1
        try:
            left = iteration()
        except SolveFailed:  # it has led to a state that no machine can have
            left = float("nan")
        if left <= _ROUNDING or (size < _SMALL and not left < size / 2):
            return
        size = left
        if not isfinite(size):
            break
    left_over = f"{size:.1e} are left (m, rad)" if isfinite(size) else "its numbers are lost"
    raise StepFailed(
        f"{title} at t = {t:g} s: after {count} iterations {left_over}; take a smaller dt than "
        f"{dt:g} s"
    )
