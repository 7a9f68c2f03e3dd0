"""Pairs of bodies of a scene, each with a fixed number of places for the points where they meet.

A place without a point has an infinite gap, and the rows of the last one that has.

For steps, shapes that are further apart than their own sizes are taken for the balls round them,
whose gap is a bound from below: features are looked for where it is worth while. And what is
covered at the seam of two pieces of one body is no contact, but has an infinite gap. Pairs that are
`exact` have distances instead, each as if it were alone.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.joints import z_along
from condyn_pin.constraints.contacts.bound import Pair
from condyn_pin.constraints.contacts.cores import Core, lengths_of
from condyn_pin.constraints.contacts.meetings import Meetings, meetings
from condyn_pin.constraints.contacts.placements import Placements
from condyn_pin.constraints.contacts.seams import Piece
from condyn_pin.constraints.contacts.touches import columns, relative_rows
from condyn_pin.constraints.with_world import plane


class Pairs:
    """Pairs of shapes of one model, evaluated together; not to be shared between threads.

    Parameters
    ----------
    model : pin.Model
    pairs : sequence of Pair
    exact : bool
        Whether gaps are distances, also far away and at seams.

    Attributes
    ----------
    size : int
        Number of places of all pairs, k.
    """

    def __init__(self, model: Any, pairs: Sequence[Pair], *, exact: bool = False) -> None:
        self._pairs = tuple(pairs)
        self._distances = [Distance(pair) for pair in pairs] if exact else []
        self._pieces = [()] * len(pairs) if exact else [*pieces_of(pairs)]
        self.size = sum(pair.points for pair in pairs)
        rows = [
            columns(model, pair.joint) - columns(model, pair.ground)
            for pair in pairs
            for _ in range(3 * pair.points)
        ]
        self._moves = np.reshape(rows, (3 * self.size, model.nv))
        self._placements = Placements(j for pair in pairs for j in (pair.joint, pair.ground))
        # columns: the middles of the shapes, two a pair
        self._middles = np.zeros((self._placements.size, 2 * len(pairs)))
        for i, pair in enumerate(pairs):
            for column, joint, at in (
                (2 * i, pair.joint, pair.placement),
                (2 * i + 1, pair.ground, pair.ground_placement),
            ):
                self._middles[self._placements.rows(joint), column] = (*at.translation, 1.0)
        self._reaches = np.array([pair.shape.reach + pair.ground_shape.reach for pair in pairs])
        self._at = np.full((3, self._placements.size), np.nan)
        self._found: tuple[Array, Array, Array] = np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3, 3))
        self._far = np.zeros(len(pairs), bool)

    def gaps(self, data: Any) -> Array:
        """Return the gaps (k,) [m]; reads data.oMi."""
        return self._evaluated(data)[0]

    def points(self, data: Any) -> Array:
        """Return the contact points (k, 3) [m]."""
        return self._evaluated(data)[1]

    def axes(self, data: Any) -> Array:
        """Return t1, t2, n of each place as columns (k, 3, 3)."""
        return self._evaluated(data)[2]

    def are_balls(self, data: Any) -> NDArray[np.bool_]:
        """Return which pairs are so far apart that the balls round their shapes meet instead."""
        self._evaluated(data)
        return self._far

    def jacobian(self, data: Any) -> Array:
        """Return the rows t1, t2, n of each place (3 k, nv); reads data.oMi and data.J."""
        _, points, axes = self._evaluated(data)
        J = data.J.reshape(6, -1)  # a single column comes as a vector
        return relative_rows(points.T, axes.transpose(1, 0, 2).reshape(3, -1), J, self._moves)

    def _evaluated(self, data: Any) -> tuple[Array, Array, Array]:
        """Return gaps, points and axes; the last ones where no body has moved since."""
        now = self._placements.read(data)
        if not np.array_equal(now, self._at):
            middles = now.dot(self._middles).T.reshape(-1, 2, 3)
            apart, normals = lengths_of(middles[:, 0] - middles[:, 1])
            self._far = apart > 2.0 * self._reaches
            found = [
                self._far_away(i, data, middles[i, 0], normals[i], apart[i] - self._reaches[i])
                if self._far[i]
                else self._closely(i, data)
                for i in range(len(self._pairs))
            ]
            filled = map(_filled, found, (pair.points for pair in self._pairs))
            gaps, points, normals = (np.concatenate(parts) for parts in zip(*filled, strict=True))
            self._found = gaps, points, np.array([plane(n, 0.0).rotation for n in normals])
            self._at[:] = now
        return self._found

    def _far_away(self, i: int, data: Any, middle: Array, normal: Array, gap: float) -> Meetings:
        """Return where two shapes are nearest, or the balls round them: most pairs are far."""
        if self._distances:
            return self._distances[i](data)
        point = middle - self._pairs[i].shape.reach * normal
        return Meetings(np.array([gap]), point[None], normal[None])

    def _closely(self, i: int, data: Any) -> Meetings:
        """Return where the features of two shapes meet; what seams hide is infinitely far."""
        pair = self._pairs[i]
        A, B = data.oMi[pair.joint], data.oMi[pair.ground]
        found = meetings(
            pair.shape.placed(A * pair.placement),
            pair.ground_shape.placed(B * pair.ground_placement),
        )
        if self._pieces[i]:
            n, hidden = found.normals, np.zeros(len(found.gaps), dtype=bool)
            on_ground = found.points - found.gaps[:, None] * n
            sides = (A, found.points, -n), (B, on_ground, n)
            for piece, (at, x, outwards) in zip(self._pieces[i], sides, strict=True):
                local = (x - at.translation).dot(at.rotation)
                hidden |= piece.hides(local, outwards.dot(at.rotation))
            found.gaps[hidden] = np.inf
        return found


class Distance:
    """The distance of two shapes that are far apart, by coal, to 1e-10 m."""

    def __init__(self, pair: Pair) -> None:
        self._pair = pair
        self._made: tuple[Any, ...] = ()

    def __call__(self, data: Any) -> Meetings:
        """Return where they are nearest; reads data.oMi."""
        import coal

        pair = self._pair
        if not self._made:
            request = coal.DistanceRequest()
            request.gjk_tolerance = request.epa_tolerance = tolerances.CLOSED
            self._made = (*_coal_shape(pair.shape), *_coal_shape(pair.ground_shape), request)
        one, on_one, two, on_two, request = self._made
        places = (
            data.oMi[pair.joint] * pair.placement * on_one,
            data.oMi[pair.ground] * pair.ground_placement * on_two,
        )
        at, beside = (coal.Transform3s(each.rotation, each.translation) for each in places)
        found = coal.DistanceResult()
        gap = coal.distance(one, at, two, beside, request, found)
        return Meetings(np.array([gap]), found.getNearestPoint1()[None], -found.normal[None])


def _coal_shape(core: Core) -> tuple[Any, Any]:
    """Return a shape for coal, and its placement on ours."""
    import coal

    if core.is_point:
        return coal.Sphere(core.radius), pin.SE3(np.eye(3), core.vertices[0])
    if core.is_solid:
        corners = coal.StdVec_Vec3s()
        corners.extend(core.vertices)
        return coal.Convex.convexHull(corners, True, "Qt"), pin.SE3.Identity()
    (length,), axis = lengths_of(core.vertices[:1] - core.vertices[1:])
    at = pin.SE3(z_along(axis[0]), core.vertices.mean(axis=0))
    return coal.Capsule(core.radius, length), at


def pieces_of(pairs: Sequence[Pair]) -> Iterator[tuple[Piece, ...]]:
    """Yield both shapes of each pair as pieces of their bodies; nothing where these have no seams.

    What is beside a piece counts where it meets the same other body.
    """
    groups: dict[tuple[int, int], list[tuple[Core, Core]]] = {}
    for pair in pairs:
        cores = pair.shape.placed(pair.placement), pair.ground_shape.placed(pair.ground_placement)
        groups.setdefault((pair.joint, pair.ground), []).append(cores)
    order = {bodies: iter(cores) for bodies, cores in groups.items()}
    for pair in pairs:
        bodies = pair.joint, pair.ground
        sides = zip(next(order[bodies]), zip(*groups[bodies], strict=True), strict=True)
        pieces = tuple(Piece(core, cores) for core, cores in sides)
        yield pieces if any(piece.has_seams for piece in pieces) else ()


def _filled(found: Meetings, points: int) -> Meetings:
    """Return what was found, and places without a point behind it."""
    count = len(found.gaps)
    filled = found.taken(np.minimum(np.arange(points), count - 1))
    filled.gaps[count:] = np.inf
    return filled
