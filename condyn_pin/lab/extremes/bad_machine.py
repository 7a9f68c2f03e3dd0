"""A mass, or a length, that no machine has."""

import math

import numpy as np

from condyn_pin.lab.extremes.base import Case, Rng, alternating, closed, extreme
from condyn_pin.lab.extremes.parallelogram import cranks_as_one
from condyn_pin.model.mechanisms.n_four_bar import n_four_bar
from condyn_pin.model.robot import Robot

_SIZES = (
    *(1.0, 1e-6, 1e-12, 1e-15, 1e-16, 1e-17, 1e-30, 1e-77, 1e-155, 1e-310, 5e-324, 0.0),
    *(1e12, 1e30, 1e60, 1e77, 1e155, 1e300, math.inf, math.nan),
)


@extreme(*_SIZES)
def bad_mass(severity: float, rng: Rng) -> Case:
    """Mass of every rod of a parallelogram, which moves by its weight alone [kg]."""
    return _falling(n_four_bar(1, mass=severity), 1.0, rng)


@extreme(*_SIZES)
def bad_length(severity: float, rng: Rng) -> Case:
    """Length of every rod of a parallelogram, which moves by its weight alone [m]."""
    return _falling(n_four_bar(1, length=severity), severity, rng)


def _falling(linkage: Robot, length: float, rng: Rng) -> Case:
    theta, rest = rng.uniform(0.5, 2.5), np.zeros(3)
    right = cranks_as_one(1, theta, rest) / length
    return Case(closed(linkage), theta * alternating(3), rest, rest, (right,))
