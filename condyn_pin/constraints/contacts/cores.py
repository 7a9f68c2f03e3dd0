"""Cores: what is left of a shape without its round skin, a point, a segment or a polytope.

shape = core + ball of a radius
"""

from __future__ import annotations

from itertools import pairwise, product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array

Indices = NDArray[np.int_]


class Core(NamedTuple):
    """Corners, edges and faces, in the axes of the shape or of the world.

    Attributes
    ----------
    vertices : (k, 3) array
        [m].
    edges : (e, 2) int array
        The two ends of each.
    normals : (f, 3) array
        Of the faces, outwards.
    heights : (f,) array
        Of the faces along their normals: a point x is inside if normals x <= heights [m].
    loops : tuple of int array
        The vertices of each face, one after the other around it.
    radius : float
        Of the skin [m].
    directions : (d, 3) array
        Unit vectors along the edges, one for parallel ones.
    size, reach : float
        The longest distance along a coordinate of its own axes, and of a point of the shape from
        the origin [m].
    """

    vertices: Array
    edges: Indices
    normals: Array
    heights: Array
    loops: tuple[Indices, ...]
    radius: float
    directions: Array
    size: float
    reach: float

    @property
    def is_point(self) -> bool:
        """Whether it has no size."""
        return len(self.vertices) == 1

    @property
    def is_solid(self) -> bool:
        """Whether it has an inside."""
        return len(self.normals) > 0

    def placed(self, at: Any) -> Core:
        """Return it in the world, at a placement."""
        R, p = at.rotation, at.translation
        normals = self.normals.dot(R.T)
        return self._replace(
            vertices=self.vertices.dot(R.T) + p, normals=normals,
            heights=self.heights + normals.dot(p), directions=self.directions.dot(R.T),
        )  # fmt: skip


def points_core(*vertices: tuple[float, float, float], radius: float) -> Core:
    """Return the core of a ball, or of a capsule between two points."""
    ends = np.array(vertices)
    edges = np.array([*pairwise(range(len(ends)))], dtype=np.int_).reshape(-1, 2)
    return _core(ends, edges, np.zeros((0, 3)), np.zeros(0), (), radius)


def box_core(x: float, y: float, z: float) -> Core:
    """Return a box with half-edges x, y and z, its corners in the order of `Box.contact_points`."""
    half = np.array([x, y, z])
    vertices = half * np.array([*product((1.0, -1.0), repeat=3)])
    edges = np.array([(i, i + step) for step in (4, 2, 1) for i in range(8) if not i & step])
    normals = np.vstack([np.eye(3), -np.eye(3)])
    around = [np.array([0, a, a + b, b]) for a, b in ((2, 1), (4, 1), (4, 2))]
    loops = (*around, *(loop + bit for loop, bit in zip(around, (4, 2, 1), strict=True)))
    return solid_core(vertices, edges, normals, np.concatenate([half, half]), loops)


def solid_core(
    vertices: Array, edges: Indices, normals: Array, heights: Array, loops: tuple[Indices, ...]
) -> Core:
    """Return a convex solid; what each of them is `Core` says."""
    return _core(vertices, edges, normals, heights, loops, 0.0)


def _core(
    vertices: Array,
    edges: Indices,
    normals: Array,
    heights: Array,
    loops: tuple[Indices, ...],
    radius: float,
) -> Core:
    size = float(np.ptp(vertices, axis=0).max())
    return Core(
        vertices, edges, normals, heights, loops, radius,
        directions=_directions(vertices[edges[:, 1]] - vertices[edges[:, 0]], size), size=size,
        reach=float(lengths_of(vertices)[0].max()) + radius,
    )  # fmt: skip


def _directions(along: Array, size: float) -> Array:
    """Return the unit vectors along edges (e, 3), one for those whose ends part by rounding."""
    lengths, units = lengths_of(along)
    kept: list[int] = []
    for i, (unit, length) in enumerate(zip(units, lengths, strict=True)):
        _, sines = across(np.repeat(unit[None], len(kept), axis=0), units[kept])
        if (sines * np.maximum(length, lengths[kept]) > tolerances.FLAT * size).all():
            kept.append(i)
    return np.asarray(units[kept])


def nearest(core: Core, points: Array) -> tuple[Array, Array]:
    """Return the signed distances of points (k, 3) from a core (k,), and the ways there (k, 3)."""
    distances, ways = _from_edges(core, points)
    if core.is_solid:
        above = points.dot(core.normals.T) - core.heights
        face = above.argmax(axis=1)
        height, normal = above[np.arange(len(points)), face], core.normals[face]
        over = (height <= 0.0) | on_face(core, points - height[:, None] * normal)
        distances = np.where(over, height, distances)
        ways = np.where(over[:, None], normal, ways)
    return distances, ways


def _from_edges(core: Core, points: Array) -> tuple[Array, Array]:
    """Return the distances of points from the edges of a core, or from its only corner."""
    away = points[:, None] - core.vertices
    if len(core.edges):
        start, along = segments(core)
        away = points[:, None] - start
        share = (away * along).sum(axis=2) / (along**2).sum(axis=1)
        away = away - np.clip(share, 0.0, 1.0)[:, :, None] * along
    squares = (away**2).sum(axis=2)
    return lengths_of(away[np.arange(len(points)), squares.argmin(axis=1)])


def lengths_of(vectors: Array) -> tuple[Array, Array]:
    """Return the lengths of vectors (k, 3) and their directions; that of zero is z."""
    lengths = np.sqrt((vectors**2).sum(axis=1))
    some = lengths > 0.0
    directions = vectors / np.where(some, lengths, 1.0)[:, None]
    directions[~some] = (0.0, 0.0, 1.0)
    return lengths, directions


def on_face(core: Core, points: Array) -> NDArray[np.bool_]:
    """Return for points (k, 3) of the planes of its faces whether they are on the core."""
    heights = points.dot(core.normals.T) - core.heights
    return np.asarray((heights <= tolerances.ON_FACE * core.size).all(axis=1))


def segments(core: Core, chosen: Indices | None = None) -> tuple[Array, Array]:
    """Return where edges start and the vectors to their ends (e, 3), of all by default."""
    edges = core.edges if chosen is None else chosen
    start = core.vertices[edges[:, 0]]
    return start, core.vertices[edges[:, 1]] - start


def across(one: Array, two: Array) -> tuple[Array, Array]:
    """Return the unit vectors across two rows of vectors (k, 3), and the lengths of the products.

    As `numpy.cross`, which takes ten times as long for a few.
    """
    (x, y, z), (u, v, w) = one.T, two.T
    lengths, normals = lengths_of(np.array([y * w - z * v, z * u - x * w, x * v - y * u]).T)
    return normals, lengths
