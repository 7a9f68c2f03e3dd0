"""Contact points of shapes on a ground, of all shapes of a scene at once.

A shape is convex: corners, edges and faces with a round skin of radius r. A contact is a feature of
the shape above one of the ground, with a normal n that both may meet there,

    corner p above a face       n = n_f,              gap = n . p - height - r,      p lowest along n
    edge across an edge         n = +-(d_A x d_B),    gap = n . (a - b) - r
    corner p beside an edge     n = (p - x) / |p - x|,    gap = |p - x| - r
    corner x of the ground      n against the face that it is next to, or away from x

so that it is a nearest place of both, and a flat or hollow edge catches nothing. Where two are
inside each other, gaps that are deeper than the way out along the faces beside them do not count.

A cylinder is above a face with the lowest points of its rims along n; edges of the ground meet its
side as that of a capsule, and its rims, circles c + R u, where (c + R u - b) . u' = 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core import tolerances
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.contacts.ground import Surface
from condyn_pin.constraints.contacts.meetings import lowest_points
from condyn_pin.constraints.contacts.seams import WIDTH, is_hidden
from condyn_pin.constraints.contacts.shapes import Core, Indices, lengths_of, unit_cross

# Steps look for the ground this far around each shape: at 20 m/s it is a step of 1 ms [m].
REACH: Final = 0.02

# What is near is looked for again when a shape has moved by this [m].
_SLACK: Final = 0.05

# Corners that are higher than the lowest one of their shape by less are next to touch, as a share
# of its size.
NEXT: Final = 1e-2

# A contact may be deeper than the way out beside it by a factor of two, and this [m].
_DEEPER: Final = 1e-5

# How deep a contact of a part that is not convex may be: walls of meshes are thicker [m].
_DEEPEST: Final = 5e-3

# Sines up to which a normal is still one of those of an edge or a corner.
_BESIDE: Final = 1e-9

# Corners beside corners or edges have a normal from this distance on [m].
_APART: Final = 1e-9

BALL, CAPSULE, SOLID, CYLINDER = 4, 6, 8, 8  # the places of shapes

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


def places_of(core: Core) -> int:
    """How many contact points a shape may have on a ground."""
    if core.half_axes is not None:
        return CYLINDER
    return {1: BALL, 2: CAPSULE}.get(len(core.vertices), SOLID)


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
        (high - low) / 2.0, size, places_of(core),
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
        return Found(*[each[chosen] for each in self])


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

    def far(self, R: Array, p: Array) -> list[Found]:
        """Contacts as `near` has them, from as far away as the nearest is."""
        reach, size = REACH, self._size(p)
        while True:
            found = self.near(R, p, reach)
            if reach > size or all(len(its.of) for its in found):
                return found
            reach *= 4.0

    def _size(self, p: Array) -> float:
        """Distance beyond which there is nothing [m]."""
        low, high = self._surface.bounds
        finite = np.abs(np.concatenate([low.ravel(), high.ravel(), p.ravel()]))
        return 4.0 * float(finite[np.isfinite(finite)].max(initial=1.0)) + 1.0

    def near(self, R: Array, p: Array, reach: float = REACH) -> list[Found]:
        """Contact points of each shape, at rotations R (s, 3, 3) and places p (s, 3) [m]."""
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
            touch = (lows[beside] <= high).all(axis=1) & (highs[beside] >= low).all(axis=1)
            for other in beside[touch].tolist():
                solid = surface.solids[other]
                assert solid is not None
                hidden[its] |= is_hidden(x, n, WIDTH, surface.solids[part], solid)
        return found.taken(~hidden) if hidden.any() else found

    def _chosen(self, found: Found) -> list[Found]:
        """Contacts of each shape, each once, no more than it has places."""
        ends = np.searchsorted(found.of, np.arange(len(self._bones) + 1)).tolist()
        places = np.concatenate([found.points, self._sizes[found.of][:, None] * found.normals], 1)
        chosen = []
        for (first, last), bone in zip(pairwise(ends), self._bones, strict=True):
            its: Indices | slice = slice(first, last)
            if last - first > 1:
                its = first + _fewer(found.gaps[its], places[its], bone.places, bone.size)
            chosen.append(found.taken(its))
        return chosen


def _fewer(gaps: Array, places: Array, most: int, size: float) -> Indices:
    """Indices, each once, of the nearest contact and of those far apart or that look elsewhere."""
    places = places - places[0]
    squares = np.einsum("ij,ij->i", places, places)
    apart = squares[:, None] + squares - 2.0 * places.dot(places.T)
    apart = np.round(np.sqrt(np.maximum(apart, 0.0)), 7)
    again = np.tril(apart <= tolerances.ONE_POINT * size, -1).any(axis=1)
    if len(gaps) - again.sum() <= most:
        return np.flatnonzero(~again)
    gaps = np.round(gaps, 12)
    first = int(gaps.argmin())
    costs = _STEEP * np.maximum(gaps - max(gaps[first], 0.0), 0.0)
    costs[again], costs[first] = np.inf, np.inf
    kept, nearest = [first], apart[first]
    while len(kept) < most:
        kept.append(int((nearest - costs).argmax()))
        nearest, costs[kept[-1]] = np.minimum(nearest, apart[kept[-1]]), np.inf
    return np.sort(kept)


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
        corner, face = np.nonzero((H <= lowest + NEXT * bone.size) & (H <= reach + bone.radius))
        at.append(its.start + face)
        points.append(P[corner] if bone.core.half_axes is None else P[corner, face])
    separation = _Separation(surface, shapes, faces, depths)
    if not at:
        return _found(*_none(), kind=(CORNER, FACE)), separation
    pair, x = np.concatenate(at), np.concatenate(points)
    f = faces[pair]
    beside = np.matmul(surface.sides[f], x[:, :, None])[:, :, 0] - surface.ends[f]
    size = tolerances.ON_FACE * (1.0 + np.abs(surface.ends[f]))
    over = (beside <= surface.beyond[f] + size).all(axis=1)
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
        self._keys = shapes * len(surface.normals) + faces  # rising
        group = self._group(shapes, surface.part_of[0][faces])
        self._groups, of = np.unique(group, return_inverse=True)
        self._best = np.full(len(self._groups), -np.inf)
        np.maximum.at(self._best, of.ravel(), above)
        self._is_convex = np.array([solid is not None for solid in surface.solids])

    def _group(self, shapes: Indices, parts: Indices) -> Indices:
        return np.asarray(shapes * len(self._surface.solids) + parts)

    def without_deeper(self, found: Found, beside: Indices) -> Found:
        """Contacts (k,) without those that are too deep, with the faces `beside` them (k, n)."""
        if not (found.gaps < -_DEEPER).any():
            return found
        return found.taken(-found.gaps <= self._most(found.of, found.part, beside))

    def _most(self, shapes: Indices, parts: Indices, beside: Indices) -> Array:
        wanted = shapes[:, None] * len(self._surface.normals) + beside
        local = np.where(beside >= 0, _at(self._keys, self._above, wanted), -np.inf)
        of_part = _at(self._groups, self._best, self._group(shapes, parts))
        is_convex = self._is_convex[parts]
        best = np.where(is_convex, of_part, local.max(axis=1))
        most = 2.0 * np.maximum(np.where(np.isfinite(best), -best, 0.0), 0.0) + _DEEPER
        return np.where(is_convex, most, np.minimum(most, _DEEPEST))


def _at(keys: Indices, values: Array, wanted: Indices) -> Array:
    """Values of rising keys; -inf for those that are not among them."""
    if not len(keys):
        return np.full(wanted.shape, -np.inf)
    place = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
    return np.where(keys[place] == wanted, values[place], -np.inf)


def _allowed_at_edges(n: Array, into: Array) -> NDArray[np.bool_]:
    """Flag of each normal (k, 3): an edge with the directions `into` (k, 2, 3) its faces has it."""
    return np.asarray((np.matmul(into, n[:, :, None])[:, :, 0] <= _BESIDE).all(axis=1))


def _across_edges(
    rooms: _Rooms, surface: Surface, shapes: Indices, edges: Indices, separation: _Separation,
    reach: float,
) -> list[Found]:  # fmt: skip
    """Edges of the shapes across edges of the ground, and their corners beside them."""
    crossing, beside, rims = [], [], []
    for s, its in _slices(shapes):
        bone, e, P = rooms.bones[s], edges[its], rooms.points[s]
        b, end = surface.edges[e, 0], surface.edges[e, 1]
        length, d = lengths_of(end - b)
        if bone.core.half_axes is None:
            # the nearest corner, or both ends of a capsule
            away = P[:, None] - b
            share = (away * d).sum(axis=2)
            t = np.clip(share, 0.0, length)
            off = away - t[:, :, None] * d
            apart = (off**2).sum(axis=2)
            if len(P) > 2:
                k = apart.argmin(axis=0)
                rows = [(k, np.arange(len(e)))]
            else:
                rows = [(np.full(len(e), i), np.arange(len(e))) for i in range(len(P))]
            for corner, j in rows:
                inner = np.abs(share[corner, j] - t[corner, j]) <= _APART
                corner, j = corner[inner], j[inner]
                beside.append((s, e[j], P[corner], off[corner, j], d[j]))
        else:
            rims.append((s, e, b, length, d))
        if len(bone.ends):
            i, j = _crossing(bone, rooms.R[s], d, surface.into[e], surface, e)
            if len(i):
                a = P[bone.ends[i, 0]]
                crossing.append((s, e[j], a, P[bone.ends[i, 1]] - a, b[j], end[j] - b[j]))
    found = []
    if crossing:
        of = np.concatenate([np.full(len(each[1]), each[0]) for each in crossing])
        e, a, along_a, b, along_b = (
            np.concatenate([each[k] for each in crossing]) for k in range(1, 6)
        )
        dd, ee = (along_a**2).sum(axis=1), (along_b**2).sum(axis=1)
        de, off = (along_a * along_b).sum(axis=1), a - b
        da, ea = (along_a * off).sum(axis=1), (along_b * off).sum(axis=1)
        area = dd * ee - de**2
        skew = area > tolerances.FLAT * dd * ee
        area = np.where(skew, area, 1.0)
        s, t = (de * ea - ee * da) / area, (dd * ea - de * da) / area
        edge = tolerances.ON_FACE
        kept = skew & (s >= -edge) & (s <= 1 + edge) & (t >= -edge) & (t <= 1 + edge)
        of, e, a, along_a, b, along_b, s, t = (
            x[kept] for x in (of, e, a, along_a, b, along_b, s, t)
        )
        n, _ = unit_cross(along_a, along_b)
        up = surface.normals[surface.faces_of_edges[e, 0]]
        up = up - surface.into[e, 0] - surface.into[e, 1]  # between the faces, outwards
        n = np.where((n * up).sum(axis=1) < 0.0, -1.0, 1.0)[:, None] * n
        x, y = a + s[:, None] * along_a, b + t[:, None] * along_b
        gaps = (n * (x - y)).sum(axis=1)
        r = rooms.widths[of][:, None]
        kept = _allowed_at_edges(n, surface.into[e]) & (gaps - r[:, 0] <= reach)
        its = _found(
            of, gaps - r[:, 0], x - r * n, n, surface.part_of[1][e], (EDGE, EDGE),
            lengths_of(along_a)[1], lengths_of(along_b)[1],
        ).taken(kept)  # fmt: skip
        found.append(separation.without_deeper(its, surface.faces_of_edges[e[kept]]))
    if beside:
        of = np.concatenate([np.full(len(each[1]), each[0]) for each in beside])
        e, x, off, d = (np.concatenate([each[k] for each in beside]) for k in range(1, 5))
        apart, n = lengths_of(off)
        r = rooms.radii[of]
        kept = (apart > _APART) & (apart - r <= reach) & _allowed_at_edges(n, surface.into[e])
        its = np.flatnonzero(kept)
        kept[its] = [_is_lowest(rooms, of[i], x[i], n[i]) for i in its.tolist()]
        found.append(
            _found(
                of, apart - r, x - r[:, None] * n, n, surface.part_of[1][e], (CORNER, EDGE),
                None, d,
            ).taken(kept)  # fmt: skip
        )
    for each in rims:
        its, on = _on_rims(rooms, surface, *each, reach)
        found.append(separation.without_deeper(its, surface.faces_of_edges[on]))
    return found


def _is_lowest(rooms: _Rooms, s: int, x: Array, n: Array) -> bool:
    """True if no corner of a shape is lower than x along n."""
    P = rooms.points[s]
    return bool((P - x).dot(n).min() >= -tolerances.ONE_POINT * rooms.bones[s].size)


def _crossing(
    bone: Skeleton, R: Array, d: Array, into: Array, surface: Surface, e: Indices
) -> tuple[Indices, Indices]:
    """Pairs of edges of a shape and of the ground whose normals may be opposite: arcs that cross.

    Those of an edge of the shape lie between the normals of its faces, all across the edge.
    """
    if not len(bone.normals):  # a segment: every normal across it
        i, j = np.nonzero(np.ones((len(bone.ends), len(d)), dtype=bool))
        return i, j
    local = d.dot(R)
    sides = bone.normals.dot(local.T)  # (faces, e)
    one, two = bone.beside.T
    i, j = np.nonzero(sides[one] * sides[two] <= _BESIDE)
    # the arc of the ground, from one of its normals to the other, across the edge of the shape
    n_1 = surface.normals[surface.faces_of_edges[e, 0]]
    is_rim = (surface.into[e, 1] == -n_1).all(axis=1)
    n_2 = np.where(is_rim[:, None], -into[:, 0], surface.normals[surface.faces_of_edges[e, 1]])
    along = bone.along[i]
    first, last = (along * n_1.dot(R)[j]).sum(axis=1), (along * n_2.dot(R)[j]).sum(axis=1)
    kept = first * last <= _BESIDE
    i, j = i[kept], j[kept]
    if not len(i):
        return i, j
    # n = +-(d_A x d_B) of the ground, and -n between the faces of the shape
    n = np.cross(bone.along[i], local[j])
    up = (n_1 + n_2).dot(R)[j]
    n = np.where((n * up).sum(axis=1) < 0.0, -1.0, 1.0)[:, None] * n
    m_1, m_2 = bone.normals[one[i]], bone.normals[two[i]]
    kept = (n * (m_1 + m_2)).sum(axis=1) < 0.0
    return i[kept], j[kept]


def _on_rims(
    rooms: _Rooms, surface: Surface, s: int, e: Indices, b: Array, length: Array, d: Array,
    reach: float,
) -> tuple[Found, Indices]:  # fmt: skip
    """Rims of a cylinder on edges of the ground, and which edges these are.

    f = |P (c + R u - b)|^2 / 2 with u = cos(a) x + sin(a) y and P across the edge; f' = 0 is a
    polynomial of degree four in z = exp(i a).
    """
    bone, Q = rooms.bones[s], rooms.R[s].dot(rooms.bones[s].core.half_axes)
    x, y, axis = Q.T  # x, y as long as the radius
    up = lengths_of(axis[None])[1][0]
    centre = rooms.points[s].mean(axis=0)
    parts = []
    for sign in (1.0, -1.0):
        w = centre + sign * axis - b
        w = w - (w * d).sum(axis=1)[:, None] * d
        px, py = (v - d.dot(v)[:, None] * d for v in (x, y))
        wx, wy = (w * px).sum(axis=1), (w * py).sum(axis=1)
        xx, yy, xy = (px * px).sum(axis=1), (py * py).sum(axis=1), (px * py).sum(axis=1)
        # f' = -wx sin + wy cos + (yy - xx) / 2 sin 2a + xy cos 2a
        high, low = 0.5 * xy - 0.25j * (yy - xx), 0.5 * wy + 0.5j * wx
        for k in range(len(e)):
            z = np.roots([high[k], low[k], 0.0, np.conj(low[k]), np.conj(high[k])])
            z = z[np.abs(np.abs(z) - 1.0) < 1e-6]
            for angle in np.unique(np.round(np.angle(z), 9)):
                u = np.cos(angle) * x + np.sin(angle) * y
                a = centre + sign * axis + u
                t = float((a - b[k]).dot(d[k]))
                if not 0.0 <= t <= length[k]:
                    continue
                tangent = np.cos(angle) * y - np.sin(angle) * x
                n, _ = unit_cross(tangent[None], d[k][None])
                both = surface.faces_of_edges[e[k]]
                facing = surface.normals[both[0]] - surface.into[e[k]].sum(axis=0)
                n = n * np.where((n * facing).sum(axis=1) < 0.0, -1.0, 1.0)[:, None]
                gap = float(n[0].dot(a - b[k] - t * d[k]))
                lowest = n[0].dot(u) <= _BESIDE and sign * n[0].dot(up) <= _BESIDE
                if lowest and abs(gap) <= reach and _allowed_at_edges(n, surface.into[e[k]][None])[0]:
                    parts.append((gap, a, n[0], int(e[k]), d[k]))
    if not parts:
        return _found(*_none(), kind=(EDGE, EDGE)), np.zeros(0, dtype=np.int_)
    gaps, points, n, on, along = (np.array(each) for each in zip(*parts, strict=True))
    of, part = np.full(len(gaps), s), surface.part_of[1][on]
    return _found(of, gaps, points, n, part, (EDGE, EDGE), None, along), on


def _at_corners(
    rooms: _Rooms, surface: Surface, shapes: Indices, corners: Indices, reach: float
) -> list[Found]:
    """Corners of the ground at the faces, edges and corners of shapes."""
    found = []
    for s, its in _slices(shapes):
        bone, c = rooms.bones[s], corners[its]
        x = surface.corners[c]
        R, p = rooms.R[s], rooms.p[s]
        if bone.core.half_axes is not None:
            found.append(_at_cylinder(bone, R, p, x, s, surface, c, reach))
            continue
        local = (x - p).dot(R)
        on_face = np.zeros(len(x), dtype=bool)
        if len(bone.normals):
            H = local.dot(bone.normals.T) - bone.heights
            f = H.argmax(axis=1)
            height, m = H[np.arange(len(x)), f], bone.normals[f]
            foot = local - height[:, None] * m
            on_face = (
                foot.dot(bone.normals.T) - bone.heights <= tolerances.ON_FACE * bone.size
            ).all(axis=1)  # fmt: skip
            n = -m.dot(R.T)
            kept = on_face & (np.abs(height) <= reach) & _leaves(surface, c, n)
            kept &= -height <= _DEEPEST
            found.append(
                _found(
                    np.full(len(x), s), height, x + height[:, None] * n, n,
                    surface.part_of[2][c], (FACE, CORNER),
                ).taken(kept)  # fmt: skip
            )
        # the nearest place on edges, or on the only corner
        P = bone.points
        if len(bone.ends):
            a, b = P[bone.ends[:, 0]], P[bone.ends[:, 1]]
            along = b - a
            share = ((local[:, None] - a) * along).sum(axis=2) / (along**2).sum(axis=1)
            share = np.clip(share, 0.0, 1.0)
            off = a + share[:, :, None] * along - local[:, None]
        else:
            share, off, along = np.zeros((len(x), 1)), P - local[:, None], np.zeros((1, 3))
        near = (off**2).sum(axis=2).argmin(axis=1)
        rows = np.arange(len(x))
        apart, n = lengths_of(off[rows, near].dot(R.T))
        inner = (share[rows, near] > 0.0) & (share[rows, near] < 1.0)
        kept = ~on_face & (apart > _APART) & (apart - bone.radius <= reach)
        kept &= _leaves(surface, c, n)
        if len(bone.normals):  # x is outside
            kept &= H.max(axis=1) > 0.0
        for is_edge in (True, False):
            kind = (EDGE if is_edge else CORNER, CORNER)
            found.append(
                _found(
                    np.full(len(x), s), apart - bone.radius,
                    x + (apart - bone.radius)[:, None] * n, n, surface.part_of[2][c], kind,
                    lengths_of(along[near])[1].dot(R.T) if is_edge else None,
                ).taken(kept & (inner == is_edge))  # fmt: skip
            )
    return found


def _leaves(surface: Surface, c: Indices, n: Array) -> NDArray[np.bool_]:
    """Flag of each normal (k, 3): the corner has it."""
    return np.asarray((np.matmul(surface.leaving[c], n[:, :, None]) <= _BESIDE).all(axis=(1, 2)))


def _at_cylinder(
    bone: Skeleton, R: Array, p: Array, x: Array, s: int, surface: Surface, c: Indices,
    reach: float,
) -> Found:  # fmt: skip
    """Corners of the ground at the side, the ends and the rims of a cylinder."""
    assert bone.core.half_axes is not None
    radius, _, half = lengths_of(bone.core.half_axes.T)[0].tolist()
    up = R.dot(lengths_of(bone.core.half_axes.T)[1][2])
    away = x - (R.dot(bone.middle) + p)
    along = away.dot(up)
    off = away - along[:, None] * up
    apart, out = lengths_of(off)
    at_side, at_end = apart - radius, np.abs(along) - half
    is_side = at_side >= at_end
    height = np.where(is_side, at_side, at_end)
    m = np.where(is_side[:, None], out, np.sign(along)[:, None] * up)
    inner = np.where(is_side, at_end, at_side) <= 0.0
    # the nearest place is on a rim
    to_rim = np.maximum(at_side, 0.0)[:, None] * out
    to_rim += (np.sign(along) * np.maximum(at_end, 0.0))[:, None] * up
    beside, to_rim = lengths_of(to_rim)
    height, m = np.where(inner, height, beside), np.where(inner[:, None], m, to_rim)
    kept = (inner | (beside > _APART)) & (height <= reach) & (height >= -_DEEPEST)
    return _found(
        np.full(len(x), s), height, x - height[:, None] * m, -m, surface.part_of[2][c],
        (FACE, CORNER),
    ).taken(kept & _leaves(surface, c, -m))  # fmt: skip
