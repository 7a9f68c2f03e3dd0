"""Contacts get a place: where they are when a simulation starts.

A contact without an anchor holds what it touches wherever that is. In a simulation it would creep
with every rounding error, for nothing says where it was.
"""

from __future__ import annotations

from collections.abc import MutableMapping
from dataclasses import replace
from typing import Any

from condyn_pin._core.arrays import Array
from condyn_pin.constraints.base import Constraint
from condyn_pin.dynamics.scene import Scene
from condyn_pin.simulation.measures import gauge_of


def anchored(
    scene: Scene, q: Array, places: MutableMapping[Constraint, Constraint] | None = None
) -> Scene:
    """Return the scene with every contact anchored: those without an anchor where they are at q.

    Parameters
    ----------
    scene : Scene
    q : (nq,) array
    places : mapping of constraint to constraint, optional
        Contacts that have their place already; new ones are added.
    """
    if all(bound.anchored for bound in scene.bounds):
        return scene
    places = {} if places is None else places
    frames: list[Any] = gauge_of(scene).equations.placements(q)
    pairs = zip(scene.constraints, scene.bounds, frames, strict=True)
    for constraint, bound, frame in pairs:
        if constraint not in places:
            places[constraint] = constraint if bound.anchored else constraint.anchored_at(*frame)
    placed = replace(scene, constraints=tuple(places[c] for c in scene.constraints))
    # J, and all that was measured with it, is the same where the contacts touch
    vars(placed)["nominal"] = scene.nominal
    return placed
