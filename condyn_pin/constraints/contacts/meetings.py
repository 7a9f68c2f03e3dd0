"""Where two shapes meet: points, normals and gaps of the features that face each other.

    corner on face    gap = n . (corner - face),                  n of the face
    edge on edge      gap = n . (point of A - point of B),        n = d_A x d_B
    round on any      gap = |a - b| - radius_A - radius_B,        n along a - b

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
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.contacts.cores import (
    Core,
    Indices,
    lengths_of,
    nearest,
    on_face,
    segments,
    size_of,
)

_SOLID: Final = 8  # two quadrangles cut each other in an octagon
_CAPSULES: Final = 5  # four ends, and a crossing
_CAPSULE_ON_SOLID: Final = 4  # two ends, and two edges


class Meeting(NamedTuple):
    """A point where two shapes are near each other."""

    gap: float  # [m]
    point: Array  # (3,) in the world [m]
    normal: Array  # (3,) from the second shape to the first


def most_meetings(A: Core, B: Core) -> int:
    """Return at how many points two shapes meet at most."""
    if A.is_point or B.is_point:
        return 1
    if A.is_solid and B.is_solid:
        return _SOLID
    return _CAPSULE_ON_SOLID if A.is_solid or B.is_solid else _CAPSULES


def meetings(A: Core, B: Core) -> list[Meeting]:
    """Return where two shapes, placed in the world, meet: no more than `most_meetings`.

    The least gap is the distance of the shapes; where they penetrate, the least shift that takes
    them apart, negative.
    """
    if A.is_solid and not B.is_solid:
        return [_turned(each) for each in meetings(B, A)]
    if A.is_point:
        found = _round(A, B)
    elif B.is_point:
        found = [_turned(each) for each in _round(B, A)]
    elif A.is_solid or (B.is_solid and _separation(A, B)[1] < 0.0):
        found = _solids(A, B)
    else:
        found = _round(A, B)
        between = _between(A, B)
        found += _least(between, 2) if B.is_solid else between
    return _distinct(found, max(size_of(A), size_of(B)))[: most_meetings(A, B)]


def _round(A: Core, B: Core) -> list[Meeting]:
    """Return where the balls round the corners of A meet B."""
    distances, normals = nearest(B, A.vertices)
    points = A.vertices - A.radius * normals
    gaps = (distances - A.radius - B.radius).tolist()
    return [Meeting(*each) for each in zip(gaps, points, normals, strict=True)]


def _least(found: list[Meeting], count: int) -> list[Meeting]:
    """Return the nearest few."""
    return sorted(found, key=lambda each: _coarse(each.gap))[:count]


def _turned(each: Meeting) -> Meeting:
    """Return what was found of (A, B) for (B, A): the point is on the skin of B then."""
    return Meeting(each.gap, each.point - each.gap * each.normal, -each.normal)


def _between(A: Core, B: Core) -> list[Meeting]:
    """Return where corners of B, and edges of both between their ends, are nearest to A.

    For cores that are apart.
    """
    p, q, _, _ = _crossings(A, A.edges, B, B.edges)
    distances, normals = lengths_of(p - q)
    gaps = (distances - A.radius - B.radius).tolist()
    crossing = zip(gaps, p - A.radius * normals, normals, strict=True)
    return [*(_turned(each) for each in _round(B, A)), *(Meeting(*each) for each in crossing)]


def _solids(A: Core, B: Core) -> list[Meeting]:
    """Return where a solid A, or the segment of a capsule that is in B, meets a solid B."""
    axis, gap, by_edges = _separation(A, B)
    top = int(B.normals.dot(axis).argmax())
    corners, edges = A.vertices, A.edges
    if A.is_solid:
        bottom = int(A.normals.dot(axis).argmin())
        corners, edges = corners[A.loops[bottom]], _around(A, bottom)
    found = _corners_on(corners, B, top)
    if A.is_solid:
        found += [_turned(each) for each in _corners_on(B.vertices[B.loops[top]], A, bottom)]
    found += _edges_on_edges(A, edges, B, _around(B, top), axis)
    if by_edges:
        found += _edges_on_edges(A, _lowest(A, axis), B, _lowest(B, -axis), axis)
    size = max(size_of(A), size_of(B))
    if all(each.gap > gap + tolerances.EDGE_ON * size for each in found):
        # nothing is over what separates them
        found += _least(_round(A, B) + _between(A, B), 1) if gap > 0.0 else _first(A, axis, gap)
    return [
        Meeting(each.gap - A.radius, each.point - A.radius * each.normal, each.normal)
        for each in _nearest(found, size)
    ]


def _first(A: Core, axis: Array, gap: float) -> list[Meeting]:
    """Return the corner of A that is first along an axis, at a gap."""
    return [Meeting(gap, A.vertices[int(A.vertices.dot(axis).argmin())], axis)]


def _nearest(found: list[Meeting], size: float) -> list[Meeting]:
    """Return those of different points that are nearest, in the order in which they came."""
    order = sorted(range(len(found)), key=lambda i: (_coarse(found[i].gap), i))
    distinct = _distinct([found[i] for i in order], size)[:_SOLID]
    return [each for each in found if any(each is other for other in distinct)]


def _separation(A: Core, B: Core) -> tuple[Array, float, bool]:
    """Return the axis along which two solids are furthest apart, how far, and if edges give it."""
    over_B = A.vertices.dot(B.normals.T).min(axis=0) - B.heights
    over_A = B.vertices.dot(A.normals.T).min(axis=0) - A.heights
    margin = tolerances.EDGE_ON * max(size_of(A), size_of(B))
    i = int(over_B.argmax())
    axis, gap = B.normals[i], over_B[i]
    if A.is_solid and over_A.max() > gap + margin:  # rounding must not choose among equals
        j = int(over_A.argmax())
        axis, gap = -A.normals[j], over_A[j]
    axes = _edge_axes(A, B)
    if len(axes):
        along_A, along_B = A.vertices.dot(axes.T), B.vertices.dot(axes.T)
        apart = np.array([along_A.min(axis=0) - along_B.max(axis=0),
                          along_B.min(axis=0) - along_A.max(axis=0)])  # fmt: skip
        best = int(apart.max(axis=0).argmax())
        way = int(apart[:, best].argmax())
        if apart[way, best] > gap + margin:
            return (-axes[best] if way else axes[best]), float(apart[way, best]), True
    return axis, float(gap), False


def _edge_axes(A: Core, B: Core) -> Array:
    """Return the unit vectors across an edge of A and one of B (k, 3), parallel ones left out."""
    one, two = (segments(core)[1] for core in (A, B))
    one, two = (d / np.sqrt((d**2).sum(axis=1))[:, None] for d in (one, two))
    across = np.cross(one[:, None], two[None]).reshape(-1, 3)
    lengths = np.sqrt((across**2).sum(axis=1))
    kept = lengths > tolerances.PARALLEL
    return np.asarray(across[kept] / lengths[kept][:, None])


def _corners_on(corners: Array, B: Core, face: int) -> list[Meeting]:
    """Return the corners (k, 3) that are over a face of B."""
    normal = B.normals[face]
    gaps = corners.dot(normal) - B.heights[face]
    over = on_face(B, corners - gaps[:, None] * normal)
    return [Meeting(float(gaps[i]), corners[i], normal) for i in np.flatnonzero(over)]


def _edges_on_edges(A: Core, of_A: Indices, B: Core, of_B: Indices, axis: Array) -> list[Meeting]:
    """Return where edges of A cross edges of B, one above the other along an axis."""
    found = []
    for p, q, one, two in zip(*_crossings(A, of_A, B, of_B), strict=True):
        normal = np.cross(one, two)
        normal /= np.copysign(np.sqrt(normal.dot(normal)), normal.dot(axis))
        if normal.dot(axis) > tolerances.CROSSING:
            found.append(Meeting(float((p - q).dot(normal)), p, normal))
    return found


def _crossings(A: Core, of_A: Indices, B: Core, of_B: Indices) -> tuple[Array, Array, Array, Array]:
    """Return the nearest points of lines along edges that cross, and the edges (k, 3) each."""
    (a, d), (b, e) = segments(A, of_A), segments(B, of_B)
    i, j = (index.ravel() for index in np.indices((len(a), len(b))))
    a, d, b, e = a[i], d[i], b[j], e[j]
    dd, ee, de = ((x * y).sum(axis=1) for x, y in ((d, d), (e, e), (d, e)))
    apart = a - b
    da, ea = (d * apart).sum(axis=1), (e * apart).sum(axis=1)
    area = dd * ee - de**2
    skew = area > tolerances.PARALLEL**2 * dd * ee
    area = np.where(skew, area, 1.0)
    s, t = (de * ea - ee * da) / area, (dd * ea - de * da) / area
    slack = tolerances.ON_FACE
    kept = skew & (s >= -slack) & (s <= 1 + slack) & (t >= -slack) & (t <= 1 + slack)
    p, q = a + s[:, None] * d, b + t[:, None] * e
    return p[kept], q[kept], d[kept], e[kept]


def _around(core: Core, face: int) -> Indices:
    """Return the edges around a face (k, 2)."""
    loop = core.loops[face]
    return np.column_stack([loop, np.roll(loop, -1)])


def _lowest(core: Core, axis: Array) -> Indices:
    """Return the edges whose middles are lowest along an axis."""
    along = core.vertices.dot(axis)[core.edges].sum(axis=1)
    lowest: NDArray[np.bool_] = along <= along.min() + tolerances.EDGE_ON * size_of(core)
    return core.edges[lowest]


def _distinct(found: list[Meeting], size: float) -> list[Meeting]:
    """Return what was found without points that are there already."""
    near = tolerances.ONE_POINT * size
    kept: list[Meeting] = []
    for each in found:
        if all(np.abs(each.point - other.point).max() > near for other in kept):
            kept.append(each)
    return kept


def _coarse(gap: float) -> float:
    """Return a gap without the digits that rounding makes [m]."""
    return round(gap, 12)
