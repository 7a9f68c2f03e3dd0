"""A convex solid by its corners: what a mesh has to be to touch."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array, shown
from condyn_pin.constraints.constraint_fields import Vector3, floats
from condyn_pin.constraints.contacts.cores import Core, Indices, across, solid_core
from condyn_pin.constraints.contacts.shapes import ContactPoint, Shape
from condyn_pin.errors import InvalidArgument

# Three rows each on a plane: what has more is as good with fewer.
_MOST: Final = 64


@dataclass(frozen=True)
class Convex(Shape):
    """A convex solid.

    Parameters
    ----------
    vertices : sequence of (3,) sequence of float
        Its corners, 4 to 64 of them, each on its hull [m]. A mesh with more of them, or one that is
        not convex, is to be simplified or cut into parts first.

    Raises
    ------
    InvalidArgument
        If a corner is inside of the hull of the others, or all of them lie in a plane.
    """

    vertices: tuple[Vector3, ...]

    def __post_init__(self) -> None:
        if isinstance(self.vertices, str) or not isinstance(self.vertices, Iterable):
            raise InvalidArgument(f"vertices = {shown(self.vertices)}: a list of points is needed")
        vertices = tuple(
            floats(f"vertices[{i}]", point, 3) for i, point in enumerate(self.vertices)
        )
        if not 4 <= len(vertices) <= _MOST:
            raise InvalidArgument(f"vertices: {len(vertices)} of them; 4 to {_MOST} are needed")
        object.__setattr__(self, "vertices", vertices)
        inside = set(range(len(vertices))) - set(self._hull.vertices.tolist())
        if inside:
            i = min(inside)
            raise InvalidArgument(
                f"vertices[{i}] = {vertices[i]}: it is not a corner of the convex hull; a "
                "convex solid is needed, so split a concave mesh into convex parts"
            )
        self.core  # noqa: B018  refuses what is too flat

    @property
    def contact_points(self) -> tuple[ContactPoint, ...]:
        """Its corners."""
        return tuple(
            ContactPoint(f"corner {i}", at, 0.0) for i, at in enumerate(self.vertices, start=1)
        )

    @property
    def core(self) -> Core:
        """The solid: triangles of one plane are one face."""
        points = np.array(self.vertices)
        off = tolerances.FLAT * float(np.ptp(points, axis=0).max())
        normals, heights = _planes(points, self._hull, off)
        on = np.abs(points.dot(normals.T) - heights) <= off
        if on.all(axis=0).any():
            raise _flat()
        loops = tuple(
            _around(points, np.flatnonzero(on[:, face]), normal)
            for face, normal in enumerate(normals)
        )
        edges = {
            (min(a, b), max(a, b))
            for loop in loops
            for a, b in zip(loop.tolist(), np.roll(loop, -1).tolist(), strict=True)
        }
        return solid_core(points, np.array(sorted(edges)), normals, heights, loops)

    @property
    def _hull(self) -> Any:
        from scipy.spatial import ConvexHull, QhullError

        try:
            return ConvexHull(np.array(self.vertices))
        except QhullError as error:
            raise _flat() from error


def _planes(points: Array, hull: Any, off: float) -> tuple[Array, Array]:
    """Return outward normals and heights of the faces of a hull: triangles of one plane are one.

    A triangle belongs to the plane of a larger one if its corners are `off` it by no more [m].
    """
    corners = points[hull.simplices]
    _, twice = across(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    above = np.abs(corners.dot(hull.equations[:, :3].T) + hull.equations[:, 3]).max(axis=1)
    kept: list[int] = []
    for i in np.argsort(-twice, kind="stable").tolist():  # a sliver has no normal of its own
        if (above[i, kept] > off).all():
            kept.append(i)
    planes = hull.equations[sorted(kept)]
    return planes[:, :3], -planes[:, 3]


def _flat() -> InvalidArgument:
    return InvalidArgument("vertices: they lie in a plane, or nearly; a solid is needed")


def _around(points: Array, corners: Indices, normal: Array) -> Indices:
    """Return the corners of a face in their order around it."""
    away = points[corners] - points[corners].mean(axis=0)
    x = away[0] / np.sqrt(away[0].dot(away[0]))
    y = np.array([normal[1] * x[2] - normal[2] * x[1], normal[2] * x[0] - normal[0] * x[2],
                  normal[0] * x[1] - normal[1] * x[0]])  # fmt: skip
    return corners[np.argsort(np.arctan2(away.dot(y), away.dot(x)), kind="stable")]
