"""A mass, or a length, that no machine has."""

from __future__ import annotations

import math

import numpy as np

from condyn_pin.dynamics.scene import Scene
from condyn_pin.lab.extremes.base import Case, extreme
from condyn_pin.lab.extremes.parallelogram import cranks_as_one
from condyn_pin.model.mechanisms.n_four_bar import n_four_bar
from condyn_pin.model.robot import Robot

_SIZES = (
    *(1.0, 1e-6, 1e-12, 1e-15, 1e-16, 1e-17, 1e-30, 1e-77, 1e-155, 1e-310, 5e-324, 0.0),
    *(1e12, 1e30, 1e60, 1e77, 1e155, 1e300, math.inf, math.nan),
)


@extreme(severities=_SIZES)
def bad_mass(severity: float, rng: np.random.Generator) -> Case:
    """Mass of every rod of a parallelogram, which moves by its weight alone [kg]."""
    return _falling(n_four_bar(1, mass=severity), 1.0, rng)


@extreme(severities=_SIZES)
def bad_length(severity: float, rng: np.random.Generator) -> Case:
    """Length of every rod of a parallelogram, which moves by its weight alone [m]."""
    return _falling(n_four_bar(1, length=severity), severity, rng)


def _falling(linkage: Robot, length: float, rng: np.random.Generator) -> Case:
    theta, rest = rng.uniform(0.5, 2.5), np.zeros(3)
    q = theta * np.array([1.0, -1.0, 1.0])
    right = cranks_as_one(1, theta, rest) / length
    return Case(Scene(linkage, linkage.loops), q, rest, rest, (right,))
