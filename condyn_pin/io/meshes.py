"""Triangle meshes: read from STL, DAE, OBJ and PLY, solids of simple shapes, made smaller."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from condyn_pin._core.arrays import Array
from condyn_pin.errors import InvalidModel, MissingExtra


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles."""

    vertices: Array  # (k, 3) [m]
    faces: NDArray[np.uint32]  # (n, 3), corners of each, counter-clockwise from outside

    def moved(self, T: ArrayLike) -> Mesh:
        """Return the mesh mapped by a homogeneous matrix (4, 4)."""
        T = np.asarray(T)
        return Mesh(self.vertices @ T[:3, :3].T + T[:3, 3], self.faces)

    def simplified(self, cell: float) -> Mesh:
        """Return the mesh with all vertices in a box of edges `cell` [m] merged to their mean."""
        # Triangles that lose a corner vanish, and so do parts smaller than a cell. No edge of a
        # cell is longer than a third of the mesh along it: rods and plates keep their shape. Vertex
        # clustering of Rossignac and Borrel (1993): O(k log k), and no topology is needed.
        if not len(self.faces):
            return self
        from_corner = self.vertices - self.vertices.min(axis=0)
        extent = np.maximum(from_corner.max(axis=0), 1e-9 * cell)  # what is flat has no thickness
        boxes = np.floor(from_corner / np.minimum(cell, extent / 3.0)).astype(np.int64)
        _, cluster = np.unique(_numbers(boxes), return_inverse=True)
        count = np.bincount(cluster)[:, None]
        sums = [np.bincount(cluster, weights=x) for x in self.vertices.T]
        return cleaned(np.column_stack(sums) / count, cluster[self.faces])

    def __add__(self, other: Mesh) -> Mesh:
        faces = np.vstack([self.faces, other.faces + len(self.vertices)])
        return Mesh(np.vstack([self.vertices, other.vertices]), faces.astype(np.uint32))


def _numbers(rows: NDArray[Any]) -> NDArray[np.int64]:
    """Unique number of each row (k, 3) of integers from 0 on, equal for equal rows."""
    # Numbers are compared much faster than rows.
    x, y, z = rows.T.astype(np.int64)
    numbers: NDArray[np.int64] = (x * (y.max(initial=0) + 1) + y) * (z.max(initial=0) + 1) + z
    return numbers


def cleaned(vertices: Array, corners: NDArray[Any]) -> Mesh:
    """Return a mesh without triangles of a repeated corner, double ones, and unused vertices."""
    a, b, c = corners.T
    corners = corners[(a != b) & (b != c) & (c != a)]
    _, first = np.unique(_numbers(np.sort(corners, axis=1)), return_index=True)
    kept, faces = np.unique(corners[np.sort(first)], return_inverse=True)
    return Mesh(vertices[kept], faces.reshape(-1, 3).astype(np.uint32))


def solid_of_revolution(profile: ArrayLike, sides: int = 20) -> Mesh:
    """Return the solid of revolution about z of a profile (k, 2) of radius and height [m]."""
    r, z = np.asarray(profile, dtype=float).T
    angle = 2.0 * np.pi * np.arange(sides) / sides
    x, y = (np.outer(r, f(angle)) for f in (np.cos, np.sin))
    vertices = np.stack([x, y, np.broadcast_to(z[:, None], x.shape)], axis=2).reshape(-1, 3)
    ring, side = np.meshgrid(np.arange(len(r) - 1), np.arange(sides), indexing="ij")
    a, b = ring * sides + side, ring * sides + (side + 1) % sides
    c, d = a + sides, b + sides
    faces = np.concatenate([np.stack([a, b, d], 2), np.stack([a, d, c], 2)]).reshape(-1, 3)
    return Mesh(vertices, faces.astype(np.uint32))


def sphere(radius: float) -> Mesh:
    """Return a ball about the origin."""
    angle = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 11)
    return solid_of_revolution(radius * np.column_stack([np.cos(angle), np.sin(angle)]))


def cylinder(radius: float, height: float) -> Mesh:
    """Return a cylinder along z, its middle in the origin."""
    h = 0.5 * height
    return solid_of_revolution([(0.0, -h), (radius, -h), (radius, h), (0.0, h)])


def rod(radius: float, length: float, sides: int) -> Mesh:
    """Return a cylinder along z, from the origin."""
    return solid_of_revolution([(0.0, 0.0), (radius, 0.0), (radius, length), (0.0, length)], sides)


def capsule(radius: float, height: float) -> Mesh:
    """Return a cylinder along z from 0 to `height` with half a ball at each end."""
    angle = np.linspace(0.0, 0.5 * np.pi, 5)
    cap = radius * np.column_stack([np.cos(angle), np.sin(angle)])
    return solid_of_revolution(np.vstack([cap[::-1] * (1, -1), cap + np.array([0.0, height])]), 12)


def centred_capsule(radius: float, length: float) -> Mesh:
    """Return a capsule along z, its middle in the origin."""
    down = np.eye(4)
    down[2, 3] = -0.5 * length
    return capsule(radius, length).moved(down)


def box(x: float, y: float, z: float) -> Mesh:
    """Return a box of these edges, its middle in the origin."""
    corners = np.array([(i, j, k) for i in (-0.5, 0.5) for j in (-0.5, 0.5) for k in (-0.5, 0.5)])
    faces = [
        (0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1),
        (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3),
    ]  # fmt: skip
    return Mesh(corners * (x, y, z), np.array(faces, dtype=np.uint32))


_HEADER = 84  # bytes of a binary STL before its triangles: a text of 80, and their number


_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


@lru_cache(maxsize=64)
def read_mesh(path: Path) -> Mesh:
    """Return the triangles of a file, in metres where it names its unit, else in its own units."""
    # A binary STL is read here; all else (DAE, OBJ, PLY, text STL) by trimesh, with all materials,
    # each under the transform of its node. As in ROS and Gazebo, the up axis of a COLLADA file does
    # not rotate it.
    try:
        content = path.read_bytes()
    except OSError as error:
        raise InvalidModel(f"{path}: {error.strerror}") from error
    if path.suffix.lower() == ".stl" and len(content) >= _HEADER:
        count = int.from_bytes(content[80:_HEADER], "little")
        if len(content) == _HEADER + count * _FACET.itemsize:
            corners = np.frombuffer(content, _FACET, count, _HEADER)["corners"]
            return _from_corners(corners.reshape(-1, 3), path)
    return _from_corners(_by_trimesh(content, path), path)


def _by_trimesh(content: bytes, path: Path) -> Array:
    """Corners (3 n, 3) of the triangles of a file, without textures."""
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
    """Mesh of corners (3 n, 3), three for each triangle, with equal corners merged."""
    if not len(corners) or not np.isfinite(corners).all():
        what = "a corner is not finite" if len(corners) else "it has no triangle"
        raise InvalidModel(f"{path}: {what}")
    corners = np.ascontiguousarray(corners)  # unique by bytes is much faster than by rows
    rows = corners.view(np.dtype((np.void, corners.dtype.itemsize * 3))).ravel()
    _, first, cluster = np.unique(rows, return_index=True, return_inverse=True)
    return cleaned(corners[first].astype(float), cluster.reshape(-1, 3))
