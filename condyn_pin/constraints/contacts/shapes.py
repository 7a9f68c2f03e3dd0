"""Shapes of bodies in contact: points, balls, capsules, boxes, round and convex solids.

What of a shape meets a plane are its contact points, points with a radius: the gap of one at p over
a plane n . x = height is n . p - height - radius, and the gap of the shape is the least of them.
Which points these are depends on n for cylinders, ellipsoids and solids of many corners.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise, product
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from condyn_pin._core import tolerances
from condyn_pin._core.arguments import register
from condyn_pin._core.arrays import Array, Indices, finite_rows, text_of
from condyn_pin.constraints.constraint import (
    Patch,
    Vector3,
    check_positive,
    direction,
    floats,
    plane,
)
from condyn_pin.errors import InvalidArgument

# A plane that bodies rest on, n . x = height.


@dataclass(frozen=True)
class Plane:
    """The half-space n . x <= height is solid: the world's, or that of a body in its axes.

    Parameters
    ----------
    normal : (3,) sequence of float
        Out of the ground; any length.
    height : float
        Of the plane, along the normal from the origin [m].
    """

    normal: Vector3 = (0.0, 0.0, 1.0)
    height: float = 0.0  # [m]

    def __post_init__(self) -> None:
        object.__setattr__(self, "normal", direction("normal", self.normal))
        object.__setattr__(self, "height", floats("height", [self.height], 1)[0])

    @property
    def placement(self) -> Any:
        """A frame in the plane: z is the normal, x and y those of the world if it is level."""
        return plane(self.normal, self.height)


# Cores: what is left of a shape without its round skin, a point, a segment or a polytope.
#
# shape = core + ball of a radius


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
    half_axes : (3, 3) array, optional
        Columns from the centre, the only vertex, to the surface of an ellipsoid; of a cylinder, to
        its rim twice, and to its end [m].
    has_rims : bool
        True of a cylinder.
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
    half_axes: Array | None = None
    has_rims: bool = False

    @property
    def is_point(self) -> bool:
        """True if the core is a single vertex."""
        return len(self.vertices) == 1

    @property
    def is_solid(self) -> bool:
        """True if the core has faces."""
        return len(self.normals) > 1

    @property
    def is_plane(self) -> bool:
        """True if the core is a half-space, z <= 0 in its own axes."""
        return len(self.normals) == 1

    @property
    def is_fine(self) -> bool:
        """True if the core has more edges than are looked at one by one."""
        return len(self.edges) > _MANY

    def lowest_part(self, axis: Array, band: float) -> Core:
        """Core with what reaches into the lowest band along an axis [m]: edges and faces there."""
        along = self.vertices.dot(axis)
        low = along <= along.min() + band
        edges = self.edges[low[self.edges].all(axis=1)]
        off = np.abs(self.vertices[low].dot(self.normals.T) - self.heights)
        faces = np.flatnonzero(off.min(axis=0) <= tolerances.FLAT * self.size)
        d = self.vertices[edges[:, 1]] - self.vertices[edges[:, 0]]
        return self._replace(
            edges=edges, normals=self.normals[faces], heights=self.heights[faces],
            loops=tuple(self.loops[i] for i in faces), directions=lengths_of(d)[1],
        )  # fmt: skip

    def placed(self, at: Any) -> Core:
        """Return the core in the world, at a placement."""
        R, p = at.rotation, at.translation
        normals = self.normals.dot(R.T)
        return self._replace(
            vertices=self.vertices.dot(R.T) + p, normals=normals,
            heights=self.heights + normals.dot(p), directions=self.directions.dot(R.T),
            half_axes=None if self.half_axes is None else R.dot(self.half_axes),
        )  # fmt: skip


# Of more edges than this those near a contact are looked at, each with its own direction.
_MANY: Final = 48

_NO_EDGES: Final = np.zeros((0, 2), dtype=np.int_)


def plane_core() -> Core:
    """Core of the half-space z <= 0."""
    up, no = np.array([[0.0, 0.0, 1.0]]), np.zeros((0, 3))
    return Core(np.zeros((1, 3)), _NO_EDGES, up, np.zeros(1), (), 0.0, no, 0.0, np.inf)


def ground_core() -> Core:
    """Core of a ground, which is anywhere: its surface has what bodies meet."""
    return plane_core()._replace(normals=np.zeros((0, 3)), heights=np.zeros(0))


def corners_core(vertices: Array) -> Core:
    """Core of a solid of which its corners are enough: what meets planes alone."""
    return _core(vertices, _NO_EDGES, np.zeros((0, 3)), np.zeros(0), (), 0.0)


def round_core(half_axes: Array, *, has_rims: bool) -> Core:
    """Core of an ellipsoid or a cylinder about the origin; see `Core.half_axes`."""
    lengths = lengths_of(half_axes.T)[0]
    reach = float(np.hypot(lengths[0], lengths[2]) if has_rims else lengths.max())
    return corners_core(np.zeros((1, 3)))._replace(
        half_axes=half_axes, has_rims=has_rims, size=2.0 * float(lengths.max()), reach=reach
    )


def points_core(*vertices: tuple[float, float, float], radius: float) -> Core:
    """Core of a ball, or of a capsule between two points."""
    ends = np.array(vertices)
    edges = np.array([*pairwise(range(len(ends)))], dtype=np.int_).reshape(-1, 2)
    return _core(ends, edges, np.zeros((0, 3)), np.zeros(0), (), radius)


def box_core(x: float, y: float, z: float) -> Core:
    """Core of a box with half-edges x, y, z, its corners in the order of `Box.contact_points`."""
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
    """Core of a convex solid; the arguments are as in `Core`."""
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
    """Unit vectors along edges (e, 3), one for parallel edges to rounding; all, if many."""
    lengths, units = lengths_of(along)
    if len(units) > _MANY:
        return units
    kept: list[int] = []
    for i, (unit, length) in enumerate(zip(units, lengths, strict=True)):
        _, sines = unit_cross(np.repeat(unit[None], len(kept), axis=0), units[kept])
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
    """Distances of points from the edges of a core, or from its only corner."""
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
    """Flags of points (k, 3) in planes of faces of a core: on the face."""
    heights = points.dot(core.normals.T) - core.heights
    return np.asarray((heights <= tolerances.ON_FACE * core.size).all(axis=1))


def segments(core: Core, chosen: Indices | None = None) -> tuple[Array, Array]:
    """Starts of edges, and vectors to their ends (e, 3), of all edges by default."""
    edges = core.edges if chosen is None else chosen
    start = core.vertices[edges[:, 0]]
    return start, core.vertices[edges[:, 1]] - start


def unit_cross(one: Array, two: Array) -> tuple[Array, Array]:
    """Return the unit vectors across two rows of vectors (k, 3), and the lengths of the products.

    As `numpy.cross`, which takes ten times as long for a few.
    """
    (x, y, z), (u, v, w) = one.T, two.T
    lengths, normals = lengths_of(np.array([y * w - z * v, z * u - x * w, x * v - y * u]).T)
    return normals, lengths


# Shapes of bodies that touch: points, balls, capsules, boxes, cylinders and ellipsoids.


# All shapes by the names of their classes, by which archives find them.
SHAPES: dict[str, type[Shape]] = {}


class ContactPoint(NamedTuple):
    """A point of a shape that may touch first, in the axes of the shape."""

    called: str  # among those of its shape; empty for the only one
    middle: Vector3  # [m]
    radius: float  # [m]


class Shape(ABC):
    """Shape of a body, with contact points."""

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        register(SHAPES, cls.__name__, cls, f"a shape named {cls.__name__}")

    @property
    @abstractmethod
    def contact_points(self) -> tuple[ContactPoint, ...]:
        """Points that may touch a plane."""

    @property
    def patch(self) -> Patch | None:
        """Picture of the shape; None without a size."""
        return None

    def _check_lengths(self, what: str) -> None:
        """Set its fields as positive floats, or raise InvalidArgument."""
        lengths = dict(vars(self))
        check_positive(what, **lengths)
        for name, length in lengths.items():
            object.__setattr__(self, name, float(length))

    @property
    def over_plane(self) -> Core | None:
        """Shape over a plane, if its contact points depend on the plane; None if they do not."""
        return None

    @property
    def core(self) -> Core:
        """Shape without its round skin; contact points alone make a ball or a capsule."""
        radius = self.contact_points[0].radius
        return points_core(*(each.middle for each in self.contact_points), radius=radius)


@dataclass(frozen=True)
class Point(Shape):
    """A point: a tip, a stud, the middle of a small foot."""

    @property
    def contact_points(self) -> tuple[ContactPoint, ...]:
        """The point itself."""
        return (ContactPoint("", (0.0, 0.0, 0.0), 0.0),)


@dataclass(frozen=True)
class Ball(Shape):
    """A ball round the origin.

    Parameters
    ----------
    radius : float
        Radius [m].

    Raises
    ------
    InvalidArgument
        If the radius is not positive.
    """

    radius: float  # [m]

    def __post_init__(self) -> None:
        self._check_lengths("length [m]")

    @property
    def contact_points(self) -> tuple[ContactPoint, ...]:
        """Middle of the ball."""
        return (ContactPoint("", (0.0, 0.0, 0.0), self.radius),)

    @property
    def patch(self) -> Patch:
        """The ball."""
        return Patch("ball", (self.radius,))


@dataclass(frozen=True)
class Capsule(Shape):
    """A rod with round ends, along z.

    Parameters
    ----------
    radius : float
        Radius [m].
    half_length : float
        Half the distance between the middles of its two ends [m].

    Raises
    ------
    InvalidArgument
        If a length is not positive.
    """

    radius: float  # [m]
    half_length: float  # [m]

    def __post_init__(self) -> None:
        self._check_lengths("length [m]")

    @property
    def contact_points(self) -> tuple[ContactPoint, ...]:
        """Middles of the two ends."""
        return (
            ContactPoint("end 1", (0.0, 0.0, self.half_length), self.radius),
            ContactPoint("end 2", (0.0, 0.0, -self.half_length), self.radius),
        )

    @property
    def patch(self) -> Patch:
        """The capsule."""
        return Patch("capsule", (self.radius, 2.0 * self.half_length))


@dataclass(frozen=True)
class Box(Shape):
    """A box round the origin.

    Parameters
    ----------
    x, y, z : float
        Half of its edges [m].

    Raises
    ------
    InvalidArgument
        If an edge is not positive.
    """

    x: float  # [m]
    y: float  # [m]
    z: float  # [m]

    def __post_init__(self) -> None:
        self._check_lengths("half of an edge [m]")

    @property
    def contact_points(self) -> tuple[ContactPoint, ...]:
        """Corners, from (x, y, z) to (-x, -y, -z); the sign of z changes fastest."""
        corners = product((self.x, -self.x), (self.y, -self.y), (self.z, -self.z))
        return tuple(ContactPoint(f"corner {i}", at, 0.0) for i, at in enumerate(corners, start=1))

    @property
    def patch(self) -> Patch:
        """The box."""
        return Patch("box", (2.0 * self.x, 2.0 * self.y, 2.0 * self.z))

    @property
    def core(self) -> Core:
        """The box."""
        return box_core(self.x, self.y, self.z)


class _Round(Shape):
    """A shape with a smooth surface, which touches planes alone."""

    @property
    def contact_points(self) -> tuple[ContactPoint, ...]:
        """No point is one in all positions."""
        return ()

    @property
    def over_plane(self) -> Core:
        """The shape itself."""
        return self.core


@dataclass(frozen=True)
class Cylinder(_Round):
    """A cylinder along z, round the origin. It touches planes, and no other shapes.

    Its contact points are the lowest one of each rim, and four on the lower rim that turn with it.

    Parameters
    ----------
    radius : float
        Radius [m].
    half_length : float
        Half the distance between its two ends [m].

    Raises
    ------
    InvalidArgument
        If a length is not positive.
    """

    radius: float  # [m]
    half_length: float  # [m]

    def __post_init__(self) -> None:
        self._check_lengths("length [m]")

    @property
    def patch(self) -> Patch:
        """The cylinder."""
        return Patch("rod", (self.radius, 2.0 * self.half_length))

    @property
    def core(self) -> Core:
        """The cylinder."""
        return round_core(np.diag([self.radius, self.radius, self.half_length]), has_rims=True)


@dataclass(frozen=True)
class Ellipsoid(_Round):
    """An ellipsoid round the origin. It touches planes, and no other shapes.

    Its contact point at a plane with normal n is -A^2 n / |A n|, A the diagonal matrix of x, y, z.

    Parameters
    ----------
    x, y, z : float
        Half of its axes [m].

    Raises
    ------
    InvalidArgument
        If an axis is not positive.
    """

    x: float  # [m]
    y: float  # [m]
    z: float  # [m]

    def __post_init__(self) -> None:
        self._check_lengths("half of an axis [m]")

    @property
    def core(self) -> Core:
        """The ellipsoid."""
        return round_core(np.diag([self.x, self.y, self.z]), has_rims=False)


# A convex solid by its corners: what a mesh has to be to touch.


# Three rows each on a plane: of more corners those that are near it are enough.
_EACH: Final = 64


@dataclass(frozen=True)
class Convex(Shape):
    """A convex solid.

    Parameters
    ----------
    vertices : sequence of (3,) sequence of float
        Its corners, 4 or more, each on its hull [m]; `Convex.hull` finds those of a mesh. Up to 64
        corners are a contact point each over a plane; of more, the eight that are next to touch.

    Raises
    ------
    InvalidArgument
        If a corner is inside of the hull of the others, or all of them lie in a plane.
    """

    vertices: tuple[Vector3, ...]

    def __post_init__(self) -> None:
        if isinstance(self.vertices, str) or not isinstance(self.vertices, Iterable):
            raise InvalidArgument(
                f"vertices = {text_of(self.vertices)}: a list of points is needed"
            )
        vertices = tuple(
            floats(f"vertices[{i}]", point, 3) for i, point in enumerate(self.vertices)
        )
        if len(vertices) < 4:
            raise InvalidArgument(f"vertices: {len(vertices)} of them; 4 or more are needed")
        object.__setattr__(self, "vertices", vertices)
        inside = set(range(len(vertices))) - set(self._hull.vertices.tolist())
        if inside:
            i = min(inside)
            raise InvalidArgument(
                f"vertices[{i}] = {vertices[i]}: it is not a corner of the convex hull; a "
                "convex solid is needed: Convex.hull(vertices) is the one round all of them, or "
                "split a concave mesh into convex parts"
            )
        if len(vertices) <= _EACH:
            self.core  # noqa: B018  refuses what is too flat

    @staticmethod
    def hull(points: ArrayLike) -> Convex:
        """Return the convex hull of points (k, 3) [m], such as the corners of a mesh.

        Raises
        ------
        InvalidArgument
            If the points lie in a plane, or are no points.
        """
        corners = finite_rows("points", points, 3)
        while True:  # a corner that rounding makes one is none of the hull of the others
            kept = np.sort(_hull_of(corners).vertices)
            if len(kept) == len(corners):
                return Convex(tuple(map(tuple, corners.tolist())))
            corners = corners[kept]

    @property
    def over_plane(self) -> Core | None:
        """Its corners, if they are many."""
        if len(self.vertices) <= _EACH:
            return None
        return corners_core(np.array(self.vertices))

    @property
    def contact_points(self) -> tuple[ContactPoint, ...]:
        """Corners of the solid."""
        return tuple(
            ContactPoint(f"corner {i}", at, 0.0) for i, at in enumerate(self.vertices, start=1)
        )

    @property
    def core(self) -> Core:
        """The solid: triangles of one plane are one face."""
        return _convex_core(self.vertices)

    @property
    def _hull(self) -> Any:
        return _hull_of(np.array(self.vertices))


@lru_cache(maxsize=256)
def _convex_core(vertices: tuple[Vector3, ...]) -> Core:
    """Core of a convex solid with these corners."""
    points = np.array(vertices)
    off = tolerances.FLAT * float(np.ptp(points, axis=0).max())
    normals, heights = _planes(points, _hull_of(points), off)
    on = np.abs(points.dot(normals.T) - heights) <= off
    if on.all(axis=0).any():
        raise _flat()
    loops = tuple(
        _ordered_corners(points, np.flatnonzero(on[:, face]), normal)
        for face, normal in enumerate(normals)
    )
    edges = {
        (min(a, b), max(a, b))
        for loop in loops
        for a, b in zip(loop.tolist(), np.roll(loop, -1).tolist(), strict=True)
    }
    return solid_core(points, np.array(sorted(edges)), normals, heights, loops)


def _hull_of(points: Array) -> Any:
    """Hull of points (k, 3) by Qhull, or InvalidArgument."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        return ConvexHull(points)
    except (QhullError, ValueError) as error:  # flat; fewer than four
        raise _flat() from error


def _planes(points: Array, hull: Any, off: float) -> tuple[Array, Array]:
    """Return outward normals and heights of the faces of a hull: triangles of one plane are one.

    A triangle belongs to the plane of a larger one if its corners are `off` it by no more [m].
    """
    corners = points[hull.simplices]
    _, twice = unit_cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    above = np.abs(corners.dot(hull.equations[:, :3].T) + hull.equations[:, 3]).max(axis=1)
    kept: list[int] = []
    for i in np.argsort(-twice, kind="stable").tolist():  # a sliver has no normal of its own
        if (above[i, kept] > off).all():
            kept.append(i)
    planes = hull.equations[sorted(kept)]
    return planes[:, :3], -planes[:, 3]


def _flat() -> InvalidArgument:
    return InvalidArgument("vertices: they lie in a plane, or nearly; a solid is needed")


def _ordered_corners(points: Array, corners: Indices, normal: Array) -> Indices:
    """Return the corners of a face in their order around it."""
    away = points[corners] - points[corners].mean(axis=0)
    x = away[0] / np.sqrt(away[0].dot(away[0]))
    y = np.array([normal[1] * x[2] - normal[2] * x[1], normal[2] * x[0] - normal[0] * x[2],
                  normal[0] * x[1] - normal[1] * x[0]])  # fmt: skip
    return corners[np.argsort(np.arctan2(away.dot(y), away.dot(x)), kind="stable")]
