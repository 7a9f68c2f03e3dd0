"""How MuJoCo's rows give way: their impedance, and the acceleration that closes a gap."""

from __future__ import annotations

import numpy as np

from condyn_pin._core.arrays import Array, finite
from condyn_pin.errors import InvalidArgument

SolRef = tuple[float, float]
SolImp = tuple[float, float, float, float, float]

# MuJoCo's own.
DEFAULT_SOLREF: SolRef = (0.02, 1.0)
DEFAULT_SOLIMP: SolImp = (0.9, 0.95, 0.001, 0.5, 2.0)


def impedance(gap: Array, solimp: SolImp) -> Array:
    """Return the impedance d [1] at each `gap` >= 0 [m, rad].

    It rises from d_0 where the gap is zero to d_width where it is `width`, steepest at the share
    `midpoint`, along a polynomial of this power.
    """
    start, end, width, midpoint, power = solimp
    x = np.minimum(gap / width, 1.0)
    below = midpoint * (x / midpoint) ** power
    above = 1 - (1 - midpoint) * ((1 - x) / (1 - midpoint)) ** power
    return np.asarray(start + (end - start) * np.where(x <= midpoint, below, above))


def impedance_slope(gap: Array, solimp: SolImp) -> Array:
    """Return how the impedance changes with each `gap` >= 0 [1/m, 1/rad]."""
    start, end, width, midpoint, power = solimp
    x = np.minimum(gap / width, 1.0)
    below = power * (x / midpoint) ** (power - 1)
    above = power * ((1 - x) / (1 - midpoint)) ** (power - 1)
    rises = np.where(x <= midpoint, below, above) * (x < 1)
    return np.asarray((end - start) / width * rises)


def reference(c: Array, velocity: Array, d: Array, solref: SolRef, solimp: SolImp) -> Array:
    """Return a_ref = -b J v - k c [m/s^2, rad/s^2], with J v the `velocity`, k of the impedance d.

    b = 2 / (d_width timeconst) and k = d / (d_width timeconst dampratio)^2, or of -stiffness and
    -damping: b = damping / d_width and k = d stiffness / d_width^2.
    """
    (one, two), end = solref, solimp[1]
    if one > 0:
        b, k = 2 / (end * one), d / (end * one * two) ** 2
    else:
        b, k = -two / end, -one * d / end**2
    return np.asarray(-b * velocity - k * c)


def reference_by(
    c: Array, velocity: Array, d: Array, solref: SolRef, solimp: SolImp
) -> tuple[float, Array, Array, Array]:
    """Return b, k, k by d, and a_ref by the two numbers of `solref`, (m, 2)."""
    (one, two), end = solref, solimp[1]
    by_solref = np.empty((len(c), 2))
    if one > 0:
        b, k = 2 / (end * one), d / (end * one * two) ** 2
        by_solref[:, 0] = (b * velocity + 2 * k * c) / one
        by_solref[:, 1] = 2 * k * c / two
    else:
        b, k = -two / end, -one * d / end**2
        by_solref[:, 0], by_solref[:, 1] = d * c / end**2, velocity / end
    return b, k, np.asarray(k / d), by_solref


def check_softness(solref: SolRef, solimp: SolImp) -> tuple[SolRef, SolImp]:
    """Return both as tuples of numbers, or refuse them."""
    ref = finite("solref", solref, (2,))
    if not ((ref > 0).all() or (ref < 0).all()):
        raise InvalidArgument(
            f"solref = {solref!r}: (timeconst, dampratio), both > 0, or "
            "(-stiffness, -damping), both < 0"
        )
    start, end, width, midpoint, power = finite("solimp", solimp, (5,)).tolist()
    shares = 0 < start < 1 and 0 < end < 1 and 0 < midpoint < 1
    if not (shares and width > 0 and power >= 1):
        raise InvalidArgument(
            f"solimp = {solimp!r}: (d_0, d_width, width, midpoint, power) with d_0, "
            "d_width and midpoint between 0 and 1, width > 0 and power >= 1"
        )
    one, two = ref.tolist()
    return (one, two), (start, end, width, midpoint, power)
