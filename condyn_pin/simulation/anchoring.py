"""Contacts get a place: where they are when a simulation starts.

A contact without an anchor holds what it touches wherever that is. In a simulation it would creep
with every rounding error, for nothing says where it was.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from condyn_pin._pin import pin
from condyn_pin.arrays import Array
from condyn_pin.constraints import Constraint
from condyn_pin.contacts import LineContact, PlanarContact, PointContact, SurfaceContact
from condyn_pin.rows.bound import Bound, Coupled
from condyn_pin.rows.equations import Equations
from condyn_pin.scene import Scene


def anchored(scene: Scene, q: Array) -> Scene:
    """Return the scene with every contact anchored: those without an anchor where they are at q."""
    if all(bound.anchored for bound in scene.bounds):
        return scene
    places = Equations(scene.robot.model, scene.bounds).placements(q)
    pairs = zip(scene.constraints, scene.bounds, places, strict=True)
    return replace(
        scene,
        constraints=tuple(
            constraint if bound.anchored else _anchor(constraint, bound, place)
            for constraint, bound, place in pairs
        ),
    )


def _anchor(
    constraint: Constraint, bound: Bound | Coupled, place: tuple[Any, Any] | None
) -> Constraint:
    """Return a contact anchored at the frames (c1, c2) of its bound form."""
    assert place is not None, f"{bound.name}: only contacts lack an anchor"
    one, two = place
    if isinstance(constraint, PointContact):
        return replace(constraint, anchor=tuple(one.translation.tolist()))
    if isinstance(constraint, SurfaceContact | LineContact):
        return replace(constraint, anchor=tuple(pin.SE3ToXYZQUAT(one).tolist()))
    assert isinstance(constraint, PlanarContact)
    height = float(np.dot(constraint.normal, two.translation))
    return replace(constraint, height=height)
