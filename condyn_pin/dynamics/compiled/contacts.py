"""Contacts that open, stick and slide as plain arrays, and what of them the compiled core has not.

The places of the fields are those that ``native/src/core/contact_arrays.cpp`` reads.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core.arguments import listed
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.contacts.candidates import pieces_of
from condyn_pin.constraints.contacts.shapes import Core
from condyn_pin.constraints.rows.bound import placement
from condyn_pin.dynamics.compiled.arrays import JOINTS

if TYPE_CHECKING:
    from condyn_pin.dynamics.scene import Scene


def untaken_contacts(scene: Scene) -> Iterator[str]:
    """Yield what the core does not take of the contacts of a scene, in words."""
    for name, joint in zip(scene.robot.model.names, scene.robot.model.joints, strict=True):
        if joint.id and joint.shortname() not in JOINTS:
            yield f"joint {name!r} is a {joint.shortname()}, which it was not compiled for"
    pairs = [pair for bound in scene.contact_bounds for pair in bound.pairs]
    at_seams = [pair.name for pair, pieces in zip(pairs, pieces_of(pairs), strict=True) if pieces]
    if at_seams:
        yield f"{listed(at_seams)}: pieces of one body side by side, whose seams it would meet"


def of_contacts(scene: Scene, rank: int) -> dict[str, Any]:
    """Return the contacts of a scene; `rank` is that of its constraints."""
    bounds = scene.contact_bounds
    touches = [touch for bound in bounds for touch in bound.touches]
    pairs = [pair for bound in bounds for pair in bound.pairs]
    stops = [stop for bound in bounds for stop in bound.stops]
    dry = [each for bound in bounds for each in bound.dry]
    of_touches = [[*t.centre, t.radius, t.friction, *placement(t.plane)] for t in touches]
    of_pairs = [
        [*placement(p.placement), *placement(p.ground_placement), p.friction] for p in pairs
    ]
    shapes = [core for p in pairs for core in (p.shape, p.ground_shape)]
    return {
        "touches": np.array([[t.joint, t.ground] for t in touches], np.int32).reshape(-1, 2),
        "of_touches": np.array(of_touches, float).reshape(-1, 17),
        "pairs": np.array([[p.joint, p.ground] for p in pairs], np.int32).reshape(-1, 2),
        "of_pairs": np.array(of_pairs, float).reshape(-1, 25),
        "shapes": [_integers(core) for core in shapes],
        "of_shapes": [_numbers(core) for core in shapes],
        "stops": np.array([[s.iq, s.iv] for s in stops], np.int32).reshape(-1, 2),
        "of_stops": np.array([[s.sign, s.limit] for s in stops], float).reshape(-1, 2),
        "dry": np.array([each.iv for each in dry], np.int32),
        "of_dry": np.array([each.limit for each in dry], float),
        "rank": rank,
    }


def _integers(core: Core) -> NDArray[np.int32]:
    """Return the numbers of what a shape has, its edges, and its faces by their vertices."""
    counts = (len(core.vertices), len(core.edges), len(core.normals), len(core.directions))
    loops = [number for loop in core.loops for number in (len(loop), *loop)]
    return np.array([*counts, *core.edges.ravel(), *loops], np.int32)


def _numbers(core: Core) -> Array:
    """Return radius, size and reach of a shape, and where all that it has is."""
    parts = core.vertices, core.normals, core.heights, core.directions
    return np.concatenate([(core.radius, core.size, core.reach), *map(np.ravel, parts)])
