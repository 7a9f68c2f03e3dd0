"""Contacts: the points, edges and patches on which a robot stands, and how far they have left."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.constraints.base import Patch
from condyn_pin.dynamics.scene import Scene
from condyn_pin.viewing import meshes
from condyn_pin.viewing.closures import gap_part
from condyn_pin.viewing.moment import Moment
from condyn_pin.viewing.palette import CONTACT
from condyn_pin.viewing.part import Part, Pose, at_point, span


def contact_parts(scene: Scene, size: float) -> Iterator[Part]:
    """Return the patch of every contact, and the segment from it to its anchor."""
    for constraint, bound in zip(scene.constraints, scene.bounds, strict=True):
        patch = constraint.patch(size)
        if patch is None:
            continue
        name = constraint.name
        shape = ((_mesh(patch), CONTACT),)
        pose = _pose(name, turns=patch.turns)
        yield Part(f"contacts/{name}/patch", pose, shape, opacity=0.8, on_top=True)
        if bound.meets:
            yield gap_part(f"contacts/{name}/gap", name, size)


def _mesh(patch: Patch) -> meshes.Mesh:
    if patch.shape == "box":
        return meshes.box(*patch.size)
    if patch.shape == "rod":
        return meshes.cylinder(*patch.size).moved(span(np.zeros(3), np.array(patch.along)))
    return meshes.sphere(*patch.size)


def _pose(name: str, *, turns: bool) -> Pose:
    def pose(at: Moment) -> Array | None:
        end = at.robot_end(name)
        if end is None:
            return None
        return np.asarray(end.homogeneous) if turns else at_point(end.translation)

    return pose
