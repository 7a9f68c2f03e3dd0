"""Contacts that open, stick and slide as plain arrays, and what of them the compiled core has not.

The places of the fields are those that ``native/src/core/contacts.cpp`` reads.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from condyn_pin.constraints.rows.compiled_rows import placement
from condyn_pin.dynamics.compiled.arrays import JOINTS

if TYPE_CHECKING:
    from condyn_pin.dynamics.scene import Scene


def untaken_contacts(scene: Scene) -> Iterator[str]:
    """Yield what the core does not take of the contacts of a scene, in words."""
    for bound in scene.contact_bounds:
        if bound.pairs:
            yield f"contact {bound.name!r}: it has points over planes, and no shapes on each other"
    for name, joint in zip(scene.robot.model.names, scene.robot.model.joints, strict=True):
        if joint.id and joint.shortname() not in JOINTS:
            yield f"joint {name!r} is a {joint.shortname()}, which it was not compiled for"


def of_contacts(scene: Scene, rank: int) -> dict[str, Any]:
    """Return the contacts of a scene; `rank` is that of its constraints."""
    bounds = scene.contact_bounds
    touches = [touch for bound in bounds for touch in bound.touches]
    stops = [stop for bound in bounds for stop in bound.stops]
    dry = [each for bound in bounds for each in bound.dry]
    of_touches = [[*t.centre, t.radius, t.friction, *placement(t.plane)] for t in touches]
    return {
        "touches": np.array([[t.joint, t.ground] for t in touches], np.int32).reshape(-1, 2),
        "of_touches": np.array(of_touches, float).reshape(-1, 17),
        "stops": np.array([[s.iq, s.iv] for s in stops], np.int32).reshape(-1, 2),
        "of_stops": np.array([[s.sign, s.limit] for s in stops], float).reshape(-1, 2),
        "dry": np.array([each.iv for each in dry], np.int32),
        "of_dry": np.array([each.limit for each in dry], float),
        "rank": rank,
    }
