"""Contact candidates of a scene, evaluated together: gaps, contact points and rows.

Cones come first, three rows (t1, t2, n) each, with n from the ground to the robot: those on planes,
and then those of pairs of bodies. Then come half-lines,
the ends of the ranges of joints, +1 at a lower end and -1 at an upper one, and cables; then
intervals, the dry friction of joints. For each cone and half-line d gap/dt is its row of J v along
the normal.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from copy import copy
from functools import cached_property
from itertools import accumulate
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array, Indices, read_only
from condyn_pin._core.models import frames_along, z_along
from condyn_pin.constraints.contacts.meetings import NEXT, REACH, ContactPoints, meetings
from condyn_pin.constraints.contacts.seams import Piece
from condyn_pin.constraints.contacts.shapes import Core, lengths_of
from condyn_pin.constraints.contacts.touches import (
    BoundContact,
    GroundContacts,
    Pair,
    Placements,
    PlaneContact,
    PlaneContacts,
    columns,
    relative_rows,
)
from condyn_pin.constraints.rows.cables import Lines

if TYPE_CHECKING:
    from condyn_pin.constraints.contacts.on_ground import Found


class Candidates:
    """Contact candidates of one model; not to be shared between threads.

    Parameters
    ----------
    model : pin.Model
    bounds : sequence of BoundContact
    exact : bool
        Whether gaps of pairs of shapes are distances wherever they are, as a reader of gaps wants
        them. Steps do with bounds where shapes are far apart, and without what seams hide.

    Attributes
    ----------
    names : tuple of str
        Of cones, half-lines and intervals.
    cones, half_lines, intervals : int
        How many there are.
    contact_points : int
        How many of the cones, the first ones, are on planes.
    several : tuple of slice
        The cones of each pair of shapes that meet in more points than one.
    on_ground : (cones,) bool array
        Which cones are between a shape and a `Ground`.
    friction, restitution : (cones,) array
        Coefficients [1].
    limits : (intervals,) array
        The largest dry friction [N m, N].
    is_length : (cones + half_lines,) bool array
        Which gaps are lengths [m]; the others are angles [rad].
    blocks : (rows,) array of int
        Which candidate each row belongs to.
    row_names : tuple of str
        ``name.t1``, ``name.t2``, ``name.n`` of a cone, the name of the others.

    Notes
    -----
    Gaps and rows of four points on planes of the world take 8 us, two boxes on each other 0.3 ms.
    """

    def __init__(self, model: Any, bounds: Sequence[BoundContact], *, exact: bool = False) -> None:
        self._made_of = model, bounds
        touches = [touch for bound in bounds for touch in bound.touches]
        pairs = [pair for bound in bounds for pair in bound.pairs]
        stops = [stop for bound in bounds for stop in bound.stops]
        lines = [each for bound in bounds for each in bound.lines]
        dry = [each for bound in bounds for each in bound.dry]
        # a pair has several cones
        cones: list[PlaneContact | Pair] = [*touches]
        cones += [pair for pair in pairs for _ in range(pair.points)]
        self.cones, self.half_lines, self.intervals = len(cones), len(stops) + len(lines), len(dry)
        of_cones = (*(touch.name for touch in touches),
                    *(name for pair in pairs for name in pair.candidates))  # fmt: skip
        others = [stop.name for stop in stops] + [line.name for line in lines]
        others += [each.name for each in dry]
        self.names = (*of_cones, *others)
        self.row_names = (*(f"{name}.{axis}" for name in of_cones for axis in _AXES), *others)
        self.several = tuple(_cones_of_patches(pairs, len(touches)))
        self.on_ground = np.array(
            [isinstance(e, Pair) and e.surface is not None for e in cones], bool
        )
        self.friction = read_only(np.array([each.friction for each in cones]))
        self.restitution = read_only(np.array([each.restitution for each in cones]))
        self.limits = read_only(np.array([each.limit for each in dry]))
        of_stops = [*(stop.is_length for stop in stops), *(True for _ in lines)]
        self.is_length = read_only(np.array([True] * len(cones) + of_stops, dtype=bool))
        kind = PlaneContacts if any(touch.ground for touch in touches) else GroundContacts
        self._touches, self._pairs = kind(model, touches), Pairs(model, pairs, exact=exact)
        self.contact_points = len(touches)
        self._lines = Lines(model, [each.line for each in lines]) if lines else None
        self._stops, curved = len(stops), (len(touches), self.cones + len(stops))
        # gaps whose paths bend in closed form: those over planes, and cables
        self.curved: Indices | slice = slice(0, curved[0])
        self.curved_rows: Indices | slice = slice(2, 3 * curved[0], 3)  # their rates in J
        if lines:
            self.curved = np.array([*range(curved[0]), *range(curved[1], curved[1] + len(lines))])
            self.curved_rows = self.normals[self.curved]
        self._iq = np.array([stop.iq for stop in stops], dtype=np.int_)
        self._sign = np.array([stop.sign for stop in stops])
        self._limit = np.array([stop.limit for stop in stops])
        self._coordinates = np.zeros((len(stops) + len(dry), model.nv))
        for row, stop in enumerate(stops):
            self._coordinates[row, stop.iv] = stop.sign
        for row, each in enumerate(dry, start=len(stops)):
            self._coordinates[row, each.iv] = 1.0
        self._sizes = np.repeat((3, 1), (self.cones, len(others)))
        self.blocks = read_only(np.repeat(np.arange(len(self.names)), self._sizes))

    def with_coefficients(self, friction: Array, restitution: Array) -> Candidates:
        """Candidates with other coefficients, one for each cone; memory is shared."""
        other = copy(self)
        other.friction, other.restitution = read_only((friction, restitution))
        return other

    @cached_property
    def exact(self) -> Candidates:
        """Candidates whose gaps of pairs are exact distances."""
        return Candidates(*self._made_of, exact=True)

    @property
    def rows(self) -> int:
        """Number of rows of all candidates."""
        return len(self.row_names)

    def gaps(self, data: Any, q: Array) -> Array:
        """Return the gaps of cones and half-lines [m, rad]; reads data.oMi at q."""
        gaps = self._touches.gaps(data)
        if self._pairs.size:
            gaps = np.concatenate((gaps, self._pairs.gaps(data)))
        return self._with_lines(self._with_stops(gaps, q), data, q)

    def curved_gaps(self, data: Any, q: Array) -> Array:
        """Gaps that are `curved` (k,) [m]; reads data.oMi at q."""
        gaps = self._touches.gaps(data)
        return gaps if self._lines is None else np.concatenate((gaps, self._lines.gaps(data, q)))

    def curved_normals(self, data: Any) -> Array:
        """Rates of gaps that are `curved` (k, nv); reads data.oMi and data.J."""
        J = self._touches.rows(data)[2::3]
        return J if self._lines is None else np.concatenate((J, self._lines.rows(data)))

    def evaluate(self, data: Any, q: Array) -> tuple[Array, Array]:
        """Return gaps as `gaps` does, and the rows of all candidates (rows, nv).

        Parameters
        ----------
        data : pin.Data
            With data.oMi and data.J at q: after `pin.computeJointJacobians`.
        q : (nq,) array
            Configuration [rad, m].
        """
        gaps, J = self._touches.evaluate(data)
        if self._pairs.size:
            gaps = np.concatenate((gaps, self._pairs.gaps(data)))
            J = np.concatenate((J, self._pairs.jacobian(data)))
        if self._lines is not None:
            stops, dry = np.split(self._coordinates, [self._stops])
            J = np.concatenate((J, stops, self._lines.rows(data), dry))
        elif len(self._coordinates):
            J = np.concatenate((J, self._coordinates))
        gaps = self._with_stops(gaps, q)
        return self._with_lines(gaps, data, q), J

    def drift(self, data: Any) -> Array:
        """Return Jdot v of all rows (rows,) [m/s^2], where no shapes of two bodies meet.

        Reads what forward kinematics with a = 0 leaves in data.
        """
        assert not self.pairs, "the points where shapes meet have no closed form"
        of_cones = self._touches.drift(data)
        lines = np.zeros(0) if self._lines is None else self._lines.drift(data)
        dry = np.zeros(self.intervals)
        return np.concatenate((of_cones, np.zeros(self._stops), lines, dry))

    @property
    def pairs(self) -> int:
        """Number of cones between shapes of two bodies; they are the last ones."""
        return self.cones - self.contact_points

    def _with_stops(self, gaps: Array, q: Array) -> Array:
        if not self._stops:
            return gaps
        return np.concatenate((gaps, self._sign * (q[self._iq] - self._limit)))

    def _with_lines(self, gaps: Array, data: Any, q: Array) -> Array:
        return gaps if self._lines is None else np.concatenate((gaps, self._lines.gaps(data, q)))

    @property
    def normals(self) -> NDArray[np.int_]:
        """The rows along which gaps change, of cones and half-lines."""
        lines = 3 * self.cones + np.arange(self.half_lines)
        return np.concatenate((np.arange(2, 3 * self.cones, 3), lines))

    def rows_of(self, active: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Flag of each row: its candidate is active."""
        return np.repeat(active, self._sizes)

    def points(self, data: Any, q: Array) -> Array:
        """Return the contact point of each cone in the world (cones, 3) [m]."""
        points = self._touches.points(data)
        return np.concatenate((points, self._pairs.points(data))) if self._pairs.size else points

    def axes(self, data: Any, q: Array) -> Array:
        """Return t1, t2 and n of each cone in the world, as columns (cones, 3, 3)."""
        axes = self._touches.axes(data)
        return np.concatenate((axes, self._pairs.axes(data))) if self._pairs.size else axes


def _cones_of_patches(pairs: Sequence[Pair], first: int) -> Iterator[slice]:
    """Yield the cones of pairs that meet in several points; `first` is the first of all pairs."""
    for pair in pairs:
        if pair.points > 1:
            yield slice(first, first + pair.points)
        first += pair.points


_AXES = ("t1", "t2", "n")


# Pairs of bodies of a scene, each with a fixed number of places for the points where they meet.
#
# A place without a point has an infinite gap, and the rows of the last one that has.
#
# For steps, shapes that are further apart than their own sizes are taken for the balls round them,
# whose gap is a bound from below: features are looked for where it is worth while. And what is
# covered at the seam of two pieces of one body is no contact, but has an infinite gap. Pairs that
# are `exact` have distances instead, each as if it were alone.


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
        self._between = [i for i, pair in enumerate(pairs) if pair.surface is None]
        self._counts = [pair.points for pair in pairs]
        self._starts = [0, *accumulate(self._counts)]
        self.size = self._starts[-1]
        self._on_grounds = on_grounds(pairs, self._starts, exact=exact)
        shapes: dict[int, tuple[Any, Any]] = {}
        self._exact, self._distances = exact, [Distance(pair, shapes) for pair in pairs]
        self._pieces = [()] * len(pairs) if exact else [*pieces_of(pairs)]
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
        """Flag of each pair: so far apart that bounding balls replace the shapes."""
        self._evaluated(data)
        return self._far

    def features(self, data: Any) -> dict[int, Found]:
        """Features that meet, of each pair with a ground; by the number of the pair."""
        self._evaluated(data)
        return {i: its for shapes in self._on_grounds for i, its in shapes.features}

    def jacobian(self, data: Any) -> Array:
        """Return the rows t1, t2, n of each place (3 k, nv); reads data.oMi and data.J."""
        _, points, axes = self._evaluated(data)
        J = data.J.reshape(6, -1)  # a single column comes as a vector
        return relative_rows(points.T, axes.transpose(1, 0, 2).reshape(3, -1), J, self._moves)

    def _evaluated(self, data: Any) -> tuple[Array, Array, Array]:
        """Gaps, points and axes; reused if no body has moved."""
        now = self._placements.read(data)
        if not np.array_equal(now, self._at):
            middles = now.dot(self._middles).T.reshape(-1, 2, 3)
            apart, normals = lengths_of(middles[:, 0] - middles[:, 1])
            self._far = apart > 2.0 * self._reaches
            gaps = np.full(self.size, np.inf)
            points, n = np.zeros((self.size, 3)), np.tile((0.0, 0.0, 1.0), (self.size, 1))
            for i in self._between:
                far = middles[i, 0], normals[i], apart[i] - self._reaches[i]
                its = self._far_away(i, data, *far) if self._far[i] else self._closely(i, data)
                first, last, filled = (
                    self._starts[i],
                    self._starts[i + 1],
                    its.filled(self._counts[i]),
                )
                gaps[first:last], points[first:last], n[first:last] = filled
            for shapes in self._on_grounds:
                here, on = shapes.evaluate(data)
                gaps[here], points[here], n[here] = on.gaps, on.points, on.normals
            self._found = gaps, points, frames_along(n)
            self._at[:] = now
        return self._found

    def _far_away(
        self, i: int, data: Any, middle: Array, normal: Array, gap: float
    ) -> ContactPoints:
        """Nearest points of two shapes, or of their bounding balls: most pairs are far apart."""
        if self._exact:
            return self._distances[i](data)
        point = middle - self._pairs[i].shape.reach * normal
        return ContactPoints(np.array([gap]), point[None], normal[None])

    def _closely(self, i: int, data: Any) -> ContactPoints:
        """Contact points of the features of two shapes; hidden ones have infinite gaps."""
        pair = self._pairs[i]
        A, B = data.oMi[pair.joint], data.oMi[pair.ground]
        is_fine = pair.shape.is_fine or pair.ground_shape.is_fine
        if is_fine and (nearest := self._distances[i](data)).gaps[0] > REACH:
            return nearest
        one = pair.shape.placed(A * pair.placement)
        two = pair.ground_shape.placed(B * pair.ground_placement)
        if is_fine:  # the features that are next to touch
            n = nearest.normals[0]
            one, two = (
                core.lowest_part(axis, NEXT * core.size) if core.is_fine else core
                for core, axis in ((one, n), (two, -n))
            )
        found = meetings(one, two)
        if self._pieces[i]:
            n, hidden = found.normals, np.zeros(len(found.gaps), dtype=bool)
            on_ground = found.points - found.gaps[:, None] * n
            sides = (A, found.points, -n), (B, on_ground, n)
            for piece, (at, x, outwards) in zip(self._pieces[i], sides, strict=True):
                local = (x - at.translation).dot(at.rotation)
                hidden |= piece.hides(local, outwards.dot(at.rotation))
            found.gaps[hidden] = np.inf
        return found


class ShapesOnGround:
    """Pairs of shapes with one ground; not to be shared between threads.

    Attributes
    ----------
    found : Found
        Contacts of the last evaluation.
    """

    found: Found

    def __init__(
        self, pairs: Sequence[Pair], its: Sequence[int], starts: Sequence[int], *, exact: bool
    ) -> None:
        from condyn_pin.constraints.contacts.on_ground import OnGround

        self._its, self._exact, mine = its, exact, [pairs[i] for i in its]
        assert mine[0].surface is not None
        self._contacts = OnGround([pair.shape for pair in mine], mine[0].surface)
        self._joints = [pair.joint for pair in mine]
        self._R = np.array([pair.placement.rotation for pair in mine])
        self._p = np.array([pair.placement.translation for pair in mine])
        self._starts = np.array([starts[i] for i in its])

    @property
    def features(self) -> Iterator[tuple[int, Found]]:
        """Number of each pair, and its contacts in the last evaluation."""
        for k, i in enumerate(self._its):
            yield i, self.found.taken(self.found.of == k)

    def evaluate(self, data: Any) -> tuple[Indices, Found]:
        """Places of the contacts among those of all pairs, and the contacts; reads data.oMi."""
        at = {j: data.oMi[j] for j in {*self._joints}}
        R = np.array([at[j].rotation for j in self._joints])
        p = np.array([at[j].translation for j in self._joints])
        placed = R @ self._R, np.matmul(R, self._p[:, :, None])[:, :, 0] + p
        self.found = (self._contacts.far if self._exact else self._contacts.near)(*placed)
        of = self.found.of
        return self._starts[of] + np.arange(len(of)) - np.searchsorted(of, of), self.found


def on_grounds(
    pairs: Sequence[Pair], starts: Sequence[int], *, exact: bool
) -> list[ShapesOnGround]:
    """Shapes on each ground of some pairs."""
    groups: dict[int, list[int]] = {}
    for i, pair in enumerate(pairs):
        if pair.surface is not None:
            groups.setdefault(id(pair.surface), []).append(i)
    return [ShapesOnGround(pairs, its, starts, exact=exact) for its in groups.values()]


class Distance:
    """Distance of two shapes by coal, to 1e-10 m."""

    def __init__(self, pair: Pair, shapes: dict[int, tuple[Any, Any]]) -> None:
        self._pair, self._shapes = pair, shapes  # those of coal, by the core that they are of
        self._made: tuple[Any, ...] = ()

    def _shape(self, core: Core) -> tuple[Any, Any]:
        if id(core) not in self._shapes:
            self._shapes[id(core)] = _coal_shape(core)
        return self._shapes[id(core)]

    def __call__(self, data: Any) -> ContactPoints:
        """Nearest points of the two shapes; reads data.oMi."""
        import coal

        pair = self._pair
        if not self._made:
            request = coal.DistanceRequest()
            request.gjk_tolerance = request.epa_tolerance = tolerances.CLOSED
            self._made = (*self._shape(pair.shape), *self._shape(pair.ground_shape), request)
        one, on_one, two, on_two, request = self._made
        places = (
            data.oMi[pair.joint] * pair.placement * on_one,
            data.oMi[pair.ground] * pair.ground_placement * on_two,
        )
        at, beside = (coal.Transform3s(each.rotation, each.translation) for each in places)
        found = coal.DistanceResult()
        gap = coal.distance(one, at, two, beside, request, found)
        return ContactPoints(np.array([gap]), found.getNearestPoint1()[None], -found.normal[None])


def _coal_shape(core: Core) -> tuple[Any, Any]:
    """Shape for coal, and its placement on ours."""
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
    """Yield both shapes of each pair as pieces of their bodies; nothing for shapes without seams.

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
