"""Contact points of shapes on a ground, of all shapes of a scene at once.

A shape is convex: corners, edges and faces with a round skin of radius r. A contact is a feature of
the shape above one of the ground, with a normal n that both may meet there,

    corner p above a face      n = n_f,                  gap = n . p - height - r
    edge across an edge        n = +-(d_A x d_B),        gap = n . (a - b) - r
    corner p beside an edge    n = (p - x) / |p - x|,    gap = |p - x| - r
    corner x of the ground     n against the face that it is next to, or away from x

so that it is a nearest place of both: p is lowest along n, and a flat or hollow edge catches
nothing. Where two are
inside each other, gaps that are deeper than the way out along the faces beside them do not count.

A cylinder is above a face with the lowest points of its rims along n; edges of the ground meet its
side as that of a capsule, and its rims, circles c + R u, where (c + R u - b) . u' = 0.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array, Indices
from condyn_pin.constraints.contacts.ground import Surface
from condyn_pin.constraints.contacts.meetings import NEXT, REACH, lowest_points, most_on_ground
from condyn_pin.constraints.contacts.seams import WIDTH, is_hidden
from condyn_pin.constraints.contacts.shapes import Core, lengths_of, unit_cross

# What is near is looked for again when a shape has moved by this [m].
_SLACK: Final = 0.05

# A contact may be deeper than the way out beside it by a factor of two, and this [m].
_DEEPER: Final = 1e-5

# How deep a contact of a part that is not convex may be: walls of meshes are thicker [m].
_DEEPEST: Final = 5e-3

# Sines up to which a normal is still one of those of an edge or a corner. Of flat contacts all
# places count that are next to touch: there it is `NEXT`.
_BESIDE: Final = 1e-9

# Corners beside corners or edges have a normal from this distance on [m].
_APART: Final = 1e-9

# Features of the shape and of the ground at a contact.
CORNER, EDGE, FACE = 0, 1, 2


class Skeleton(NamedTuple):
    """A convex shape without its skin, in its own axes.

    Attributes
    ----------
    points : (k, 3) array
    ends : (e, 2) int array
        The points of each edge.
    along : (e, 3) array
        Unit vectors along the edges.
    beside : (e, 2) int array
        The faces beside each edge.
    normals, heights : (f, 3), (f,) array
    """

    core: Core
    points: Array
    radius: float
    width: float  # radius of what is round its edges: of a cylinder, its own [m]
    ends: Indices
    along: Array
    beside: Indices
    normals: Array
    heights: Array
    middle: Array  # (3,), of its box
    half: Array  # (3,), of the edges of its box
    size: float
    places: int


def skeleton_of(core: Core) -> Skeleton:
    """Skeleton of a shape: of a solid, the hull of its corners."""
    V, none = core.vertices, np.zeros((0, 2), dtype=np.int_)
    ends, beside, normals, heights = none, none, np.zeros((0, 3)), np.zeros(0)
    low, high, width = V.min(axis=0) - core.radius, V.max(axis=0) + core.radius, core.radius
    if core.half_axes is not None:  # a cylinder: its axis
        _, _, axis = core.half_axes.T
        V, ends = V[0] + np.array([axis, -axis]), np.array([[0, 1]])
        reach = np.sqrt((core.half_axes[:, :2] ** 2).sum(axis=1)) + np.abs(axis)
        low, high, width = -reach, reach, float(lengths_of(core.half_axes.T)[0][0])
    elif len(V) == 2:
        ends = np.array([[0, 1]])
    elif len(V) > 2:
        from scipy.spatial import ConvexHull

        hull = ConvexHull(V)
        normals, heights = hull.equations[:, :3].copy(), -hull.equations[:, 3]
        f = np.repeat(np.arange(len(normals)), 3)
        other = hull.neighbors.ravel()
        pairs = hull.simplices[:, [[1, 2], [0, 2], [0, 1]]].reshape(-1, 2)
        sharp = (normals[f] * normals[other]).sum(axis=1) < 1.0 - tolerances.FLAT**2
        once = (f < other) & sharp
        ends, beside = pairs[once].astype(np.int_), np.stack([f, other], axis=1)[once]
    along = lengths_of(V[ends[:, 1]] - V[ends[:, 0]])[1]
    size = float((high - low).max())
    return Skeleton(
        core, V, core.radius, width, ends, along, beside, normals, heights, (low + high) / 2.0,
        (high - low) / 2.0, size, most_on_ground(core),
    )  # fmt: skip


class Found(NamedTuple):
    """Contacts, in no order.

    `of` is the shape of each, `kinds` the features of the shape and the ground, `along` their
    directions where they are edges.
    """

    of: Indices  # (k,)
    gaps: Array  # (k,)
    points: Array  # (k, 3), on the shape, its skin included
    normals: Array  # (k, 3)
    part: Indices  # (k,)
    kinds: Indices  # (k, 2)
    along: Array  # (k, 2, 3)

    def taken(self, chosen: Indices | NDArray[np.bool_] | slice) -> Found:
        """Some of the contacts."""
        return Found(
            self.of[chosen], self.gaps[chosen], self.points[chosen], self.normals[chosen],
            self.part[chosen], self.kinds[chosen], self.along[chosen],
        )  # fmt: skip


def _found(
    of: Indices, gaps: Array, points: Array, n: Array, part: Indices, kind: tuple[int, int],
    one: Array | None = None, two: Array | None = None,
) -> Found:  # fmt: skip
    along = np.zeros((len(of), 2, 3))
    if one is not None:
        along[:, 0] = one
    if two is not None:
        along[:, 1] = two
    kinds = np.repeat(np.array([kind]), len(of), axis=0)
    return Found(of, gaps, points, n, part, kinds, along)


class OnGround:
    """Shapes of one scene on one ground; not to be shared between threads."""

    def __init__(self, cores: Sequence[Core], surface: Surface) -> None:
        self._bones = [skeleton_of(core) for core in cores]
        self._surface, count = surface, len(cores)
        self._middles = np.array([bone.middle for bone in self._bones])
        self._halves = np.array([bone.half for bone in self._bones])
        self._radii = np.array([bone.radius for bone in self._bones])
        self._widths = np.array([bone.width for bone in self._bones])
        self._sizes = np.array([bone.size for bone in self._bones])
        self._low, self._high = np.full((count, 3), np.nan), np.full((count, 3), np.nan)
        self._known: list[list[Indices]] = [[np.zeros(0, dtype=np.int_)] * 3] * count
        self._reach = np.nan
        self._pairs: list[tuple[Indices, Indices]] = []

    def far(self, R: Array, p: Array) -> Found:
        """Contacts as `near` has them, from as far away as the nearest is."""
        reach, size = REACH, self._size(p)
        while True:
            found = self.near(R, p, reach)
            if reach > size or len({*found.of.tolist()}) == len(self._bones):
                return found
            reach *= 4.0

    def _size(self, p: Array) -> float:
        """Distance beyond which there is nothing [m]."""
        low, high = self._surface.bounds
        finite = np.abs(np.concatenate([low.ravel(), high.ravel(), p.ravel()]))
        return 4.0 * float(finite[np.isfinite(finite)].max(initial=1.0)) + 1.0

    def near(self, R: Array, p: Array, reach: float = REACH) -> Found:
        """Contacts of all shapes in turn, at rotations R (s, 3, 3) and places p (s, 3) [m]."""
        middles = np.matmul(R, self._middles[:, :, None])[:, :, 0] + p
        halves = np.matmul(np.abs(R), self._halves[:, :, None])[:, :, 0] + reach
        low, high = middles - halves, middles + halves
        self._look(low, high, reach)
        faces, edges, corners = self._reaching(low, high)
        faces = self._beside_planes(faces, middles, halves)
        rooms = _Rooms(self._bones, R, p, self._radii, self._widths)
        rooms.place(*(shapes for shapes, _ in (faces, edges, corners)))
        above, lowest = _above_faces(rooms, self._surface, *faces, reach)
        parts = [above]
        if len(edges[0]):
            parts += _across_edges(rooms, self._surface, *edges, lowest, reach)
        if len(corners[0]):
            parts += _at_corners(rooms, self._surface, *corners, reach)
        found = above
        if len(parts) > 1:
            found = Found(*map(np.concatenate, zip(*parts, strict=True)))
            found = found.taken(np.argsort(found.of, kind="stable"))
        if len(found.of):
            found = self._without_seams(found)
        return self._chosen(found)

    def _look(self, low: Array, high: Array, reach: float) -> None:
        """Keep what is near each shape, with some room to move."""
        inside = (self._low <= low) & (high <= self._high)
        if reach != self._reach:
            inside[:], self._reach = False, reach
        stale = np.flatnonzero(~inside.all(axis=1))
        if not len(stale):
            return
        for i in stale.tolist():
            self._low[i], self._high[i] = low[i] - _SLACK, high[i] + _SLACK
            self._known[i] = self._surface.near(self._low[i], self._high[i])
        self._pairs = []
        for kind in range(3):
            each = [known[kind] for known in self._known]
            shapes = np.repeat(np.arange(len(each)), [len(known) for known in each])
            self._pairs.append((shapes, np.concatenate(each)))

    def _reaching(self, low: Array, high: Array) -> list[tuple[Indices, Indices]]:
        """Shapes, and elements of the ground that reach into their boxes."""
        found = []
        for (shapes, elements), boxes in zip(self._pairs, self._surface.boxes, strict=True):
            near = boxes[elements]
            meets = ((near[:, 0] <= high[shapes]) & (near[:, 1] >= low[shapes])).all(axis=1)
            found.append((shapes[meets], elements[meets]))
        return found

    def _beside_planes(
        self, faces: tuple[Indices, Indices], middles: Array, halves: Array
    ) -> tuple[Indices, Indices]:
        """The faces whose planes reach into the boxes of the shapes."""
        shapes, elements = faces
        n = self._surface.normals[elements]
        above = (n * middles[shapes]).sum(axis=1) - self._surface.heights[elements]
        meets = above <= (np.abs(n) * halves[shapes]).sum(axis=1)
        return shapes[meets], elements[meets]

    def _without_seams(self, found: Found) -> Found:
        """Contacts without those that another part covers."""
        surface, hidden = self._surface, np.zeros(len(found.of), dtype=bool)
        if len(surface.solids) == 1:
            return found
        on_ground = found.points - found.gaps[:, None] * found.normals
        lows, highs = surface.bounds
        for part in {*found.part.tolist()}:
            beside = surface.beside(part, WIDTH)
            its = np.flatnonzero(found.part == part)
            x, n = on_ground[its], found.normals[its]
            low, high = x.min(axis=0) - 2 * WIDTH, x.max(axis=0) + 2 * WIDTH
            touch = ((lows[beside] <= high) & (highs[beside] >= low)).all(axis=1)
            for other in beside[touch].tolist():
                solid = surface.solids[other]
                assert solid is not None
                hidden[its] |= is_hidden(x, n, WIDTH, surface.solids[part], solid)
        return found.taken(~hidden) if hidden.any() else found

    def _chosen(self, found: Found) -> Found:
        """Contacts, each once, and of each shape no more than it has places."""
        places = np.concatenate([found.points, self._sizes[found.of][:, None] * found.normals], 1)
        kept: list[int] = []
        for s, its in _slices(found.of):
            bone, first = self._bones[s], its.start
            few = _fewer(found.gaps[its], places[its], bone.places, bone.size)
            kept += [first + i for i in few]
        return found.taken(np.array(kept, dtype=np.int_))


def _fewer(gaps: Array, places: Array, most: int, size: float) -> list[int]:
    """Numbers, each once, of the nearest contact and of those far apart or that look elsewhere."""
    if len(gaps) == 1:
        return [0]
    off = places[:, None] - places
    rows = np.round(np.sqrt(np.einsum("ijk,ijk->ij", off, off)), 9).tolist()  # few: lists are fast
    left: list[int] = []
    least = tolerances.ONE_POINT * size
    for i, row in enumerate(rows):
        if all(row[j] > least for j in left):
            left.append(i)
    if len(left) <= most:
        return left
    heights = np.round(gaps, 12).tolist()
    lowest = max(min(heights), 0.0)
    kept = [min(left, key=heights.__getitem__)]
    left.remove(kept[0])
    worth = {i: rows[kept[0]][i] for i in left}
    costs = {i: _STEEP * max(heights[i] - lowest, 0.0) for i in left}
    while len(kept) < most:
        best = max(left, key=lambda i: worth[i] - costs[i])
        kept.append(best)
        left.remove(best)
        row = rows[best]
        for i in left:
            if row[i] < worth[i]:
                worth[i] = row[i]
    return sorted(kept)


# How much further apart contacts have to be that are higher, as a factor.
_STEEP: Final = 50.0


class _Rooms:
    """Skeletons of shapes, and in the world the points of those that are near the ground."""

    def __init__(
        self, bones: Sequence[Skeleton], R: Array, p: Array, radii: Array, widths: Array
    ) -> None:
        self.bones, self.R, self.p, self.radii, self.widths = bones, R, p, radii, widths
        self.points: dict[int, Array] = {}

    def place(self, *shapes: Indices) -> None:
        """Place the points of some shapes."""
        for i in {*np.concatenate(shapes).tolist()}:
            self.points[i] = self.bones[i].points.dot(self.R[i].T) + self.p[i]


def _slices(shapes: Indices) -> list[tuple[int, slice]]:
    """Each shape, and where it is in a sorted list."""
    starts = np.flatnonzero(np.diff(shapes, prepend=-1))
    ends = [*starts.tolist(), len(shapes)]
    return [(int(shapes[a]), slice(a, b)) for a, b in pairwise(ends)]


def _above_faces(
    rooms: _Rooms, surface: Surface, shapes: Indices, faces: Indices, reach: float
) -> tuple[Found, _Separation]:
    """Lowest corners above faces, and how deep the shapes are in the ground beside them."""
    at, points = [], []
    depths = np.zeros(len(shapes))
    for s, its in _slices(shapes):
        bone, f = rooms.bones[s], faces[its]
        n = surface.normals[f]
        if bone.core.half_axes is None:
            P = rooms.points[s]
            H = P.dot(n.T) - surface.heights[f]
        else:
            placed = bone.core._replace(
                vertices=rooms.points[s].mean(axis=0, keepdims=True),
                half_axes=rooms.R[s].dot(bone.core.half_axes),
            )
            P = np.stack([lowest_points(placed, each) for each in n], axis=1)
            H = (P * n).sum(axis=2) - surface.heights[f]
        lowest = H.min(axis=0)
        depths[its] = lowest - bone.radius
        corner, face = np.nonzero((lowest + NEXT * bone.size >= H) & (reach + bone.radius >= H))
        at.append(its.start + face)
        points.append(P[corner] if bone.core.half_axes is None else P[corner, face])
    separation = _Separation(surface, shapes, faces, depths)
    if not at:
        return _found(*_none(), kind=(CORNER, FACE)), separation
    pair, x = np.concatenate(at), np.concatenate(points)
    f = faces[pair]
    over = (np.matmul(surface.sides[f], x[:, :, None])[:, :, 0] <= surface.limits[f]).all(axis=1)
    pair, x, f = pair[over], x[over], f[over]
    of, n = shapes[pair], surface.normals[f]
    radius = rooms.radii[of]
    gaps = (n * x).sum(axis=1) - surface.heights[f] - radius
    part = surface.part_of[0][f]
    found = _found(of, gaps, x - radius[:, None] * n, n, part, (CORNER, FACE))
    return separation.without_deeper(found, np.column_stack([f, surface.neighbours[f]])), separation


def _none() -> tuple[Indices, Array, Array, Array, Indices]:
    index = np.zeros(0, dtype=np.int_)
    return index, np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3)), index


class _Separation:
    """How deep a contact may be: twice the way out of the ground beside it.

    Beside a face of a convex part are all its faces, else those over its convex edges.
    """

    def __init__(self, surface: Surface, shapes: Indices, faces: Indices, above: Array) -> None:
        self._surface, self._above = surface, above
        self._shapes, self._faces = shapes, faces

    def without_deeper(self, found: Found, beside: Indices) -> Found:
        """Contacts (k,) without those that are too deep, with the faces `beside` them (k, n)."""
        if not (found.gaps < -_DEEPER).any():
            return found
        return found.taken(-found.gaps <= self._most(found.of, found.part, beside))

    def _most(self, shapes: Indices, parts: Indices, beside: Indices) -> Array:
        surface = self._surface
        keys = self._shapes * len(surface.normals) + self._faces  # rising
        wanted = shapes[:, None] * len(surface.normals) + beside
        local = np.where(beside >= 0, _at(keys, self._above, wanted), -np.inf)
        near = self._shapes * len(surface.solids) + surface.part_of[0][self._faces]
        groups, of = np.unique(near, return_inverse=True)
        highest = np.full(len(groups), -np.inf)
        np.maximum.at(highest, of.ravel(), self._above)
        of_part = _at(groups, highest, shapes * len(surface.solids) + parts)
        is_convex = np.array([solid is not None for solid in surface.solids])[parts]
        best = np.where(is_convex, of_part, local.max(axis=1))
        most = 2.0 * np.maximum(np.where(np.isfinite(best), -best, 0.0), 0.0) + _DEEPER
        return np.where(is_convex, most, np.minimum(most, _DEEPEST))


def _at(keys: Indices, values: Array, wanted: Indices) -> Array:
    """Values of rising keys; -inf for those that are not among them."""
    if not len(keys):
        return np.full(wanted.shape, -np.inf)
    place = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
    return np.where(keys[place] == wanted, values[place], -np.inf)


def _allowed_at_edges(n: Array, into: Array, beside: float = _BESIDE) -> NDArray[np.bool_]:
    """Flag of each normal (k, 3): an edge with the directions `into` (k, 2, 3) its faces has it."""
    return np.asarray((np.matmul(into, n[:, :, None])[:, :, 0] <= beside).all(axis=1))


def _across_edges(
    rooms: _Rooms, surface: Surface, shapes: Indices, edges: Indices, separation: _Separation,
    reach: float,
) -> list[Found]:  # fmt: skip
    """Edges of the shapes across edges of the ground, and their corners beside them."""
    crossing, beside, found = [], [], []
    for s, its in _slices(shapes):
        bone, e, P = rooms.bones[s], edges[its], rooms.points[s]
        if len(bone.ends):
            crossing.append(_crossing(bone, rooms.R[s], P, s, e, surface))
        if bone.core.half_axes is None:
            beside.append(_corners_beside(P, s, e, surface))
        else:
            on_rims, on = _on_rims(rooms, surface, s, e, reach)
            found.append(separation.without_deeper(on_rims, surface.faces_of_edges[on]))
    if crossing:
        found.append(_at_crossings(rooms, surface, crossing, separation, reach))
    if beside:
        found.append(_beside_edges(rooms, surface, beside, reach))
    return found


def _at_crossings(
    rooms: _Rooms, surface: Surface, pairs: Sequence[tuple[Any, ...]], separation: _Separation,
    reach: float,
) -> Found:  # fmt: skip
    """Edges a + s d of shapes, and the axes of capsules and cylinders, across b + t e."""
    of, on, a, d = (np.concatenate(each) for each in zip(*pairs, strict=True))
    b, e = surface.edges[on, 0], surface.edges[on, 1] - surface.edges[on, 0]
    off = a - b
    dd, ee, de = ((x * y).sum(axis=1) for x, y in ((d, d), (e, e), (d, e)))
    da, ea = (d * off).sum(axis=1), (e * off).sum(axis=1)
    area = dd * ee - de**2
    skew = area > tolerances.FLAT * dd * ee
    area = np.where(skew, area, 1.0)
    shares = np.array([de * ea - ee * da, dd * ea - de * da]) / area
    kept = skew & (np.abs(shares - 0.5) <= 0.5 + tolerances.ON_FACE).all(axis=0)
    of, on, a, d, b, e = (x[kept] for x in (of, on, a, d, b, e))
    x, y = a + shares[0, kept, None] * d, b + shares[1, kept, None] * e
    n = _outwards(unit_cross(d, e)[0], surface, on)
    r = rooms.widths[of]
    gaps = (n * (x - y)).sum(axis=1) - r
    along = lengths_of(d)[1], lengths_of(e)[1]
    part = surface.part_of[1][on]
    found = _found(of, gaps, x - r[:, None] * n, n, part, (EDGE, EDGE), *along)
    kept = _allowed_at_edges(n, surface.into[on], NEXT) & (gaps <= reach)
    return separation.without_deeper(found.taken(kept), surface.faces_of_edges[on[kept]])


def _outwards(n: Array, surface: Surface, edges: Indices) -> Array:
    """Normals (k, 3) or their opposites, out of the ground at edges."""
    out = surface.normals[surface.faces_of_edges[edges, 0]] - surface.into[edges].sum(axis=1)
    return np.where((n * out).sum(axis=1) < 0.0, -1.0, 1.0)[:, None] * n


def _corners_beside(
    P: Array, s: int, e: Indices, surface: Surface
) -> tuple[Indices, Indices, Array, Array]:
    """The corner of a shape that is nearest to each edge, both of a capsule, and the way there."""
    b, length, d = surface.edges[e, 0], surface.lengths[e], surface.along[e]
    away = P[:, None] - b
    share = (away * d).sum(axis=2)
    inner = np.abs(share - np.clip(share, 0.0, length)) <= _APART
    off = away - share[:, :, None] * d
    corner, edge = np.indices(share.shape).reshape(2, -1)
    if len(P) > 2:
        ends = away - np.clip(share, 0.0, length)[:, :, None] * d
        corner, edge = (ends**2).sum(axis=2).argmin(axis=0), np.arange(len(e))
    its = inner[corner, edge]
    corner, edge = corner[its], edge[its]
    return np.full(len(edge), s), e[edge], P[corner], off[corner, edge]


def _beside_edges(
    rooms: _Rooms, surface: Surface, pairs: Sequence[tuple[Any, ...]], reach: float
) -> Found:
    """Corners of shapes beside edges of the ground."""
    of, on, x, off = (np.concatenate(each) for each in zip(*pairs, strict=True))
    apart, n = lengths_of(off)
    r = rooms.radii[of]
    kept = (apart > _APART) & (apart - r <= reach) & _allowed_at_edges(n, surface.into[on])
    its = np.flatnonzero(kept)
    kept[its] = [_is_lowest(rooms, int(of[i]), x[i], n[i]) for i in its.tolist()]
    part, along = surface.part_of[1][on], surface.along[on]
    found = _found(of, apart - r, x - r[:, None] * n, n, part, (CORNER, EDGE), None, along)
    return found.taken(kept)


def _is_lowest(rooms: _Rooms, s: int, x: Array, n: Array) -> bool:
    """True if no corner of a shape is lower than x along n."""
    P = rooms.points[s]
    return bool((P - x).dot(n).min() >= -tolerances.ONE_POINT * rooms.bones[s].size)


def _crossing(
    bone: Skeleton, R: Array, P: Array, s: int, e: Indices, surface: Surface
) -> tuple[Indices, Indices, Array, Array]:
    """Pairs of an edge of a shape and one of the ground whose normals may be opposite.

    Those of an edge are an arc between the normals of its faces, across the edge: two arcs have to
    cross. The axis of a capsule or a cylinder has all normals across it.
    """
    i, j = np.indices((len(bone.ends), len(e))).reshape(2, -1)
    if len(bone.normals):
        d, n = surface.along[e].dot(R), surface.ends_of_arcs[e].dot(R)  # in the axes of the shape
        sides = bone.normals.dot(d.T)  # (faces, e)
        one, two = bone.beside.T
        i, j = np.nonzero(_may_cross(sides[one], sides[two]))
        kept = _may_cross(*(bone.along[i, None] * n[j]).sum(axis=2).T)
        i, j = i[kept], j[kept]
        across, _ = unit_cross(bone.along[i], d[j])
        across = (
            np.where((across * n[j].sum(axis=1)).sum(axis=1) < 0.0, -1.0, 1.0)[:, None] * across
        )
        kept = (across * (bone.normals[one[i]] + bone.normals[two[i]])).sum(axis=1) < 0.0
        i, j = i[kept], j[kept]
    a = P[bone.ends[i, 0]]
    return np.full(len(i), s), e[j], a, P[bone.ends[i, 1]] - a


def _may_cross(one: Array, two: Array) -> NDArray[np.bool_]:
    """Flag of each arc with these sines at its ends: it crosses zero, or one next to it does."""
    return np.asarray((one * two <= 0.0) | (np.minimum(np.abs(one), np.abs(two)) <= NEXT))


def _on_rims(
    rooms: _Rooms, surface: Surface, s: int, e: Indices, reach: float
) -> tuple[Found, Indices]:
    """Rims of a cylinder on edges of the ground, and which edges these are.

    f = |P (c + R u - b)|^2 / 2 with u = cos(a) x + sin(a) y and P across the edge; f' = 0 is a
    polynomial of degree four in z = exp(i a).
    """
    x, y, axis = rooms.R[s].dot(rooms.bones[s].core.half_axes).T  # as long as they are
    up, middle = lengths_of(axis[None])[1][0], rooms.points[s].mean(axis=0)
    b, d, length = surface.edges[e, 0], surface.along[e], surface.lengths[e]
    px, py = (v - d.dot(v)[:, None] * d for v in (x, y))
    xx, yy, xy = ((p * q).sum(axis=1) for p, q in ((px, px), (py, py), (px, py)))
    roots: list[tuple[int, float, float]] = []  # edge, side, angle
    for side in (1.0, -1.0):
        w = middle + side * axis - b
        wx, wy = (w * px).sum(axis=1), (w * py).sum(axis=1)
        # f' = -wx sin + wy cos + (yy - xx) / 2 sin 2a + xy cos 2a
        high, low = 0.5 * xy - 0.25j * (yy - xx), 0.5 * wy + 0.5j * wx
        for i in range(len(e)):
            z = np.roots([high[i], low[i], 0.0, np.conj(low[i]), np.conj(high[i])])
            z = z[np.abs(np.abs(z) - 1.0) < tolerances.FLAT]
            roots += [(i, side, angle) for angle in np.angle(z).tolist()]
    edges, sides, angles = np.reshape(roots, (-1, 3)).T
    k, cos, sin = edges.astype(np.int_), np.cos(angles), np.sin(angles)
    u = cos[:, None] * x + sin[:, None] * y
    a = middle + sides[:, None] * axis + u
    t = ((a - b[k]) * d[k]).sum(axis=1)
    n = _outwards(unit_cross(cos[:, None] * y - sin[:, None] * x, d[k])[0], surface, e[k])
    gaps = (n * (a - b[k])).sum(axis=1)
    is_lowest = ((n * u).sum(axis=1) <= _BESIDE) & (sides * n.dot(up) <= _BESIDE)
    kept = is_lowest & (t >= 0.0) & (t <= length[k]) & (np.abs(gaps) <= reach)
    kept &= _allowed_at_edges(n, surface.into[e[k]])
    part = surface.part_of[1][e[k]]
    found = _found(np.full(len(k), s), gaps, a, n, part, (EDGE, EDGE), None, d[k])
    return found.taken(kept), e[k[kept]]


def _at_corners(
    rooms: _Rooms, surface: Surface, shapes: Indices, corners: Indices, reach: float
) -> list[Found]:
    """Corners of the ground at the faces, edges and corners of shapes."""
    found = []
    for s, its in _slices(shapes):
        at = _at_solid if rooms.bones[s].core.half_axes is None else _at_cylinder
        near = at(rooms.bones[s], rooms.R[s], rooms.p[s], surface.corners[corners[its]])
        for height, n, kind, along, here in near:
            c = corners[its][here]
            x, of = surface.corners[c] + height[:, None] * n, np.full(len(c), s)
            contacts = _found(of, height, x, n, surface.part_of[2][c], (kind, CORNER), along)
            beside = NEXT if kind == FACE else _BESIDE
            leaves = np.matmul(surface.leaving[c], n[:, :, None]) <= beside
            kept = leaves.all(axis=(1, 2)) & (height <= reach) & (height >= -_DEEPEST)
            found.append(contacts.taken(kept))
    return found


# Heights of corners over features of a shape, normals, the kind of feature, its direction, and
# which of the corners these are.
_Near = tuple[Array, Array, int, Array | None, NDArray[np.bool_]]


def _at_solid(bone: Skeleton, R: Array, p: Array, x: Array) -> Iterator[_Near]:
    """Corners x of the ground at a polytope, or the core of a ball or a capsule."""
    local, outside = (x - p).dot(R), np.ones(len(x), dtype=bool)
    if len(bone.normals):
        H = local.dot(bone.normals.T) - bone.heights
        f = H.argmax(axis=1)
        height, m = H[np.arange(len(x)), f], bone.normals[f]
        over = (local - height[:, None] * m).dot(bone.normals.T) - bone.heights
        on_face = (over <= tolerances.ON_FACE * bone.size).all(axis=1)
        yield height[on_face], -m[on_face].dot(R.T), FACE, None, on_face
        outside = ~on_face & (height > 0.0)
    # the nearest place on edges, or on the only corner
    P, along = bone.points, np.zeros((1, 3))
    share, off = np.zeros((len(x), 1)), P - local[:, None]
    if len(bone.ends):
        a, along = P[bone.ends[:, 0]], P[bone.ends[:, 1]] - P[bone.ends[:, 0]]
        share = ((local[:, None] - a) * along).sum(axis=2) / (along**2).sum(axis=1)
        share = np.clip(share, 0.0, 1.0)
        off = a + share[:, :, None] * along - local[:, None]
    near = (off**2).sum(axis=2).argmin(axis=1)
    rows = np.arange(len(x))
    apart, n = lengths_of(off[rows, near].dot(R.T))
    outside &= apart > _APART
    inner = np.abs(share[rows, near] - 0.5) < 0.5
    d = lengths_of(along[near])[1].dot(R.T)
    for kind, its in ((EDGE, outside & inner & (len(bone.ends) > 0)), (CORNER, outside & ~inner)):
        yield apart[its] - bone.radius, n[its], kind, d[its] if kind == EDGE else None, its


def _at_cylinder(bone: Skeleton, R: Array, p: Array, x: Array) -> Iterator[_Near]:
    """Corners x of the ground at the side, the ends and the rims of a cylinder."""
    assert bone.core.half_axes is not None
    radius, _, half = lengths_of(bone.core.half_axes.T)[0].tolist()
    up = R.dot(lengths_of(bone.core.half_axes.T)[1][2])
    away = x - (R.dot(bone.middle) + p)
    along = away.dot(up)
    apart, out = lengths_of(away - along[:, None] * up)
    to_end = np.sign(along)[:, None] * up
    at_side, at_end = apart - radius, np.abs(along) - half
    is_side = at_side >= at_end
    height, m = np.maximum(at_side, at_end), np.where(is_side[:, None], out, to_end)
    inner = np.minimum(at_side, at_end) <= 0.0
    beside, to_rim = lengths_of(at_side[:, None] * out + at_end[:, None] * to_end)
    height, m = np.where(inner, height, beside), np.where(inner[:, None], m, to_rim)
    yield height, -m, FACE, None, np.ones(len(x), dtype=bool)
