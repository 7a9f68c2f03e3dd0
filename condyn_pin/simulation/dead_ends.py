"""Dead ends: paths of driven rows that lead into what nothing moves."""

from __future__ import annotations

from condyn_pin.errors import StepFailed


def pressed_in(contacts: str, t: float, depth: float = 0.0) -> StepFailed:
    """Return the error of contacts that driven rows press into each other at t, a `depth` [m]."""
    by = f"{depth:.2g} m or rad " if depth else ""
    return StepFailed(
        f"{contacts} at t = {t:g} s: driven rows move it {by}into what it touches, and nothing "
        "gives way; end the path before"
    )
