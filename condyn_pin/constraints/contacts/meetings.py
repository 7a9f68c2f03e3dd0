"""Contact points of two shapes: points, normals and gaps of features that face each other.

    corner on face    gap = n . (corner - face),                  n of the face
    edge on edge      gap = n . (point of A - point of B),        n = d_A x d_B
    round on any      gap = |a - b| - radius_A - radius_B,        n along a - b
    many on a plane   gap = n . (point - plane),                  n of the plane

n points from B to A. Each gap is that of features fixed to the bodies, so that it changes as fast
as the material points at its contact point approach along n; a flat contact has as many gaps as
corners, and not one for all. Corners, edges and faces come in the order of the shapes: the same
placements give the same points on every machine.

References
----------
Gottschalk, Lin, Manocha. OBBTree: a hierarchical structure for rapid interference detection.
SIGGRAPH 1996.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array, Indices
from condyn_pin.constraints.contacts.shapes import (
    Core,
    lengths_of,
    nearest,
    on_face,
    segments,
    unit_cross,
)

_SOLID: Final = 8  # two quadrangles cut each other in an octagon
_CAPSULES: Final = 5  # four ends, and a crossing
_CAPSULE_ON_SOLID: Final = 4  # two ends, and two edges
_BALL_ON_GROUND, _CAPSULE_ON_GROUND = 4, 6
_CYLINDER_ON_PLANE: Final = 6  # the lowest of each rim, and four of the lower one

# Corners that are higher than the lowest one of their solid by less are next to touch, as a share
# of its size: a facet of a fine mesh tips over one of its edges by as much.
NEXT: Final = 1e-2
# Beyond this distance shapes are not looked at closely: a step of 1 ms at 20 m/s [m].
REACH: Final = 0.02

_FEWEST: Final = 4  # corners, whether they are in this band or not


class ContactPoints(NamedTuple):
    """Contact points of two shapes."""

    gaps: Array  # (k,) [m]
    points: Array  # (k, 3) on the first shape, in the world [m]
    normals: Array  # (k, 3) from the second shape to the first

    def turned(self) -> ContactPoints:
        """Contact points with the shapes in the other order."""
        return ContactPoints(
            self.gaps, self.points - self.gaps[:, None] * self.normals, -self.normals
        )

    def taken(self, chosen: Indices) -> ContactPoints:
        """Some of the contact points."""
        return ContactPoints(*(part[chosen] for part in self))

    def filled(self, count: int) -> ContactPoints:
        """Contact points, padded to a number of them with infinite gaps."""
        known = len(self.gaps)
        padded = self.taken(np.minimum(np.arange(count), known - 1))
        padded.gaps[known:] = np.inf
        return padded

    def least(self, count: int) -> ContactPoints:
        """Nearest few contact points, the nearest one first."""
        # without the digits that rounding makes [m]
        return self.taken(np.round(self.gaps, 12).argsort(kind="stable")[:count])


def _joined(*parts: ContactPoints) -> ContactPoints:
    return ContactPoints(*(np.concatenate(each) for each in zip(*parts, strict=True)))


def most_meetings(A: Core, B: Core) -> int:
    """Largest number of contact points of two shapes."""
    if B.is_plane:
        if A.half_axes is None:
            return min(_SOLID, len(A.vertices))
        return _CYLINDER_ON_PLANE if A.has_rims else 1
    if A.is_point or B.is_point:
        return 1
    if A.is_solid and B.is_solid:
        return _SOLID
    return _CAPSULE_ON_SOLID if A.is_solid or B.is_solid else _CAPSULES


def most_on_ground(A: Core) -> int:
    """Largest number of contact points of a shape on a ground."""
    if A.half_axes is not None:
        return _SOLID
    return {1: _BALL_ON_GROUND, 2: _CAPSULE_ON_GROUND}.get(len(A.vertices), _SOLID)


def meetings(A: Core, B: Core) -> ContactPoints:
    """Contact points of two shapes placed in the world, no more than `most_meetings`.

    The least gap is the distance of the shapes; where they penetrate, the least shift that takes
    them apart, negative.
    """
    if B.is_plane:
        return _over_plane(A, B)
    if A.is_solid and not B.is_solid:
        return meetings(B, A).turned()
    if A.is_point:
        return _points_of_round_core(A, B)
    if B.is_point:
        return _points_of_round_core(B, A).turned()
    if A.is_solid or (B.is_solid and _separation(A, B)[1] < 0.0):
        return _solids(A, B)
    between = _points_of_crossings(A, B)
    found = _joined(_points_of_round_core(A, B), between.least(2) if B.is_solid else between)
    return found.taken(_distinct(found, max(A.size, B.size))[: most_meetings(A, B)])


def _over_plane(A: Core, B: Core) -> ContactPoints:
    """Contact points of a shape over a plane.

    A point of a smooth surface with the least gap moves along the plane alone, so that its gap
    changes as fast as its material approaches.
    """
    n, height = B.normals[0], B.heights[0]
    points = A.vertices if A.half_axes is None else lowest_points(A, n)
    gaps = points.dot(n) - height
    if A.half_axes is None:
        chosen = _lowest_corners(points, gaps, A.size)
        points, gaps = points[chosen], gaps[chosen]
    return ContactPoints(gaps, points, np.repeat(n[None], len(points), axis=0))


def lowest_points(A: Core, n: Array) -> Array:
    """Lowest point of an ellipsoid along n, or of both rims of a cylinder and four of one."""
    assert A.half_axes is not None
    centre, along = A.vertices[0], n.dot(A.half_axes)  # (3,), heights of the ends of half axes
    if not A.has_rims:
        return np.asarray(centre - A.half_axes.dot(along / np.sqrt(along.dot(along))))[None]
    x, y, axis = A.half_axes.T
    tilt = np.hypot(along[0], along[1])
    lowest = -(along[0] * x + along[1] * y) / tilt if tilt > 0.0 else x  # upright all are equal
    ends = np.array([centre + axis, centre - axis])
    lower = ends[1] if along[2] >= 0.0 else ends[0]
    return np.vstack([ends + lowest, lower + np.array([x, y, -x, -y])])


def _lowest_corners(points: Array, gaps: Array, size: float) -> Indices:
    """Indices of the lowest corner, of those far apart in a band above it, and the next lowest.

    Of a solid that is above the plane by more than its size, of the lowest corner alone.
    """
    if gaps.min() > size:
        return np.array([np.round(gaps, 12).argmin()])
    order = np.round(gaps, 12).argsort(kind="stable")[: 8 * _SOLID]
    level = order[gaps[order] <= gaps[order[0]] + NEXT * size]
    kept, apart = [int(order[0])], np.full(len(level), np.inf)
    while len(kept) < min(_SOLID, len(level)):
        apart = np.minimum(apart, ((points[level] - points[kept[-1]]) ** 2).sum(axis=1))
        kept.append(int(level[np.round(apart, 12).argmax()]))
    kept += order[len(level) : len(level) + _FEWEST - len(kept)].tolist()
    return np.sort(kept)


def _points_of_round_core(A: Core, B: Core) -> ContactPoints:
    """Contact points of the balls round the corners of A with B."""
    distances, normals = nearest(B, A.vertices)
    return ContactPoints(distances - A.radius - B.radius, A.vertices - A.radius * normals, normals)


def _points_of_crossings(A: Core, B: Core) -> ContactPoints:
    """Contact points of corners of B, and of crossing edges of both, with A.

    For cores that are apart.
    """
    p, q, _, _ = _crossings(A, A.edges, B, B.edges, tolerances.FLAT)
    distances, normals = lengths_of(p - q)
    crossing = ContactPoints(distances - A.radius - B.radius, p - A.radius * normals, normals)
    return _joined(_points_of_round_core(B, A).turned(), crossing)


def _solids(A: Core, B: Core) -> ContactPoints:
    """Contact points of a solid A, or the segment of a capsule inside B, with a solid B."""
    axis, gap, by_edges = _separation(A, B)
    top = int(B.normals.dot(axis).argmax())
    corners, edges = A.vertices, A.edges
    parts = []
    if A.is_solid:
        bottom = int(A.normals.dot(axis).argmin())
        corners, edges = corners[A.loops[bottom]], _face_edges(A, bottom)
        parts.append(_corners_on(B.vertices[B.loops[top]], A, bottom).turned())
    parts.insert(0, _corners_on(corners, B, top))
    parts.append(_edges_on_edges(A, edges, B, _face_edges(B, top), axis))
    if by_edges:
        parts.append(_edges_on_edges(A, _lowest(A, axis), B, _lowest(B, -axis), axis))
    found, size = _joined(*parts), max(A.size, B.size)
    margin = tolerances.EDGE_ON * size
    # what is deeper than the solids has a shorter way out, along what separates them
    found = found.taken(np.flatnonzero(found.gaps >= gap - margin))
    if (found.gaps > gap + margin).all():  # nothing is over what separates them
        first = (
            _joined(_points_of_round_core(A, B), _points_of_crossings(A, B))
            if gap > 0.0
            else _lowest_corner(A, axis, gap)
        )
        found = _joined(found, first.least(1))
    found = found._replace(
        gaps=found.gaps - A.radius, points=found.points - A.radius * found.normals
    )
    return _nearest(found, size)


def _lowest_corner(A: Core, axis: Array, gap: float) -> ContactPoints:
    """Contact point at the lowest corner of A along an axis, with a given gap."""
    first = int(A.vertices.dot(axis).argmin())
    return ContactPoints(np.array([gap]), A.vertices[first][None], axis[None])


def _nearest(found: ContactPoints, size: float) -> ContactPoints:
    """Nearest contact points at different places, in their given order."""
    order = np.round(found.gaps, 12).argsort(kind="stable")
    distinct = order[_distinct(found.taken(order), size)]
    return found.taken(np.sort(distinct[:_SOLID]))


def _separation(A: Core, B: Core) -> tuple[Array, float, bool]:
    """Axis of the largest separation of two solids, the separation, and whether edges give it."""
    over_B = A.vertices.dot(B.normals.T).min(axis=0) - B.heights
    over_A = B.vertices.dot(A.normals.T).min(axis=0) - A.heights
    margin = tolerances.EDGE_ON * max(A.size, B.size)
    i = int(over_B.argmax())
    axis, gap = B.normals[i], over_B[i]
    if A.is_solid and over_A.max() > gap + margin:  # rounding must not choose among equals
        j = int(over_A.argmax())
        axis, gap = -A.normals[j], over_A[j]
    axes = _edge_axes(A, B)
    if len(axes):
        along_A, along_B = A.vertices.dot(axes.T), B.vertices.dot(axes.T)
        above, below = (
            along_A.min(axis=0) - along_B.max(axis=0),
            along_B.min(axis=0) - along_A.max(axis=0),
        )
        best = int(np.maximum(above, below).argmax())
        if max(above[best], below[best]) > gap + margin:
            sign = 1.0 if above[best] >= below[best] else -1.0
            return sign * axes[best], float(max(above[best], below[best])), True
    return axis, float(gap), False


def _edge_axes(A: Core, B: Core) -> Array:
    """Return the unit vectors across edges of A and of B (k, 3), without those of parallel ones."""
    normals, sines = unit_cross(*_every_pair(A.directions, B.directions))
    return np.asarray(normals[sines > tolerances.FLAT])


def _every_pair(one: Array, two: Array) -> tuple[Array, Array]:
    """All pairs of rows of two arrays."""
    return np.repeat(one, len(two), axis=0), np.tile(two, (len(one), 1))


def _corners_on(corners: Array, B: Core, face: int) -> ContactPoints:
    """Contact points of corners (k, 3) over a face of B."""
    normal = B.normals[face]
    gaps = corners.dot(normal) - B.heights[face]
    over = on_face(B, corners - gaps[:, None] * normal)
    return ContactPoints(gaps[over], corners[over], np.repeat(normal[None], over.sum(), axis=0))


def _edges_on_edges(A: Core, of_A: Indices, B: Core, of_B: Indices, axis: Array) -> ContactPoints:
    """Contact points of edges of A crossing edges of B, one above the other along an axis."""
    p, q, one, two = _crossings(A, of_A, B, of_B)
    normals, _ = unit_cross(one, two)
    cosines = normals.dot(axis)
    normals = np.sign(cosines)[:, None] * normals
    above = np.abs(cosines) > tolerances.CROSSING
    return ContactPoints(((p - q) * normals).sum(axis=1)[above], p[above], normals[above])


def _crossings(
    A: Core, of_A: Indices, B: Core, of_B: Indices, least: float = tolerances.PARALLEL
) -> tuple[Array, Array, Array, Array]:
    """Return the nearest points of lines along edges that cross, and the edges (k, 3) each.

    `least` is the sine of the angle from which on edges are not parallel.
    """
    (a, d), (b, e) = segments(A, of_A), segments(B, of_B)
    (a, b), (d, e) = _every_pair(a, b), _every_pair(d, e)
    apart = a - b
    dd, ee, de = (d * d).sum(axis=1), (e * e).sum(axis=1), (d * e).sum(axis=1)
    da, ea = (d * apart).sum(axis=1), (e * apart).sum(axis=1)
    area = dd * ee - de**2
    skew = area > least**2 * dd * ee
    area = np.where(skew, area, 1.0)
    shares = np.array([de * ea - ee * da, dd * ea - de * da]) / area
    kept = skew & (np.abs(shares - 0.5) <= 0.5 + tolerances.ON_FACE).all(axis=0)
    s, t = shares[:, kept, None]
    a, d, b, e = a[kept], d[kept], b[kept], e[kept]
    return a + s * d, b + t * e, d, e


def _face_edges(core: Core, face: int) -> Indices:
    """Return the edges around a face (k, 2)."""
    loop = core.loops[face]
    return np.array([loop, (*loop[1:], loop[0])]).T


def _lowest(core: Core, axis: Array) -> Indices:
    """Edges with the lowest middles along an axis."""
    along = core.vertices.dot(axis)[core.edges].sum(axis=1)
    lowest: NDArray[np.bool_] = along <= along.min() + tolerances.EDGE_ON * core.size
    return core.edges[lowest]


def _distinct(found: ContactPoints, size: float) -> Indices:
    """Indices of the contact points that repeat no earlier one."""
    apart = np.abs(found.points[:, None] - found.points).max(axis=2)
    again = np.tril(apart <= tolerances.ONE_POINT * size, -1).any(axis=1)
    return np.flatnonzero(~again)
