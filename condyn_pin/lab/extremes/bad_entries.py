"""One number of the configuration, the torque or the velocity that no machine has."""

import math

from condyn_pin._core.arrays import Array
from condyn_pin.dynamics.scene import Scene
from condyn_pin.lab.extremes.base import Case, Rng, extreme, moving

SIZES = (
    0.0, 5e-324, 1e-310, 1e-155, 1e16, 1e30, 1e77, 1e100, 1e155, 1e300, math.inf, math.nan,
)  # fmt: skip


@extreme(*SIZES)
def bad_q(severity: float, rng: Rng, scene: Scene) -> Case:
    """One entry of q, from nothing to what is not a number [SI]."""
    q, v, tau = moving(scene, rng)
    return Case(scene, _spoilt(q, severity, rng), v, tau)


@extreme(*SIZES)
def bad_tau(severity: float, rng: Rng, scene: Scene) -> Case:
    """One entry of tau, from nothing to what is not a number [SI]."""
    q, v, tau = moving(scene, rng)
    return Case(scene, q, v, _spoilt(tau, severity, rng))


@extreme(*SIZES)
def bad_v(severity: float, rng: Rng, scene: Scene) -> Case:
    """One entry of v, from nothing to what is not a number [SI]."""
    q, v, tau = moving(scene, rng)
    return Case(scene, q, _spoilt(v, severity, rng), tau)


def _spoilt(x: Array, severity: float, rng: Rng) -> Array:
    """Return x with one of its entries replaced."""
    x[rng.integers(len(x))] = severity
    return x
