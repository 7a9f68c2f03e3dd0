"""Patches: the meshes of the shapes that contacts are drawn with."""

from __future__ import annotations

import numpy as np

from condyn_pin.constraints.base import Patch
from condyn_pin.io import meshes
from condyn_pin.viewing.part import span


def patch_mesh(patch: Patch) -> meshes.Mesh:
    """Return a shape about the origin."""
    if patch.shape == "box":
        return meshes.box(*patch.size)
    if patch.shape == "rod":
        return meshes.cylinder(*patch.size).moved(span(np.zeros(3), np.array(patch.along)))
    if patch.shape == "capsule":
        return meshes.centred_capsule(*patch.size)
    return meshes.sphere(*patch.size)
