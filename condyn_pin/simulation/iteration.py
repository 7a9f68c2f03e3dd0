"""Iterations of implicit steps: to the last digit, or an error that says what would do."""

from __future__ import annotations

from collections.abc import Callable
from math import isfinite

from condyn_pin.errors import InvalidArgument, SolveFailed, StepFailed

# What is left with which an iteration may end once it stops to shrink, and below which nothing can
# be told from rounding: as shares of the numbers that a configuration is made of.
_SMALL = 1e-11
_ROUNDING = 1e-15

_MOST = 60


def fixed_point_iteration(
    iteration: Callable[[], float], title: str, t: float, dt: float, size: float
) -> None:
    """Iterate until what is left no longer halves in two iterations: some take turns.

    Parameters
    ----------
    iteration : callable
        Improves on what it has, and returns what was left before [m, rad].
    title, t, dt : str, float, float
        What is iterated, and where, for the error [s].
    size : float
        Of the numbers that are iterated on [m, rad]; see `System.size`.

    Raises
    ------
    StepFailed
        If the iteration stops to converge too early.
    """
    small, rounding = _SMALL * size, _ROUNDING * size
    two_before = before = float("inf")
    count, why = 0, ""
    while count < _MOST:
        count += 1
        try:
            left = iteration()
        except SolveFailed:  # it has led to a state that no machine can have
            left = float("nan")
        except InvalidArgument as error:  # such as one that is not finite
            left, why = float("nan"), f" ({error})"
        if left <= rounding or (before < small and not left < two_before / 2):
            return
        two_before, before = before, left
        if not isfinite(left):
            break
    else:
        if before < small:
            return
    left_over = (
        f"{before:.1e} are left (m, rad)" if isfinite(before) else f"its numbers are lost{why}"
    )
    raise StepFailed(
        f"{title} at t = {t:g} s: after {count} iterations {left_over}; take a smaller dt than "
        f"{dt:g} s"
    )
