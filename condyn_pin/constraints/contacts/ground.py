"""Ground of the world that shapes may touch: planes, boxes, stairs, height fields and meshes.

A ground is its surface: flat faces of three or four corners, normals outwards, with what of its
edges and corners sticks out. The normals n that a body may meet there are

    of a face f            n = n_f
    of a convex edge       n . u_1 <= 0,  n . u_2 <= 0,    u into the two faces, across the edge
    of a convex corner     n . e <= 0                      for all edges e that leave it

Flat and hollow edges have none: nothing catches at the lines by which a file divides a surface.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from itertools import product
from os import PathLike
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array, Indices, finite, finite_rows, text_of
from condyn_pin.constraints.constraint import Vector3, check_positive, floats
from condyn_pin.constraints.contacts.seams import WIDTH, Solid, is_hidden
from condyn_pin.constraints.contacts.shapes import Plane, box_core, lengths_of
from condyn_pin.errors import InvalidArgument

# How far a face goes on behind a hollow edge, into the solid: a corner that is in a wall by less
# still stands on the floor [m].
HOLLOW: Final = 2.5e-4

# Shares of one normal of an edge and the other, between which an edge in a seam is covered.
_BETWEEN: Final = (0.1, 0.5, 0.9)

# Elements are looked for in blocks of this many.
_BLOCK: Final = 64


@dataclass(frozen=True)
class Facets:
    """Flat faces of a part of a ground, counter-clockwise from outside.

    Parameters
    ----------
    vertices : sequence of (3,) sequence of float
        Corners, in the world [m].
    faces : sequence of (3,) or (4,) sequence of int
        Numbers of the corners of each face.

    Raises
    ------
    InvalidArgument
        If a face has no area, more than two faces share an edge, or two faces side by side are
        turned against each other; the text has their numbers.
    """

    vertices: tuple[Vector3, ...]
    faces: tuple[tuple[int, ...], ...]

    def __post_init__(self) -> None:
        V = finite_rows("vertices", self.vertices, 3)
        faces = tuple(tuple(int(i) for i in face) for face in self.faces)
        wrong = [
            k for k, face in enumerate(faces)
            if len(face) not in (3, 4) or min(face) < 0 or max(face) >= len(V)
        ]  # fmt: skip
        if wrong or not faces:
            raise InvalidArgument(
                f"faces[{wrong[0] if wrong else 0}]: three or four numbers from 0 to {len(V) - 1} "
                "are needed"
            )
        object.__setattr__(self, "vertices", tuple(map(tuple, V.tolist())))
        object.__setattr__(self, "faces", faces)
        self.surface  # noqa: B018  refuses what is no surface

    @cached_property
    def surface(self) -> Surface:
        """Faces, edges and corners as arrays."""
        quads = [face if len(face) == 4 else (*face, face[-1]) for face in self.faces]
        return _surface_of(np.array(self.vertices), np.array(quads, dtype=np.int_))

    def __getstate__(self) -> dict[str, Any]:
        return {field.name: getattr(self, field.name) for field in fields(self)}


@dataclass(frozen=True)
class Ground:
    """Ground of the world: `plane`, `boxes`, `stairs`, `heightfield`, `mesh`, and sums of these.

    Parameters
    ----------
    parts : sequence of Plane or Facets
        What it is made of; the methods of its class make them.

    Raises
    ------
    InvalidArgument
        If a part is neither, or there is none.

    Notes
    -----
    Boxes, planes and convex meshes that lie side by side to 0.1 mm are one surface: nothing catches
    where they meet. A gap between two of them that is wider is a gap.

    A mesh with a border is a sheet, solid below. Of meshes that are not convex, walls have to be
    thicker than 5 mm.
    """

    parts: tuple[Plane | Facets, ...]

    def __post_init__(self) -> None:
        if isinstance(self.parts, str) or not isinstance(self.parts, Iterable):
            raise InvalidArgument(f"parts = {text_of(self.parts)}: a list of parts is needed")
        parts = tuple(self.parts)
        for each in parts:
            if not isinstance(each, Plane | Facets):
                raise InvalidArgument(
                    f"parts: {text_of(each)} is no Plane and no Facets; Ground.boxes, "
                    "Ground.stairs, Ground.heightfield and Ground.mesh make them"
                )
        if not parts:
            raise InvalidArgument("parts: none; Ground.plane() is the plane z = 0")
        object.__setattr__(self, "parts", parts)

    def __add__(self, other: Ground) -> Ground:
        return Ground((*self.parts, *other.parts)) if isinstance(other, Ground) else NotImplemented

    def __repr__(self) -> str:
        faces = sum(len(part.faces) for part in self.parts if isinstance(part, Facets))
        planes = sum(isinstance(part, Plane) for part in self.parts)
        return f"Ground({len(self.parts)} parts: {planes} planes, {faces} faces)"

    def __getstate__(self) -> dict[str, Any]:
        return {"parts": self.parts}

    @cached_property
    def surface(self) -> Surface:
        """Faces, edges and corners of all parts as arrays."""
        return joined([_of_plane(p) if isinstance(p, Plane) else p.surface for p in self.parts])

    @classmethod
    def plane(cls, normal: Sequence[float] = (0.0, 0.0, 1.0), height: float = 0.0) -> Ground:
        """Return the half-space n . x <= height, z = 0 by default.

        Parameters
        ----------
        normal : (3,) sequence of float
            Out of the ground; any length.
        height : float
            Of the plane, along the normal from the origin [m].
        """
        return cls((Plane(tuple(normal), height),))  # type: ignore[arg-type]

    @classmethod
    def boxes(cls, boxes: Iterable[tuple[Sequence[float], Any]]) -> Ground:
        """Return boxes, each its three edges and where its middle is.

        Parameters
        ----------
        boxes : sequence of (edges, at)
            Edges (3,) [m]; `at` a place (3,) in the world [m], or a pin.SE3.

        Raises
        ------
        InvalidArgument
            If an edge is not positive, or `at` is neither.
        """
        parts = []
        for i, (edges, at) in enumerate(boxes):
            x, y, z = floats(f"boxes[{i}] edges", edges, 3)
            check_positive("edge of a box [m]", x=x, y=y, z=z)
            core = box_core(x / 2.0, y / 2.0, z / 2.0)
            if not isinstance(at, pin.SE3):
                at = pin.SE3(np.eye(3), np.array(floats(f"boxes[{i}] at", at, 3)))
            turned = [
                loop if _newell(core.vertices[loop]).dot(n) > 0.0 else loop[::-1]
                for loop, n in zip(core.loops, core.normals, strict=True)
            ]
            parts.append(Facets(core.placed(at).vertices, tuple(map(tuple, turned))))  # type: ignore[arg-type]
        return cls(tuple(parts))

    @classmethod
    def stairs(
        cls, steps: int, rise: float, run: float, width: float, at: Any = (0.0, 0.0, 0.0)
    ) -> Ground:
        """Return stairs that climb along x, a box a step; the last one is a landing as long as six.

        Parameters
        ----------
        steps : int
            How many.
        rise, run, width : float
            Height and depth of a step, and its length along y [m].
        at : (3,) sequence of float or pin.SE3
            The middle of the foot of the first rise.
        """
        check_positive("length [m]", rise=rise, run=run, width=width)
        if steps != int(steps) or steps < 1:
            raise InvalidArgument(f"steps = {text_of(steps)}: 1 or more are needed")
        if not isinstance(at, pin.SE3):
            at = pin.SE3(np.eye(3), np.array(floats("at", at, 3)))
        made = []
        for k in range(int(steps)):
            depth = run if k < steps - 1 else 6.0 * run
            middle = (k * run + depth / 2.0, 0.0, (k + 1) * rise / 2.0)
            made.append(((depth, width, (k + 1) * rise), at * pin.SE3(np.eye(3), np.array(middle))))
        return cls.boxes(made)

    @classmethod
    def heightfield(cls, z: ArrayLike, size: Sequence[float]) -> Ground:
        """Return a height field about the origin, two triangles a cell.

        Parameters
        ----------
        z : (nx, ny) array_like
            Heights [m]; z[i, j] at x[i], y[j], both rising.
        size : (2,) sequence of float
            Its edges along x and y [m].

        Raises
        ------
        InvalidArgument
            If a height is not finite, or there are fewer than 2 along an edge.
        """
        heights = finite("z", z, np.shape(z))
        if heights.ndim != 2 or min(heights.shape) < 2:
            raise InvalidArgument(
                f"z has shape {heights.shape}: (nx, ny) is needed, each 2 or more"
            )
        check_positive("edge of a height field [m]", **dict(zip("xy", size, strict=True)))
        nx, ny = heights.shape
        x, y = (np.linspace(-0.5, 0.5, n) * edge for n, edge in zip((nx, ny), size, strict=True))
        V = np.stack([np.repeat(x, ny), np.tile(y, nx), heights.ravel()], axis=-1)
        a = np.arange(nx * ny).reshape(nx, ny)[:-1, :-1].ravel()
        F = np.stack([a, a + ny, a + ny + 1, a, a + ny + 1, a + 1], axis=-1).reshape(-1, 3)
        return cls((Facets(V, F.tolist()),))  # type: ignore[arg-type]

    @classmethod
    def mesh(
        cls,
        mesh: str | PathLike[str] | tuple[ArrayLike, ArrayLike],
        at: Any = (0.0, 0.0, 0.0),
        scale: float = 1.0,
    ) -> Ground:
        """Return a mesh, convex or not; a closed one is solid, an open one a sheet.

        Parameters
        ----------
        mesh : path of an STL, OBJ, DAE or PLY file, or (vertices, triangles)
        at : (3,) sequence of float or pin.SE3
            Where its origin is [m].
        scale : float
            Factor of its lengths.

        Raises
        ------
        InvalidArgument
            If it is no surface; see `Facets`.
        """
        if isinstance(mesh, str | PathLike):
            from condyn_pin.io.meshes import read_mesh

            read = read_mesh(Path(mesh))
            V, F = read.vertices, read.faces.astype(np.int_)
        else:
            V, F = finite_rows("vertices", mesh[0], 3), np.array(mesh[1], dtype=np.int_)
        if not isinstance(at, pin.SE3):
            at = pin.SE3(np.eye(3), np.array(floats("at", at, 3)))
        check_positive("factor", scale=scale)
        V, one = np.unique(V, axis=0, return_inverse=True)  # an STL repeats each corner
        V, F = (scale * V).dot(at.rotation.T) + at.translation, one.ravel()[F]
        outwards = np.einsum(
            "ij,ij->i", np.cross(V[F[:, 1]] - V[F[:, 0]], V[F[:, 2]] - V[F[:, 0]]), V[F[:, 0]]
        ).sum()
        made = Facets(V, F.tolist())
        up = made.surface.normals[:, 2]
        if outwards < 0.0 if made.surface.is_closed else (up < 0.0).all():
            made = Facets(V, F[:, ::-1].tolist())
        return cls((made,))


# Surfaces: faces, convex edges and convex corners of a ground as arrays.


class Surface:
    """Surface of a ground in the world.

    Attributes
    ----------
    normals, heights : (f, 3), (f,) array
        Of the faces: n . x = height [m].
    sides, ends : (f, 4, 3), (f, 4) array
        A point of its plane is on a face if side . x <= end + beyond for all four [m].
    beyond : (f, 4) array
        How far a face goes on: not at all, or `HOLLOW` behind a hollow edge [m].
    limits : (f, 4) array
        Where a face ends so, with rounding [m].
    neighbours : (f, 4) int array
        The faces over its convex edges; -1 for none.
    edges : (e, 2, 3) array
        The two ends of each convex edge [m].
    into : (e, 2, 3) array
        Directions into its faces; -n for that which the border of a sheet lacks.
    faces_of_edges : (e, 2) int array
    lengths, along : (e,), (e, 3) array
        Lengths of the edges [m], and unit vectors along them.
    ends_of_arcs : (e, 2, 3) array
        The normals of an edge lie between these two.
    corners : (c, 3) array
        Convex corners [m].
    leaving : (c, k, 3) array
        Unit vectors along the edges of each corner; zeros behind them.
    part_of : three int arrays
        Which part each face, edge and corner belongs to.
    solids : list
        Normals, heights and corners of each part that is convex, None for the others.
    is_closed : bool
        True if no face has a border.
    """

    def __init__(
        self, faces: tuple[Any, ...], edges: tuple[Any, ...], corners: tuple[Any, ...],
        boxes: tuple[Array, ...], part_of: tuple[Indices, ...],
        solids: list[Solid | None], *, is_closed: bool,
    ) -> None:  # fmt: skip
        self.normals, self.heights, self.sides, self.ends, self.beyond, self.neighbours = faces
        self.edges, self.into, self.faces_of_edges = edges
        rounding = tolerances.ON_FACE * (1.0 + np.abs(self.ends))
        self.limits = self.ends + self.beyond + rounding
        self.lengths, self.along = lengths_of(self.edges[:, 1] - self.edges[:, 0])
        n_1, n_2 = self.normals[self.faces_of_edges].transpose(1, 0, 2)
        is_rim = (self.into[:, 1] == -n_1).all(axis=1)
        n_2 = np.where(is_rim[:, None], -self.into[:, 0], n_2)
        self.ends_of_arcs = np.stack([n_1, n_2], axis=1)
        self.corners, self.leaving = corners
        self.boxes, self.part_of, self.solids, self.is_closed = boxes, part_of, solids, is_closed
        self._search = [Blocks(each) for each in boxes]
        # 1 for what is in a seam, where faces go on; -1 where nobody has looked
        self._in_seam = [np.full(len(each), -1, dtype=np.int8) for each in boxes]
        self._beside: dict[int, Indices] = {}

    @property
    def parts(self) -> tuple[Array, ...]:
        """Arrays of faces, edges and corners, as they are joined."""
        return (
            self.normals, self.heights, self.sides, self.ends, self.beyond, self.neighbours,
            self.edges, self.into, self.faces_of_edges, self.corners, self.leaving,
        )  # fmt: skip

    def near(self, low: Array, high: Array) -> list[Indices]:
        """Numbers of the faces, edges and corners that reach into a box, but those in seams."""
        found = [search.near(low, high) for search in self._search]
        if len(self.solids) == 1:
            return found
        for kind, numbers in enumerate(found):
            flags = self._in_seam[kind]
            for i in numbers[flags[numbers] < 0].tolist():
                flags[i] = self._is_covered(kind, i)
            found[kind] = numbers[flags[numbers] == 0]
        return found

    def _is_covered(self, kind: int, i: int) -> bool:
        """True if one part covers all of a face, edge or corner of another, whatever the normal."""
        part, box = self.part_of[kind][i], self.boxes[kind][i]
        if not np.isfinite(box).all():
            return False
        places, normals = [*np.array([*product(*box.T)]), box.mean(axis=0)], self.normals[i : i + 1]
        if kind == 1:
            one, two = self.normals[self.faces_of_edges[i]]
            places = [*self.edges[i], box.mean(axis=0)]
            normals = np.array([(1.0 - share) * one + share * two for share in _BETWEEN])
        elif kind == 2:
            normals = -self.leaving[i].sum(axis=0, keepdims=True)
        n = lengths_of(normals)[1]
        x, n = np.repeat(places, len(n), axis=0), np.tile(n, (len(places), 1))
        return any(
            is_hidden(x, n, WIDTH, self.solids[part], solid).all()
            for other in self.beside(part, WIDTH).tolist()
            if (solid := self.solids[other]) is not None
        )

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """Least and largest coordinates of each part (parts, 3) [m]."""
        count = len(self.solids)
        low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
        np.minimum.at(low, self.part_of[0], self.boxes[0][:, 0])
        np.maximum.at(high, self.part_of[0], self.boxes[0][:, 1])
        return low, high

    def beside(self, part: int, width: float) -> Indices:
        """Convex parts that a part touches within a width [m]."""
        if part not in self._beside:
            low, high = self.bounds
            touch = (low <= high[part] + 2 * width) & (low[part] <= high + 2 * width)
            its = [
                i for i in np.flatnonzero(touch.all(axis=1)).tolist()
                if i != part and self.solids[i] is not None
            ]  # fmt: skip
            self._beside[part] = np.array(its, dtype=np.int_)
        return self._beside[part]


class Blocks:
    """Search for what reaches into a box, among many boxes that stay: by blocks of near ones."""

    def __init__(self, boxes: Array) -> None:
        middles = np.clip(boxes, -1e9, 1e9).mean(axis=1)[:, :2]
        count = len(boxes)
        tiles = max(1, int(np.sqrt(count / _BLOCK)))
        rank = (
            np.argsort(middles[:, 0], kind="stable").argsort(kind="stable") * tiles // max(1, count)
        )
        self._order = np.lexsort((middles[:, 1], rank))
        starts = np.arange(0, count, _BLOCK)
        self._boxes = boxes[self._order]
        self._low, self._high = (
            reduce.reduceat(self._boxes[:, side], starts) if count else np.zeros((0, 3))
            for side, reduce in enumerate((np.minimum, np.maximum))
        )

    def near(self, low: Array, high: Array) -> Indices:
        """Numbers of the boxes that a box meets, rising."""
        blocks = np.flatnonzero(((self._low <= high) & (self._high >= low)).all(axis=1))
        each = (blocks[:, None] * _BLOCK + np.arange(_BLOCK)).ravel()
        each = each[each < len(self._boxes)]
        boxes = self._boxes[each]
        meets = ((boxes[:, 0] <= high) & (boxes[:, 1] >= low)).all(axis=1)
        return np.sort(self._order[each[meets]])


def _of_plane(plane: Plane) -> Surface:
    """Surface of a half-space: one face without sides."""
    n, none = np.array(plane.normal), np.zeros((1, 4))
    low, high = np.full(3, -np.inf), np.full(3, np.inf)
    axis = int(np.abs(n).argmax())
    if abs(n[axis]) == 1.0:
        low[axis] = high[axis] = n[axis] * plane.height
    faces = (
        n[None], np.array([plane.height]), np.zeros((1, 4, 3)), none, none,
        np.full((1, 4), -1),
    )  # fmt: skip
    edges = np.zeros((0, 2, 3)), np.zeros((0, 2, 3)), np.zeros((0, 2), dtype=np.int_)
    nothing = np.zeros((0, 2, 3))
    return Surface(
        faces, edges, (np.zeros((0, 3)), np.zeros((0, 1, 3))),
        (np.array([[low, high]]), nothing, nothing), _first(1, 0, 0),
        [(n[None], np.array([plane.height]), np.zeros((0, 3)))], is_closed=True,
    )  # fmt: skip


def _first(*counts: int) -> tuple[Indices, ...]:
    return tuple(np.zeros(count, dtype=np.int_) for count in counts)


def _surface_of(V: Array, F: Indices) -> Surface:
    """Surface of vertices (k, 3) and faces (f, 4); a triangle repeats its last corner."""
    corners = V[F]
    n = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    is_triangle = F[:, 2] == F[:, 3]
    n[is_triangle] = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[
        is_triangle
    ]
    area, n = lengths_of(n)
    size = float(np.ptp(V, axis=0).max())
    flat = np.flatnonzero(area <= (tolerances.ON_FACE * size) ** 2)
    if len(flat):
        raise InvalidArgument(
            f"faces[{flat[0]}] has no area, and {len(flat) - 1} more: leave them out; trimesh has "
            "update_faces(mesh.nondegenerate_faces())"
        )
    along, following = np.roll(corners, -1, axis=1) - corners, np.roll(F, -1, axis=1)
    real = following != F
    lengths = np.sqrt((along**2).sum(axis=2))
    along = along / np.where(real, lengths, 1.0)[:, :, None]
    sides = np.cross(along, n[:, None]) * real[:, :, None]
    ends = (sides * corners).sum(axis=2)
    # sides of all faces by the edge that they are on
    pairs = np.sort(np.stack([F, following], axis=2)[real], axis=1)
    ups = (following > F)[real]
    of_face = np.repeat(np.arange(len(F)), 4).reshape(F.shape)[real]
    of_side = np.tile(np.arange(4), (len(F), 1))[real]
    E, edge, count = np.unique(pairs, axis=0, return_inverse=True, return_counts=True)
    edge = edge.ravel()
    if (count > 2).any():
        which = of_face[edge == int(np.flatnonzero(count > 2)[0])]
        raise InvalidArgument(
            f"faces {listed_numbers(which)} share one edge: two are the most of a surface; split "
            "the mesh into solids, Ground.mesh(a) + Ground.mesh(b)"
        )
    order = np.argsort(edge, kind="stable")
    first = order[np.searchsorted(edge[order], np.arange(len(E)))]
    both, last = (
        count == 2,
        order[np.searchsorted(edge[order], np.arange(len(E)), side="right") - 1],
    )
    if (wrong := np.flatnonzero(both & (ups[first] == ups[last]))).size:
        which = of_face[[first[wrong[0]], last[wrong[0]]]]
        raise InvalidArgument(
            f"faces {listed_numbers(which)} lie side by side and are turned against each other: "
            "corners are needed counter-clockwise from outside; trimesh.repair.fix_winding does it"
        )
    one, two = of_face[first], of_face[last]
    out_1, out_2 = sides[one, of_side[first]], sides[two, of_side[last]]
    sine = -(out_1 * n[two]).sum(axis=1)
    hollow, convex = both & (sine > tolerances.FLAT), ~both | (sine < -tolerances.FLAT)
    beyond, neighbours = np.zeros(F.shape), np.full(F.shape, -1)
    for at in (first, last):
        beyond[of_face[at[hollow]], of_side[at[hollow]]] = HOLLOW
    outer = both & convex
    neighbours[one[outer], of_side[first[outer]]] = two[outer]
    neighbours[two[outer], of_side[last[outer]]] = one[outer]
    into = np.stack([-out_1, np.where(both[:, None], -out_2, -n[one])], axis=1)
    leaving, of_corner = _corners_of(V, F, E, n, into, one, both)
    edges = V[E[convex]]
    x = V[of_corner]
    faces = n, (n * corners[:, 0]).sum(axis=1), sides, ends, beyond, neighbours
    is_convex = bool(both.all() and not hollow.any())
    planes, kept = np.unique(np.round(np.c_[n, faces[1]], 9), axis=0, return_index=True)
    return Surface(
        faces, (edges, into[convex], np.stack([one, two], axis=1)[convex]), (x, leaving),
        (np.stack([corners.min(axis=1), corners.max(axis=1)], axis=1),
         np.stack([edges.min(axis=1), edges.max(axis=1)], axis=1), np.stack([x, x], axis=1)),
        _first(len(F), len(edges), len(x)),
        [(n[kept], faces[1][kept], V) if is_convex and len(planes) else None],
        is_closed=bool(both.all()),
    )  # fmt: skip


def _corners_of(
    V: Array, F: Indices, E: Indices, n: Array, into: Array, one: Indices, both: NDArray[np.bool_]
) -> tuple[Array, Indices]:
    """Unit vectors that leave the convex corners (c, k, 3), and the vertices that these are."""
    _, d = lengths_of(V[E[:, 1]] - V[E[:, 0]])
    at, away = np.concatenate([E[:, 0], E[:, 1]]), np.concatenate([d, -d])
    rim = np.flatnonzero(~both)  # a sheet is solid below its border
    at = np.concatenate([at, E[rim].ravel()])
    away = np.concatenate([away, np.repeat(into[rim, 1], 2, axis=0)])
    mean = np.zeros_like(V)
    np.add.at(mean, F.ravel(), np.repeat(n, 4, axis=0))
    _, mean = lengths_of(mean)
    steepest = np.full(len(V), -np.inf)
    np.maximum.at(steepest, at, (away * mean[at]).sum(axis=1))
    kept = np.flatnonzero(steepest < -tolerances.FLAT)
    order = np.argsort(at, kind="stable")
    starts = np.searchsorted(at[order], np.arange(len(V) + 1))
    most = int(np.diff(starts)[kept].max(initial=1))
    leaving = np.zeros((len(kept), most, 3))
    for row, v in enumerate(kept.tolist()):
        its = order[starts[v] : starts[v + 1]]
        leaving[row, : len(its)] = away[its]
    return leaving, kept


def joined(surfaces: Sequence[Surface]) -> Surface:
    """Surface of several, each a part of its own."""
    if len(surfaces) == 1:
        return surfaces[0]
    counts = [(len(s.normals), len(s.edges), len(s.corners)) for s in surfaces]
    part_of = tuple(np.repeat(np.arange(len(surfaces)), of) for of in zip(*counts, strict=True))
    shifts = np.cumsum([0, *(count[0] for count in counts)])[:-1]
    most = max(s.leaving.shape[1] for s in surfaces)

    def all_of(arrays: Iterator[Array]) -> Array:
        return np.concatenate(list(arrays))

    columns = [all_of(iter(each)) for each in zip(*(s.parts[:5] for s in surfaces), strict=True)]
    neighbours = all_of(
        np.where(s.neighbours < 0, -1, s.neighbours + shift)
        for s, shift in zip(surfaces, shifts, strict=True)
    )
    leaving = all_of(
        np.pad(s.leaving, ((0, 0), (0, most - s.leaving.shape[1]), (0, 0))) for s in surfaces
    )
    return Surface(
        (*columns, neighbours),
        (all_of(s.edges for s in surfaces), all_of(s.into for s in surfaces),
         all_of(s.faces_of_edges + shift for s, shift in zip(surfaces, shifts, strict=True))),
        (all_of(s.corners for s in surfaces), leaving),
        tuple(all_of(s.boxes[i] for s in surfaces) for i in range(3)), part_of,
        [s.solids[0] for s in surfaces], is_closed=all(s.is_closed for s in surfaces),
    )  # fmt: skip


def _newell(corners: Array) -> Array:
    """Normal of a polygon, as long as twice its area."""
    return np.asarray(np.cross(corners, np.roll(corners, -1, axis=0)).sum(axis=0))


def listed_numbers(numbers: Indices) -> str:
    """Numbers in words."""
    return " and ".join(map(str, sorted(numbers.tolist())))
