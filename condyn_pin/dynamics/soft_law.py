"""MuJoCo's law of constraints that give way: solref and solimp.

    R = (1 - d) / d * diag(G),    a_ref = -b J v - k c

with d the impedance at the gap c, and b and k those of a spring and a damper.

References
----------
MuJoCo documentation: Computation, "Constraint model"; Modeling, "Solver parameters".
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from condyn_pin._core.arrays import Array, finite
from condyn_pin.errors import InvalidArgument

Solref = tuple[float, float]  # [s, 1], or [1/s^2, 1/s]
Solimp = tuple[float, float, float, float, float]


def checked_law(solref: Sequence[float], solimp: Sequence[float]) -> tuple[Solref, Solimp]:
    """Return both as tuples of floats, which a frozen value hashes; refuse what is no law."""
    ref = finite("solref", solref, (2,))
    if not ((ref > 0).all() or (ref < 0).all()):
        raise InvalidArgument(
            f"solref = {solref!r}: (timeconst, dampratio), both > 0, or "
            "(-stiffness, -damping), both < 0"
        )
    start, end, width, midpoint, power = finite("solimp", solimp, (5,))
    shares = 0 < start < 1 and 0 < end < 1 and 0 < midpoint < 1
    if not (shares and width > 0 and power >= 1):
        raise InvalidArgument(
            f"solimp = {solimp!r}: (d_0, d_width, width, midpoint, power) with d_0, "
            "d_width and midpoint between 0 and 1, width > 0 and power >= 1"
        )
    return tuple(map(float, solref)), tuple(map(float, solimp))  # type: ignore[return-value]


def impedance(solimp: Solimp, gap: Array) -> Array:
    """Return the impedance d at each `gap` >= 0 (m,) [m, rad]."""
    start, end, width, midpoint, power = solimp
    x = np.minimum(gap / width, 1.0)
    below = midpoint * (x / midpoint) ** power
    above = 1 - (1 - midpoint) * ((1 - x) / (1 - midpoint)) ** power
    return np.asarray(start + (end - start) * np.where(x <= midpoint, below, above))


def reference(solref: Solref, solimp: Solimp, c: Array, velocity: Array, d: Array) -> Array:
    """Return a_ref = -b J v - k c, with J v the `velocity` and k of the impedance d."""
    (one, two), end = solref, solimp[1]
    if one > 0:
        b, k = 2 / (end * one), d / (end * one * two) ** 2
    else:
        b, k = -two / end, -one * d / end**2
    return np.asarray(-b * velocity - k * c)
