"""Iterations of implicit steps: to the last digit, or an error that says what would do."""

from __future__ import annotations

from collections.abc import Callable

from condyn_pin.errors import StepFailed

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
    for _ in range(_MOST):
        left = iteration()
        if left <= _ROUNDING or (size < _SMALL and not left < size / 2):
            return
        size = left
    raise StepFailed(
        f"{title} at t = {t:g} s: after {_MOST} iterations {size:.1e} are left (m, rad); take a "
        f"smaller dt than {dt:g} s"
    )
