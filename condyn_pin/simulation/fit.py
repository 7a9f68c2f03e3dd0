"""Whether a state fits a scene well enough to go on from."""

from __future__ import annotations

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array
from condyn_pin.dynamics.at_state import gaps, slips
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import NotAssembled
from condyn_pin.mechanism.check import Check
from condyn_pin.simulation.measures import gauge_of


def check_fit(scene: Scene, q: Array, v: Array, *, what: str = "") -> None:
    """Raise NotAssembled if a loop or an anchored contact is open, or slips.

    Parameters
    ----------
    scene : Scene
    q, v : (nq,), (nv,) array
    what : str
        What the text begins with.
    """
    _raise(scene, gauge_of(scene).equations.violation(q), q, v, what)


def check_slip(scene: Scene, q: Array, v: Array, *, what: str = "") -> None:
    """Raise NotAssembled if constraints slip with v, however open they are at q."""
    _raise(scene, np.zeros(scene.rows), q, v, what)


def _raise(scene: Scene, c: Array, q: Array, v: Array, what: str) -> None:
    velocity = gauge_of(scene).equations.jacobian(q) @ v
    speed = max(1.0, float(np.abs(v).max(initial=0.0)))
    fit = Check(gaps(scene, c), slips(scene, velocity), speed, {})
    limit = tolerances.NEARLY_CLOSED
    try:
        fit.raise_if_open(violation=limit, constraint_velocity=limit)
    except NotAssembled as error:
        raise NotAssembled(f"{what}{error}") from None
