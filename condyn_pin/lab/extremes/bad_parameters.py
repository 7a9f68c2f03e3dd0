"""A parameter, a gain or a step that no method and no run can use."""

from __future__ import annotations

import math

import numpy as np

from condyn_pin.constraints.baumgarte import Baumgarte
from condyn_pin.dynamics.scene import Scene
from condyn_pin.lab.extremes.base import Case, Motion, ajar, extreme, moving
from condyn_pin.model.mechanisms.four_bar import four_bar

_SIZES = (
    0.0, 5e-324, 1e-310, 1e-155, 1e16, 1e30, 1e77, 1e100, 1e155, 1e300, math.inf, math.nan,
)  # fmt: skip

_STEPS = (
    1e-3, 1e-9, 1e-30, 1e-100, 0.0, 5e-324, 1e-310, 1e-155, 1.0, 1e16, 1e100, 1e155, 1e300,
    math.inf, math.nan,
)  # fmt: skip


@extreme(severities=_SIZES)
def bad_gain(severity: float, rng: np.random.Generator) -> Case:
    """Gains alpha = beta of Baumgarte on a four-bar, from nothing to what is not a number [1/s]."""
    scene = _linkage()
    q, v, tau = moving(scene, rng)
    q = ajar(scene, q, rng)
    return Case(scene, q, v, tau, drift=Baumgarte(severity, severity))


@extreme(severities=_SIZES)
def bad_mu(severity: float, rng: np.random.Generator) -> Case:
    """Parameter mu on a four-bar, from nothing to what is not a number [1/kg]."""
    scene = _linkage()
    return Case(scene, *moving(scene, rng), parameters={"mu": severity})


@extreme(severities=_STEPS)
def bad_step(severity: float, rng: np.random.Generator) -> Case:
    """Step of a run of a four-bar, from what is usual to what is not a number [s]."""
    scene = _linkage()
    q, v = scene.state()
    q = ajar(scene, q, rng)
    motion = Motion(severity, steps=10)
    return Case(scene, q, v, np.zeros(len(v)), drift=Baumgarte(1.0, 1.0), motion=motion)


def _linkage() -> Scene:
    linkage = four_bar()
    return Scene(linkage, linkage.loops)
