"""A parameter, a gain or a step that no method and no run can use."""

import math

import numpy as np

from condyn_pin.constraints.baumgarte import Baumgarte
from condyn_pin.lab.extremes.bad_entries import SIZES
from condyn_pin.lab.extremes.base import Case, Motion, Rng, ajar, closed, extreme, moving
from condyn_pin.model.mechanisms.four_bar import four_bar

_STEPS = (
    1e-3, 1e-9, 1e-30, 1e-100, 0.0, 5e-324, 1e-310, 1e-155, 1.0, 1e16, 1e100, 1e155, 1e300,
    math.inf, math.nan,
)  # fmt: skip


@extreme(*SIZES)
def bad_gain(severity: float, rng: Rng) -> Case:
    """Gains alpha = beta of Baumgarte on a four-bar, from nothing to what is not a number [1/s]."""
    scene = closed(four_bar())
    q, v, tau = moving(scene, rng)
    return Case(scene, ajar(scene, q, rng), v, tau, drift=Baumgarte(severity, severity))


@extreme(*SIZES)
def bad_mu(severity: float, rng: Rng) -> Case:
    """Parameter mu on a four-bar, from nothing to what is not a number [1/kg]."""
    scene = closed(four_bar())
    return Case(scene, *moving(scene, rng), parameters={"mu": severity})


@extreme(*_STEPS)
def bad_step(severity: float, rng: Rng) -> Case:
    """Step of a run of a four-bar, from what is usual to what is not a number [s]."""
    scene = closed(four_bar())
    q, v = scene.state()
    q = ajar(scene, q, rng)
    motion = Motion(severity, steps=10)
    return Case(scene, q, v, np.zeros(len(v)), drift=Baumgarte(1.0, 1.0), motion=motion)
