"""Mesh files: the triangles of STL, DAE, OBJ and PLY."""

from __future__ import annotations

from functools import lru_cache
from io import BytesIO
from pathlib import Path

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.errors import InvalidModel, MissingExtra
from condyn_pin.io.meshes import Mesh, cleaned

_HEADER = 84  # bytes of a binary STL before its triangles: a text of 80, and their number


_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


@lru_cache(maxsize=64)
def read_mesh(path: Path) -> Mesh:
    """Return the triangles of a file, in metres where it names its unit, else in its own units.

    A binary STL is read here, at once; all else (DAE, OBJ, PLY, text STL) by trimesh, all of its
    materials and each under the transform of its node. As in ROS and Gazebo, the axis that a
    COLLADA file calls up does not turn it.

    Raises
    ------
    InvalidModel
        If the file cannot be read.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise InvalidModel(f"{path}: {error.strerror}") from error
    if path.suffix.lower() == ".stl" and len(content) >= _HEADER:
        count = int.from_bytes(content[80:_HEADER], "little")
        if len(content) == _HEADER + count * _FACET.itemsize:
            return _from_corners(_binary_stl(content, count), path)
    return _from_corners(_by_trimesh(content, path), path)


def _binary_stl(content: bytes, count: int) -> Array:
    corners: Array = np.frombuffer(content, _FACET, count, _HEADER)["corners"]
    return corners.reshape(-1, 3)


def _by_trimesh(content: bytes, path: Path) -> Array:
    """Return the corners (3 n, 3) of the triangles of a file; textures are not looked for."""
    try:
        import trimesh
    except ImportError as error:
        raise MissingExtra(
            f"{path.name}: meshes other than binary STL need trimesh: "
            "python -m pip install 'condyn_pin[view]'"
        ) from error

    kind = path.suffix[1:].lower()
    try:
        scene = trimesh.load_scene(BytesIO(content), file_type=kind, process=False, resolver=None)
        shape = scene.to_mesh()
        unit = scene.units or "meters"  # STL and OBJ name none
        metres = trimesh.units.unit_conversion(unit, "meters")
        corners: Array = np.asarray(shape.vertices)[np.asarray(shape.faces)]
        return metres * corners.reshape(-1, 3)
    except Exception as error:  # a stranger's file: whatever its reader stumbles over
        raise InvalidModel(f"{path}: trimesh cannot read it ({error})") from error


def _from_corners(corners: Array, path: Path) -> Mesh:
    """Return the mesh of corners (3 n, 3), three for each triangle, equal ones made one."""
    if not len(corners) or not np.isfinite(corners).all():
        what = "a corner is not finite" if len(corners) else "it has no triangle"
        raise InvalidModel(f"{path}: {what}")
    corners = np.ascontiguousarray(corners)  # unique by bytes is much faster than by rows
    rows = corners.view(np.dtype((np.void, corners.dtype.itemsize * 3))).ravel()
    _, first, cluster = np.unique(rows, return_index=True, return_inverse=True)
    return cleaned(corners[first].astype(float), cluster.reshape(-1, 3))
