"""Partial derivatives by q of gaps and rows of contacts.

Column i of the rows of a contact point P is m_i u_i, the velocity of P that a unit of coordinate i
gives to the body, m = 1, or to the ground, m = -1. With w_i its angular velocity, P moved along by
the body, and all of it seen from the ground,

    d(m_i u_i)/dq_j = m_i m_j (w_j x u_i)    if i belongs to the joint of j or to one below it,
                      m_i m_j (w_i x u_j)    else,

the other way round where j moves the ground; what moves both is no change. A ball of radius r on a
plane with normal n is touched at its middle less r n, which adds m_i m_j w_i x (w_j x r n). Stops
and dry friction have rows that stay; `meetings` has those of shapes that meet. Where the axes of a
joint turn with its own q, and where shapes meet in a point without a derivative, rows are
differenced:

    f'(0) d ~ sum_k w_k (f(k h d) - f(-k h d)) / h
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, Final, NamedTuple

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.models import joints_with_turning_axes, whole_data
from condyn_pin.constraints.contacts.candidates import Candidates, Pairs
from condyn_pin.constraints.contacts.on_ground import Found
from condyn_pin.constraints.contacts.shapes import Core, lengths_of, on_face, segments
from condyn_pin.constraints.contacts.touches import (
    BoundContact,
    Pair,
    Placements,
    PlaneContact,
    columns,
)
from condyn_pin.constraints.rows.cables import Lines
from condyn_pin.constraints.rows.special import skews
from condyn_pin.errors import UnsupportedConstraint

_WEIGHTS: Final = (4 / 5, -1 / 5, 4 / 105, -1 / 280)
_H: Final = 2.0**-12  # [rad, m]: rounding leaves 1e-12


class ContactTurning:
    """Partials of the rows of all candidates of one model; not to be shared between threads."""

    def __init__(self, model: Any, bounds: Sequence[BoundContact]) -> None:
        self._model, self._data = model, whole_data(model)
        self._candidates = Candidates(model, bounds)
        touches = [touch for bound in bounds for touch in bound.touches]
        pairs = [pair for bound in bounds for pair in bound.pairs]
        closed = not joints_with_turning_axes(model)
        lines = [each.line for bound in bounds for each in bound.lines]
        self._over_planes = _OverPlanes(model, touches) if touches and closed else None
        self._lines = Lines(model, lines) if lines and closed else None
        stops = sum(len(bound.stops) for bound in bounds)
        first = 3 * self._candidates.cones + stops
        self._of_lines = slice(first, first + len(lines))
        self._meetings = MeetingTurning(model, pairs) if pairs and closed else None
        self._moves = bool(touches or pairs or lines)
        self._differences = self._moves and not closed

    def go(self, q: Array, J: Array) -> None:
        """Evaluate at a configuration q; J (rows, nv) are the rows of all candidates there."""
        self._q = q
        if self._over_planes is None and self._meetings is None and self._lines is None:
            return
        pin.computeJointJacobians(self._model, self._data, q)
        if self._over_planes is not None:
            self._over_planes.go(self._data, J[: 3 * self._candidates.contact_points])
        if self._meetings is not None:
            self._differences = not self._meetings.go(self._data)
        if self._lines is not None:
            self._K = self._lines.bend(self._data)

    def by_q(self, velocities: Sequence[Array], lam: Array) -> tuple[Array, Array]:
        """Partials by q: of J w for each w (count, rows, nv), and of J^T lam (nv, nv)."""
        W = np.array(velocities)
        if self._differences:
            return self._differenced(W, lam)
        pulls, first = (
            np.zeros((self._model.nv, self._model.nv)),
            3 * self._candidates.contact_points,
        )
        if self._over_planes is not None:
            pulls += self._over_planes.pulls(lam)
        if self._meetings is not None:
            pulls += self._meetings.pulls(lam[first : first + self._meetings.size])
        if self._lines is not None:
            pulls += np.einsum("kij,k->ij", self._K, lam[self._of_lines])
        return self._slips(W), pulls

    def velocity_by_q(self, w: Array) -> Array:
        """Partials of J w by q (rows, nv), w (nv,) fixed."""
        if self._differences:
            return np.asarray(self.by_q((w,), np.zeros(self._candidates.rows))[0][0])
        return np.asarray(self._slips(w[None])[0])

    def _slips(self, W: Array) -> Array:
        """Partials of J w by q of all rows; the rows of stops and dry friction are constant."""
        by_q, first = np.zeros((len(W), self._candidates.rows, self._model.nv)), 0
        for part in (self._over_planes, self._meetings):
            if part is not None:
                slips = part.slips(W)
                by_q[:, first : first + slips.shape[1]] = slips
                first += slips.shape[1]
        if self._lines is not None:
            by_q[:, self._of_lines] = np.einsum("kij,ci->ckj", self._K, W)
        return by_q

    def _differenced(self, W: Array, lam: Array) -> tuple[Array, Array]:
        (count, n), m = W.shape, len(lam)

        def turned(step: Array) -> Array:
            at = pin.integrate(self._model, self._q, step)
            pin.computeJointJacobians(self._model, self._data, at)
            J = self._candidates.evaluate(self._data, at)[1]
            return np.concatenate(((W @ J.T).ravel(), lam.dot(J)))

        by_q = np.zeros((count * m + n, n))
        for i, along in enumerate(np.eye(n)):
            for k, weight in enumerate(_WEIGHTS, start=1):
                change = turned(k * _H * along) - turned(-k * _H * along)
                by_q[:, i] += weight / _H * change
        return by_q[: count * m].reshape(count, m, n), by_q[count * m :]


class _OverPlanes:
    """Partials of contact points over planes, in closed form, in the axes of their planes.

    Attributes
    ----------
    _u, _w : (5, k, nv) array
        m u and m w of each column along t1, t2, n, and t1, t2 once more (`_cross_products`).
    """

    def __init__(self, model: Any, touches: Sequence[PlaneContact]) -> None:
        self._k, self._n = k, n = len(touches), model.nv
        self._placements = Placements(t.ground for t in touches)
        axes = np.zeros((self._placements.size, 5, k))
        for i, t in enumerate(touches):
            of_plane = t.plane.homogeneous[:, :3]
            axes[self._placements.rows(t.ground), :, i] = of_plane[:, _CYCLE]
        self._axes = axes.reshape(-1, 5 * k)
        self._rows = np.add.outer(_CYCLE, 3 * np.arange(k))  # those of u among the rows of J
        body = np.reshape([columns(model, t.joint) for t in touches], (k, n))
        ground = np.reshape([columns(model, t.ground) for t in touches], (k, n))
        self._moves, self._grounds_move = body - ground, bool(ground.any())
        self._of_ground, self._of_body = self._moves < 0, self._moves > 0
        self._radial = np.zeros((5, k, 1))  # (0, 0, radius)
        self._radial[2, :, 0] = [t.radius for t in touches]
        self._is_round = bool(self._radial.any())
        self._below = np.zeros((n, n))  # [i, j]: column i belongs to the joint of j, or below it
        for joint in list(model.joints)[1:]:
            self._below[joint.idx_v : joint.idx_v + joint.nv] = columns(model, joint.id)
        self._is_below, self._rest = self._below > 0, 1.0 - self._below

    def go(self, data: Any, J: Array) -> None:
        """Evaluate at data.oMi and data.J; J (3 k, nv) are the rows there."""
        axes = self._placements.read(data).dot(self._axes).T  # (5 k, 3)
        turning = axes.dot(data.J.reshape(6, -1)[3:]).reshape(5, self._k, self._n)
        self._w, self._u = turning * self._moves, J.take(self._rows, axis=0)
        if self._is_round:
            self._rolled = _cross_products(self._w, self._radial).take(_CYCLE, axis=0)

    def slips(self, W: Array) -> Array:
        """Partials of J x by q for all x in the rows of W (count, 3 k, nv)."""
        # Column j is m_j w_j x (what is below moves) + (what is not below turns) x m_j u_j, and the
        # other way round where it moves the ground.
        u, w, below, rest = self._u[:, None], self._w[:, None], self._below, self._rest
        moved, turned = u * W[:, None], w * W[:, None]  # (5, count, k, nv), to be summed
        slip, spin = _sums(moved, below), _sums(turned, rest)
        if self._grounds_move:
            slip = np.where(self._of_ground, _sums(moved, rest), slip)
            spin = np.where(self._of_ground, _sums(turned, below), spin)
        by_q = _cross_products(w, slip)
        by_q += _cross_products(spin, u)
        if self._is_round:
            by_q += _cross_products(turned.sum(axis=-1, keepdims=True), self._rolled[:, None])
        return by_q.transpose(1, 2, 0, 3).reshape(len(W), -1, self._n)

    def pulls(self, lam: Array) -> Array:
        """Partials of J^T lam by q (nv, nv)."""
        # Entry i, j is m_i m_j (u_i x lam) . w_j where i is below j, and else that of j, i; the
        # other way round where j moves the ground.
        lam = lam.take(self._rows)[..., None]
        arms, w, is_below = _cross_products(self._u, lam), self._w[:3], self._is_below
        if not self._grounds_move:
            below = _summed_products(arms, w)
            by_q = np.where(is_below, below, below.T)
        else:
            body, ground = self._of_body, self._of_ground
            by_q = np.where(
                is_below, _summed_products(arms, w * body), _summed_products(w, arms * body)
            )
            by_q += np.where(
                is_below, _summed_products(w, arms * ground), _summed_products(arms, w * ground)
            )
        if self._is_round:
            by_q += _summed_products(w, _cross_products(self._rolled, lam))
        return by_q


def _sums(each: Array, which: Array) -> Array:
    """Sums (..., n) over columns (..., n) that belong to each: `which` (n, n)."""
    return np.asarray(each.reshape(-1, len(which)).dot(which)).reshape(each.shape)


def _cross_products(a: Array, b: Array) -> Array:
    """Cross products a x b (3, ...), of vectors as (5, ...): x, y, z, and x, y once more."""
    by = a[1:4] * b[2:5]
    by -= a[2:5] * b[1:4]
    return by


def _summed_products(a: Array, b: Array) -> Array:
    """Scalar products a_i . b_j, summed over all contacts (n, n), of a and b (3, k, n)."""
    n = a.shape[-1]
    return np.asarray(a.reshape(-1, n).T.dot(b.reshape(-1, n)))


_CYCLE: Final = np.array([0, 1, 2, 0, 1])


# Which features of two shapes meet at a point, and how it moves with the bodies.
#
# Points a of A and b of B are on a corner, an edge or a face each, in whose directions d they slide
# along their bodies; the rest of what is across n is across a - b = G n, the gap between the cores.
# A twist (v, w) of A past B, with v_a = v + w x a the velocity that A has at a, gives
#
#     d . n' = d . (w x n),  0,  d . v_a / G     along A's directions, B's, and what is across both
#     n' = U (w x n) + R v_a,    a' = v_a - U^T (v_a - G n')
#
# with U and R the sums of c d^T over A's directions and of c d^T / G over the rest, c . d = 1 and c
# across all others. A corner on a face of B has neither U nor R. Where corners and edges meet that
# are on the rim of a face along n, that face counts: derivatives are those on one side.


CORNER, EDGE, FACE, NONE = 0, 1, 2, 3
_STILL: Final = np.zeros((3, 3))


class Sliding(NamedTuple):
    """Motion of the point of A and of the normal with the bodies: U, R and G, as above."""

    U: Array  # (3, 3)
    R: Array  # (3, 3) [1/m]
    between: float  # G [m]


class Feature(NamedTuple):
    """Smallest feature of a core at a point: corner, edge with its direction, face or none."""

    kind: int
    along: Array


def of_balls(normal: Array, between: float) -> Sliding:
    """Motion of the nearest points of two balls, `between` their middles [m]."""
    return Sliding(_STILL, _across(normal) / between, between)


def sliding(A: Core, B: Core, a: Array, normal: Array, between: float) -> Sliding | None:
    """Motion of the contact point on the core of A with B; None if it has no derivative."""
    b = a - between * normal
    one, two = feature(A, a), feature(B, b)
    if one.kind == CORNER and (two.kind == FACE or _has_face(B, b, normal)):
        return Sliding(_STILL, _STILL, between)
    if two.kind == CORNER and (one.kind == FACE or _has_face(A, a, -normal)):
        return Sliding(_across(normal), _STILL, between)
    if one.kind == two.kind == EDGE:
        c = np.cross(two.along, normal)
        return Sliding(np.outer(c / c.dot(one.along), one.along), _STILL, between)
    if one.kind + two.kind > EDGE or between <= tolerances.ON_FACE * max(A.size, B.size):
        return None
    along = one.along + two.along  # of the only edge
    rest = _across(normal) - np.outer(along, along)
    return Sliding(np.outer(one.along, one.along), rest / between, between)


def feature(core: Core, point: Array) -> Feature:
    """Smallest feature of a core at a point."""
    off, none = tolerances.ON_FACE * core.size, np.zeros(3)
    if lengths_of(core.vertices - point)[0].min() <= off or core.is_point:
        return Feature(CORNER, none)
    start, along = segments(core)
    away = point - start
    share = (away * along).sum(axis=1) / (along**2).sum(axis=1)
    apart = lengths_of(away - np.clip(share, 0.0, 1.0)[:, None] * along)[0]
    nearest = int(apart.argmin())
    if apart[nearest] <= off:
        return Feature(EDGE, lengths_of(along[nearest : nearest + 1])[1][0])
    if core.is_solid:
        heights = core.normals.dot(point) - core.heights
        if np.abs(heights).min() <= off and on_face(core, point[None])[0]:
            return Feature(FACE, none)
    return Feature(NONE, none)


def _has_face(core: Core, point: Array, normal: Array) -> bool:
    """True if a point is in the plane of a face with a normal."""
    turned = np.abs(core.normals - normal).max(axis=1, initial=0.0)
    off = np.abs(core.normals.dot(point) - core.heights)
    near = (turned <= tolerances.ON_FACE) & (off <= tolerances.ON_FACE * core.size)
    return bool(near.any())


def _across(normal: Array) -> Array:
    return np.eye(3) - np.outer(normal, normal)


# How the rows of points where shapes meet change with q.
#
# A point P of body A on body B has the rows E^T (V_l + V_a x P), E = (t1, t2, n) and V = (V_l, V_a)
# the twist of A past B. With S the column of a coordinate that moves one of them, m = 1 for A and
# -1 for B, and V_0 the twist of what carries its joint,
#
#     V' = m (V_0 - V_A) x S,    P' = m (a' - r n'),    E' = m (n x n') x E,    seen from what B
#     does
#     (J w)' = E^T (V_l' + V_a' x P + V_a x P' - (n x n') x (V_l + V_a x P))
#
# a' and n' are those of `features`, r the skin of A. Turning around n is left out of E': friction
# is the same along every tangent. Wrenches F = (f, P x f) of the rows turn with P and E, and the
# columns S_i that feel them with the joints that carry theirs, S_i' = S_j x S_i.


class MeetingTurning:
    """Partials of the rows of all pairs of one model; not to be shared between threads."""

    def __init__(self, model: Any, pairs: Sequence[Pair]) -> None:
        self._pairs, self._places = tuple(pairs), Pairs(model, pairs)
        self.size = 3 * self._places.size  # number of rows
        self._first = np.cumsum([0, *(pair.points for pair in pairs)])[:-1]  # place of each pair
        each = [pair for pair in pairs for _ in range(pair.points)]
        self._bodies = np.array([pair.joint for pair in each])
        self._of_grounds = np.array([pair.ground for pair in each])
        supports = np.array([columns(model, joint) for joint in range(model.njoints)])
        self._supports = supports  # [joint, j]: whether column j moves it
        of_column = np.repeat(np.arange(model.njoints), list(model.nvs))
        self._carriers = np.array(list(model.parents))[of_column]
        self._below = supports[of_column]  # [i, j]: column i belongs to the joint of j, or below it
        self._grounds = supports[self._of_grounds][:, None]
        self._moves = supports[self._bodies][:, None] - self._grounds  # m (k, 1, nv)

    def go(self, data: Any) -> bool:
        """Evaluate at data.oMi and data.J; return True if all points have derivatives."""
        self._S = S = data.J.reshape(6, -1).copy()
        self._P, self._E = self._places.points(data), self._places.axes(data)
        gaps, n = self._places.gaps(data), self._E[:, :, 2]
        places = (np.split(x, self._first[1:]) for x in (gaps, self._P, n))
        parts = zip(self._pairs, self._places.are_balls(data).tolist(), *places, strict=True)
        features = self._places.features(data)
        found = [
            of
            for i, (pair, *part) in enumerate(parts)
            for of in (
                _slidings(data, pair, *part) if pair.surface is None
                else _on_ground(pair, features[i], part[-1])
            )
        ]  # fmt: skip
        ways = [of for of, _ in found if of is not None]
        if len(ways) < len(found):
            return False
        U, R, G = (np.array(part) for part in zip(*ways, strict=True))
        r = np.array([skin for _, skin in found])
        G, r, a = G[:, None, None], r[:, None, None], self._P + r[:, None] * n
        v_a = S[:3] - skews(a) @ S[3:]
        turned = R @ v_a - U @ skews(n) @ S[3:]  # n'
        self._P_moved = v_a - U.transpose(0, 2, 1) @ (v_a - G * turned) - r * turned
        self._E_turned = skews(n) @ turned
        self._has_point = np.isfinite(gaps)
        return True

    def slips(self, W: Array) -> Array:
        """Partials of J w by q for all w in the rows of W (count, rows, nv)."""
        return np.array([self._slip(w) for w in W])

    def _slip(self, w: Array) -> Array:
        S, P, E = self._S, self._P, self._E
        twists = (S * w).dot(self._supports.T)  # of all joints (6, count)
        of_body, of_ground = twists.T[self._bodies], twists.T[self._of_grounds]
        V = of_body - of_ground
        off = twists[:, self._carriers] - of_body[:, :, None]  # V_0 - V_A (k, 6, nv)
        linear = _cross(off[:, 3:], S[:3]) + _cross(off[:, :3], S[3:])
        angular = _cross(off[:, 3:], S[3:])
        u = V[:, :3] + np.cross(V[:, 3:], P)
        by_q = linear - skews(P) @ angular + skews(V[:, 3:]) @ self._P_moved
        by_q += skews(u) @ self._E_turned
        by_q = E.transpose(0, 2, 1) @ (self._moves * by_q)
        by_q[~self._has_point] = 0.0
        return np.asarray(by_q.reshape(self.size, -1))

    def pulls(self, lam: Array) -> Array:
        """Partials of J^T lam by q (nv, nv)."""
        S, P, m = self._S, self._P, self._moves
        f = (self._E @ lam.reshape(-1, 3, 1))[:, :, 0]
        P_moved = self._grounds * (S[:3] - skews(P) @ S[3:]) + m * self._P_moved
        f_turned = -skews(f) @ (self._grounds * S[3:] + m * self._E_turned)
        moment_turned = skews(P) @ f_turned - skews(f) @ P_moved
        by_q = np.einsum("ki,ai,kaj->ij", m[:, 0], S[:3], f_turned)
        by_q += np.einsum("ki,ai,kaj->ij", m[:, 0], S[3:], moment_turned)
        force, moment = m[:, 0].T.dot(f), m[:, 0].T.dot(np.cross(P, f))  # that columns feel
        across = np.cross(S[:3].T, force) + np.cross(S[3:].T, moment)
        felt = np.cross(S[3:].T, force).dot(S[:3]) + across.dot(S[3:])
        return np.asarray(by_q + self._below * felt)


_NOWHERE: Final = Sliding(np.zeros((3, 3)), np.zeros((3, 3)), 0.0)


def _on_ground(pair: Pair, found: Found, normals: Array) -> Iterator[tuple[Sliding | None, float]]:
    """Yield the motion of each place of a shape on a ground, or None, and its skin [m]."""
    r = pair.shape.radius
    for (one, two), (along, other), gap, n in zip(
        found.kinds.tolist(), found.along, found.gaps.tolist(), found.normals, strict=True
    ):
        between = gap + r
        if pair.shape.half_axes is not None:  # a cylinder: by differences
            yield None, r
        elif (one, two) == (CORNER, FACE):
            yield Sliding(_STILL, _STILL, between), r
        elif (one, two) == (FACE, CORNER):
            yield Sliding(_across(n), _STILL, between), r
        elif one == two == EDGE:
            c = np.cross(other, n)
            yield Sliding(np.outer(c / c.dot(along), along), _STILL, between), r
        elif between <= tolerances.SHARP:
            raise UnsupportedConstraint(
                f"{pair.name}: a sharp corner is {between:.1g} m from an edge or a corner of the "
                "ground, where its normal has no derivative; a Ball or a Capsule has one there"
            )
        else:
            across = _across(n) - np.outer(along, along) - np.outer(other, other)
            yield Sliding(np.outer(along, along), across / between, between), r
    yield from ((_NOWHERE, r) for _ in range(len(normals) - len(found.gaps)))


def _slidings(
    data: Any, pair: Pair, are_balls: bool, gaps: Array, points: Array, normals: Array
) -> Iterator[tuple[Sliding | None, float]]:
    """Yield the motion of each contact point of a pair, or None, and the skin of A [m]."""
    A = pair.shape.placed(data.oMi[pair.joint] * pair.placement)
    B = pair.ground_shape.placed(data.oMi[pair.ground] * pair.ground_placement)
    r, other = (A.reach, B.reach) if are_balls else (A.radius, B.radius)
    for gap, point, n in zip(gaps, points, normals, strict=True):
        between = float(gap) + r + other
        if gap == np.inf:
            yield _NOWHERE, r
        elif B.is_plane:  # by differences
            yield None, r
        elif are_balls:
            yield of_balls(n, between), r
        else:
            yield sliding(A, B, point + r * n, n, between), r


def _cross(a: Array, b: Array) -> Array:
    """Cross products a x b of (k, 3, nv) and (3, nv)."""
    return np.cross(a, b, axisa=1, axisb=0, axisc=1)
