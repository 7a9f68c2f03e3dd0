"""Gaps, contact points and rows of one contact that is bound to a model.

Contacts bound to a model: the joints, points and coordinates that their rows are made of.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from condyn_pin._core._pin import placements_view
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.constraint import Patch
from condyn_pin.constraints.contacts.ground import Surface
from condyn_pin.constraints.contacts.meetings import most_meetings, most_on_ground
from condyn_pin.constraints.contacts.shapes import Core
from condyn_pin.constraints.rows.cables import Line


class PlaneContact(NamedTuple):
    """A contact point of one body over a plane of another: three rows."""

    name: str
    joint: int
    centre: Array  # (3,), on the joint [m]
    radius: float  # [m]
    ground: int  # the joint that carries the plane; 0 for the world
    plane: Any  # pin.SE3 on that joint, z out of the ground
    friction: float
    restitution: float


class Pair(NamedTuple):
    """A shape of one body near one of another: three rows for each place of a point."""

    name: str
    joint: int
    placement: Any  # pin.SE3 of the shape on that joint
    shape: Core
    ground: int  # the joint that carries the other; 0 for the world
    ground_placement: Any
    ground_shape: Core
    friction: float
    restitution: float
    surface: Surface | None = None  # of the ground of the world, if that is the other shape

    @property
    def points(self) -> int:
        """Number of places."""
        if self.surface is not None:
            return most_on_ground(self.shape)
        return most_meetings(self.shape, self.ground_shape)

    @property
    def candidates(self) -> tuple[str, ...]:
        """Names of the places."""
        if self.points == 1:
            return (self.name,)
        return tuple(f"{self.name}/point {i}" for i in range(1, self.points + 1))


class BoundJointLimit(NamedTuple):
    """An end of the range of a joint: one row, sign (q - limit) >= 0."""

    name: str
    iq: int
    iv: int
    sign: float
    limit: float  # [rad, m]
    is_length: bool


class BoundJointFriction(NamedTuple):
    """Dry friction along a coordinate of v: one row, |lam| <= limit."""

    name: str
    iv: int
    limit: float  # [N m, N]


class BoundLine(NamedTuple):
    """A cable at its longest, or a strut at its shortest: one row."""

    name: str
    line: Line


class BoundShape(NamedTuple):
    """A shape on a joint, to be drawn."""

    joint: int
    placement: Any  # pin.SE3 on that joint
    patch: Patch


@dataclass(frozen=True, eq=False)
class BoundContact:
    """A contact on the joints of a model; most kinds fill one of the lists."""

    name: str
    touches: tuple[PlaneContact, ...] = ()
    pairs: tuple[Pair, ...] = ()
    stops: tuple[BoundJointLimit, ...] = ()
    lines: tuple[BoundLine, ...] = ()
    dry: tuple[BoundJointFriction, ...] = ()
    solids: tuple[BoundShape, ...] = ()

    @property
    def cones(self) -> tuple[tuple[str, int], ...]:
        """Name of each of its cones, and the joint that carries what it touches."""
        on_planes = [(touch.name, touch.ground) for touch in self.touches]
        of_pairs = [(name, pair.ground) for pair in self.pairs for name in pair.candidates]
        return (*on_planes, *of_pairs)

    @property
    def candidates(self) -> tuple[str, ...]:
        """Names of its cones, half-lines and intervals."""
        cones = [name for name, _ in self.cones]
        return (
            *cones, *(stop.name for stop in self.stops), *(line.name for line in self.lines),
            *(each.name for each in self.dry),
        )  # fmt: skip


# Contact points over planes, all of a scene at once.
#
#     gap = n . (p - o) - radius,        contact point = p - radius n
#     J   = E^T (J_v - [contact point] J_w),        d gap/dt = n . (J v)
#
# p the middle of a point, o and E = (t1, t2, n) of its plane. J is that of the material point of
# the body which is at the contact point, against that of the ground: both bodies count, and what
# carries both of them does not.


# The coordinates y, z, x and z, x, y.
_NEXT, _LAST = [1, 2, 0], [2, 0, 1]


class PlaneContacts:
    """Contact points over planes of one model, together; not to be shared between threads.

    Attributes
    ----------
    size : int
        Number of contact points, k.
    """

    def __init__(self, model: Any, touches: Sequence[PlaneContact]) -> None:
        self.size = k = len(touches)
        self._placements = Placements(joint for t in touches for joint in (t.joint, t.ground))
        # columns: middles (k), axes (3 k), points of the planes (k)
        self._local = np.zeros((self._placements.size, 5 * k))
        for i, t in enumerate(touches):
            body, ground = self._placements.rows(t.joint), self._placements.rows(t.ground)
            self._local[body, i] = (*t.centre, 1.0)
            self._local[ground, k + 3 * i : k + 3 * i + 3] = t.plane.homogeneous[:, :3]
            self._local[ground, 4 * k + i] = (*t.plane.translation, 1.0)
        self._radius = np.array([t.radius for t in touches])
        self._joints = [t.joint for t in touches], [t.ground for t in touches]
        self._moves = np.repeat(
            [columns(model, t.joint) - columns(model, t.ground) for t in touches], 3, axis=0
        ).reshape(3 * k, model.nv)

    def gaps(self, data: Any) -> Array:
        """Return the signed distances (k,) [m]; reads data.oMi."""
        centres, axes, origins = self._world(data)
        return self._gaps(centres, axes[:, 2::3], origins)

    def points(self, data: Any) -> Array:
        """Return the contact points (k, 3) [m]."""
        centres, axes, _ = self._world(data)
        return (centres - self._radius * axes[:, 2::3]).T

    def axes(self, data: Any) -> Array:
        """Return t1, t2, n of each contact point as columns (k, 3, 3)."""
        return self._world(data)[1].reshape(3, self.size, 3).transpose(1, 0, 2)

    def evaluate(self, data: Any) -> tuple[Array, Array]:
        """Return gaps (k,) and the rows t1, t2, n of each point (3 k, nv); reads data.J too."""
        centres, axes, origins = self._world(data)
        normals = axes[:, 2::3]
        J = data.J.reshape(6, -1)  # a single column comes as a vector
        rows = relative_rows(centres - self._radius * normals, axes, J, self._moves)
        return self._gaps(centres, normals, origins), rows

    def rows(self, data: Any) -> Array:
        """Return the rows of `evaluate` alone (3 k, nv)."""
        return self.evaluate(data)[1]

    def drift(self, data: Any) -> Array:
        """Return Jdot v in the rows of `evaluate` (3 k,) [m/s^2].

        Reads what forward kinematics with a = 0 leaves in data. With the velocity field v_0 + w x p
        of each body, those of the ground marked g, and a place p that moves with the middle of the
        contact point, u = v_0 + w x p - v_0g - w_g x p is the slip, and

            d(E^T u)/dt = E^T (v_0' + w' x p + w x p' - the same of the ground - w_g x u).
        """
        centres, axes, _ = self._world(data)
        normals, r = axes[:, 2::3].T, self._radius[:, None]
        (v, w, dv, dw), (v_g, w_g, dv_g, dw_g) = (_fields(data, its) for its in self._joints)
        p = centres.T - r * normals
        rate = v + _cross(w, centres.T) - r * _cross(w_g, normals)
        slip = v - v_g + _cross(w - w_g, p)
        bias = dv - dv_g + _cross(dw - dw_g, p) + _cross(w - w_g, rate) - _cross(w_g, slip)
        return np.asarray(np.einsum("xka,kx->ka", axes.reshape(3, self.size, 3), bias).ravel())

    def _gaps(self, centres: Array, normals: Array, origins: Array) -> Array:
        above = (centres - origins) * normals
        return above[0] + above[1] + above[2] - self._radius  # type: ignore[no-any-return]

    def _world(self, data: Any) -> tuple[Array, Array, Array]:
        """Return middles (3, k), axes (3, 3 k) and points of the planes (3, k) in the world."""
        world, k = self._placements.read(data).dot(self._local), self.size
        return world[:, :k], world[:, k : 4 * k], world[:, 4 * k :]


def _cross(a: Array, b: Array) -> Array:
    """Return a x b, row by row (k, 3): numpy's own takes ten times as long for a few rows."""
    return np.asarray(a[:, _NEXT] * b[:, _LAST] - a[:, _LAST] * b[:, _NEXT])


def _fields(data: Any, joints: Sequence[int]) -> Array:
    """Return v_0, w and their rates without accelerations, of each joint (4, k, 3); world axes."""
    fields = {0: np.zeros(12)}  # the world stands still
    for j in set(joints) - {0}:
        at = data.oMi[j]
        fields[j] = np.concatenate((at.act(data.v[j]).vector, at.act(data.a[j]).vector))
    found = np.reshape([fields[j] for j in joints], (len(joints), 4, 3))
    return np.asarray(found.transpose(1, 0, 2))


def relative_rows(points: Array, axes: Array, J: Array, moves: Array) -> Array:
    """Return d . (velocity of the points of one body against another), a row for each axis d.

    Parameters
    ----------
    points : (3, k) array
        In the world [m].
    axes : (3, 3 k) array
        Three unit vectors a point, in the world.
    J : (6, nv) array
        Of all joints in the world's axes and at its origin: `data.J`.
    moves : (3 k, nv) array
        Which columns move the body (1), and which the other (-1).
    """
    x, y, z = points[:, :, None]
    dx, dy, dz = along = axes.reshape(3, -1, 3)
    twist = np.empty((6, *along.shape[1:]))
    twist[:3] = along
    twist[3] = y * dz - z * dy
    twist[4] = z * dx - x * dz
    twist[5] = x * dy - y * dx
    return np.asarray(twist.reshape(6, -1).T.dot(J) * moves)


def columns(model: Any, joint: int) -> Array:
    """Return 1 for each coordinate of v that moves a joint (nv,), and 0 for the others."""
    moves = np.zeros(model.nv)
    for j in list(model.supports[joint])[1:]:
        moves[model.idx_vs[j] : model.idx_vs[j] + model.nvs[j]] = 1.0
    return moves


# Placements of joints in the world side by side, from which points of many bodies follow at once.
#
#     (p_1, p_2, ...) = (R_1, o_1, R_2, o_2, ...) L
#
# with the local points, and a 1 below each, in the four rows of L that belong to their joint; an
# axis has a 0 there. Pinocchio keeps the placements of all joints so: nothing is copied, and joints
# that lie between the first and the last have rows too, of zeros.


class Placements:
    """Placements of joints in the world; not to be shared between threads.

    Parameters
    ----------
    joints : iterable of int
        The world, 0, may be among them.
    """

    def __init__(self, joints: Iterable[int]) -> None:
        all_of_them = set(joints)
        self._first = min(all_of_them, default=0)
        self._count = max(all_of_them) - self._first + 1 if all_of_them else 0
        self._now, self._of = np.zeros((3, 0)), None

    @property
    def size(self) -> int:
        """Number of rows of L."""
        return 4 * self._count

    def rows(self, joint: int) -> slice:
        """Return the four rows of L that belong to a joint."""
        place = 4 * (joint - self._first)
        return slice(place, place + 4)

    def read(self, data: Any) -> Array:
        """Return (3, size) from data.oMi: a view that follows it, not to be written to."""
        if self._of is not data and self._count:  # to fetch it costs more than what is done with it
            self._of, self._now = data, placements_view(data.oMi, self._first, self._count)
        return self._now


# Contact points over planes of the world: what a step with contacts evaluates most often.
#
# The normal n and the axes d stand still, so that the gap and the moments of the axes about the
# origin are linear in the middle p of a contact point:
#
#     gap = n . p - (n . o + radius),    (p - radius n) x d


class GroundContacts(PlaneContacts):
    """Contact points over planes of the world, together; not to be shared between threads."""

    def __init__(self, model: Any, touches: Sequence[PlaneContact]) -> None:
        super().__init__(model, touches)
        k = self.size
        axes = np.reshape([t.plane.rotation.T for t in touches], (k, 3, 3))  # t1, t2, n as rows
        normals = axes[:, 2]
        crosses = np.cross(axes[:, :, None], -np.eye(3)).transpose(0, 1, 3, 2)  # p -> p x d
        moments = crosses.reshape(k, 9, 3)
        self._middles = self._local[:, :k]
        gaps = self._middles[:, None, :] * normals.T  # (size, 3, k)
        self._gap_of = gaps.reshape(3 * len(self._middles), k)
        heights = [np.dot(t.plane.translation, n) for t, n in zip(touches, normals, strict=True)]
        self._lowest = np.reshape(heights, k) + self._radius
        at_surface = moments @ (self._radius[:, None] * normals)[:, :, None]
        self._moment_of = np.concatenate([moments, -at_surface], axis=2)  # of p and 1
        # memory for p and 1, and for the rows d and p x d, with views into it
        points, twists = np.ones((4, k)), np.concatenate([axes, np.zeros((k, 3, 3))], axis=2)
        self._p, self._points, self._p_and_1 = points[:3], points.T, points.T[:, :, None]
        # points of one radius over parallel planes, as feet on a floor: one product for all
        are_same = k and (self._moment_of == self._moment_of[0]).all()
        self._same = self._moment_of[0].T if are_same else None
        self._rows, self._moments = twists.reshape(-1, 6), twists[:, :, 3:]
        self._data: Any = None

    def gaps(self, data: Any) -> Array:
        """Return the signed distances (k,) [m]; reads data.oMi."""
        now = self._placements.read(data)  # (3, size)
        return now.ravel("K").dot(self._gap_of) - self._lowest  # type: ignore[no-any-return]

    def evaluate(self, data: Any) -> tuple[Array, Array]:
        """Return gaps (k,) and the rows t1, t2, n of each point (3 k, nv); reads data.J too."""
        return self.gaps(data), self.rows(data)

    def rows(self, data: Any) -> Array:
        """Return the rows t1, t2, n of each point (3 k, nv); reads data.oMi and data.J."""
        if self._data is not data:  # a view into the memory of data: to fetch it costs more
            self._data, self._J = data, data.J.reshape(6, -1)
        np.dot(self._placements.read(data), self._middles, out=self._p)
        if self._same is None:
            self._moments[:] = (self._moment_of @ self._p_and_1).reshape(-1, 3, 3)
        else:
            self._moments[:] = self._points.dot(self._same).reshape(-1, 3, 3)
        return np.asarray(self._rows.dot(self._J) * self._moves)
