"""How the rows of all points change with q and v, at fixed accelerations.

A point of one moving body on a point of another, or on one of the world. In axes of the world.
`pin.computeRNEADerivatives` leaves a column a joint coordinate, linear part at the world's origin:
J, dV, dA and dA_v, the parts in the axes of the body of what q and v do to the velocity and the
acceleration of every body that moves with it. A point at p with the velocity p' has, of each of
them, lin + ang x p; and since its acceleration is the classical one,

    J         J_lin + J_ang x p
    v_q       dV_lin + dV_ang x p
    a_q       dA_lin + dA_ang x p + 2 dV_ang x p'
    a_v       dA_v_lin + dA_v_ang x p + 2 J_ang x p'

The rows are the difference of two points in the axes of c1. With Ja the angular part of J, body 1's
less body 2's,

    s_q = R1^T (a1_q - a2_q - a2 x Ja),         s_v = R1^T (a1_v - a2_v),
    v_q = R1^T (v1_q - v2_q - v2 x Ja),         c_q = R1^T (J1 - J2 - (p2 - p1) x Ja_1),

and the force F = R1 lam, fixed in c1, turns on body 2: J^T lam changes by J2^T F x Ja. One product
does for all points: 1, p x, p2'' x, p' x and F x of either end, each where it is wanted, with the
columns that all of them meet, J, dA, dA_v and dJ, for dV = dA_v - dJ. On the world all of body 2 is
zero.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.baumgarte import Baumgarte
from condyn_pin.constraints.rows.any_bound import AnyBound
from condyn_pin.constraints.rows.bound import Bound
from condyn_pin.constraints.rows.frames import rows_of
from condyn_pin.constraints.rows.point_ends import AXES, ONE, ROWS, PointEnds
from condyn_pin.constraints.rows.rolling import skews

# What is known of an end, by its rows in `PointEnds.places`: p, p', p'' and F.
_P, _P1, _P2, _F = 3, 4, 5, 6
_MOVING: Final = slice(3 * (_P1 - _P), 3 * (_P2 - _P))  # where `PointEnds.known` has p'
# Where its columns begin: linear and angular ones of J, dA, dA_v and dJ.
_J, _J_ANG, _A, _A_ANG, _AV, _AV_ANG, _DJ_ANG, _DJ = range(0, 24, 3)


def _factors(*terms: tuple[int, float, int | None, int]) -> Array:
    """Return the map of what is known of an end to the factors of its columns, the first of them.

    Of terms (part, number, x, columns), with x None for the product with 1. There are three rows a
    part, and the parts alternate: the x of all of them come first.
    """
    parts = 1 + max(part for part, *_ in terms)
    of = np.zeros((ROWS, 3, 3, parts, 3 + max(columns for *_, columns in terms)))
    for part, number, x, columns in terms:
        three = slice(columns, columns + 3)
        if x is None:
            of[ONE, 0, :, part, three] += number * np.eye(3)
        else:
            for i, e in enumerate(np.eye(3)):
                of[x, i, :, part, three] += number * pin.skew(e)
    return np.ascontiguousarray(of[AXES.stop :].reshape(3 * (ROWS - AXES.stop), -1))


# Of J, -a_q and -a_v, where c1 has the p2'' of its c2, and of F x Ja.
_ACCELERATED: Final = (
    (0, 1.0, None, _J), (0, -1.0, _P, _J_ANG),
    (1, -1.0, None, _A), (1, 1.0, _P, _A_ANG), (1, 1.0, _P2, _J_ANG),
    (1, 2.0, _P1, _AV_ANG), (1, -2.0, _P1, _DJ_ANG),
    (2, -1.0, None, _AV), (2, 1.0, _P, _AV_ANG), (2, 2.0, _P1, _J_ANG),
)  # fmt: skip
_PUSHED: Final = (3, 1.0, _F, _J_ANG)
# Of v_q, where c1 has the p2' of its c2.
_MOVED: Final = _factors(
    (0, 1.0, None, _AV), (0, -1.0, None, _DJ), (0, -1.0, _P, _AV_ANG), (0, 1.0, _P, _DJ_ANG),
    (0, -1.0, _P1, _J_ANG),
)  # fmt: skip


class PointPartials:
    """The partials of all points in one scene.

    `data` holds what `pin.computeRNEADerivatives` leaves.

    Attributes
    ----------
    k, between : int
        How many points there are; of these, how many between two moving bodies.
    """

    def __init__(
        self, model: Any, data: Any, bounds: Sequence[AnyBound], drift: Baumgarte | None
    ) -> None:
        self._data, self._drift, self._n = data, drift, model.nv
        points = [b for b in bounds if isinstance(b, Bound) and b.is_point]
        points.sort(key=lambda b: b.joint2 == 0)  # those between two bodies come first
        self.k, self.between = k, between = len(points), sum(b.joint2 > 0 for b in points)
        self._rows, self._ends = rows_of(points), PointEnds(data, points)
        self._signs = np.array([b.sign for b in points]).reshape(k, 1, 1)
        self._anchored = np.array([float(b.anchored) for b in points]).reshape(k, 1, 1)
        # which columns move the bodies of c1, and those of c2 where they move
        moves = _moved(model, points) * self._signs[:, :, :, None]
        self._moved = np.concatenate((moves[0], moves[1, :between]))
        self._make_room(data, model.nv)
        self._chosen = np.ascontiguousarray(np.broadcast_to(self._moved, self._parts.shape))

    def _make_room(self, data: Any, n: int) -> None:
        """Make the memory of columns and parts, and the views into it that are wanted."""
        k, between = self.k, self.between
        # views into data's own memory; of a single coordinate Pinocchio has vectors
        J, A, A_v, dJ = (part.reshape(6, n) for part in (data.J, data.dAdq, data.dAdv, data.dJ))
        self._left, self._columns = (J, A, A_v, dJ[3:], dJ[:3]), np.zeros((24, n))
        self._first_columns = self._columns[:_DJ]  # what accelerations change with
        # J, -a_q and -a_v, and F x Ja where a body 2 moves
        kinds = 4 if between else 3
        self._accelerated = _factors(*_ACCELERATED, *([_PUSHED] if between else []))
        self._flat_parts = np.zeros((3 * kinds * (k + between), n))
        self._parts = parts = self._flat_parts.reshape(k + between, 3, kinds, n)
        self._slip_between, self._of_c2 = parts[:between], parts[k:]
        self._stacked_slip = parts[:k].reshape(k, 3, kinds * n)
        self._J2T = parts[k:, :, 0].reshape(-1, n).T
        self._turned = parts[:between, :, -1].reshape(-1, n)
        self._rotated = np.zeros((k, 3, kinds * n))
        rows = self._rotated.reshape(3 * k, kinds, n)
        self._J, self._by_state = rows[:, 0], rows[:, 1:3]

    def write(
        self, lam: Array, pulls: Array, by_state: Array, J: Array, ends: PointEnds | None = None
    ) -> None:
        """Write J (m, nv) and by_state, -[s_q, s_v]; add what turns of J^T lam to pulls, -r_q.

        `ends` are those of all points, if they were evaluated with this lam already.
        """
        ends = ends or self._evaluated(lam)
        ends.of_c1[:] = ends.of_c2
        np.concatenate(self._left, out=self._columns)
        self._of_ends(ends.known, self._accelerated, self._first_columns, self._flat_parts)
        self._parts *= self._chosen
        self._slip_between -= self._of_c2
        np.matmul(ends.axes1, self._stacked_slip, out=self._rotated)
        parts = by_state.reshape(-1, 2, self._n)
        J[self._rows], parts[self._rows] = self._J, self._by_state
        if self.between:
            pulls += self._J2T.dot(self._turned)
        if self._drift:
            by_q = self._drift.Kp * self._c_q(ends, J)
            by_q += self._drift.Kd * self._v_q(ends)
            parts[self._rows, 0] -= by_q.reshape(-1, self._n)

    def turning(self, out: Array) -> None:
        """Write v_q (m, nv) of these rows."""
        self._ends.evaluate()
        np.concatenate(self._left, out=self._columns)
        out[self._rows] = self._v_q(self._ends).reshape(-1, self._n)

    def _evaluated(self, lam: Array) -> PointEnds:
        """Return where the points are, with their forces if those have a part in it."""
        self._ends.evaluate()
        if self.between:
            self._ends.push(self._signs * lam[self._rows].reshape(-1, 1, 3))
        return self._ends

    def _of_ends(
        self, known: Array, factors: Array, columns: Array, out: Array | None = None
    ) -> Array:
        """Return what some factors make of the columns, for c1 and behind all of them c2."""
        known = known[: self.k + self.between]
        return known.dot(factors).reshape(-1, len(columns)).dot(columns, out)  # type: ignore[no-any-return]

    def _v_q(self, ends: PointEnds) -> Array:
        """Return the partials of J v by q (k, 3, nv)."""
        known = ends.known.copy()
        known[: self.k, _MOVING] = known[self.k :, _MOVING]
        parts = self._of_ends(known, _MOVED, self._columns).reshape(-1, 3, self._n)
        parts *= self._moved[:, 0]
        parts[: self.between] -= parts[self.k :]
        return np.asarray(ends.axes1 @ parts[: self.k])

    def _c_q(self, ends: PointEnds, J: Array) -> Array:
        """Return the partials of the violation (k, 3, nv), zero without an anchor."""
        apart = skews(ends.places[1, :, _P] - ends.places[0, :, _P])
        turned = ends.axes1 @ apart @ (self._moved[: self.k, 0] * self._left[0][3:])
        return np.asarray(self._anchored * (J[self._rows].reshape(self.k, 3, -1) - turned))


def _moved(model: Any, points: Sequence[Bound]) -> Array:
    """Return (2, k, 1, 1, nv): one where a column moves the body of c1, or that of c2."""
    moved = np.zeros((2, len(points), 1, 1, model.nv))
    for i, b in enumerate(points):
        for end, joint in enumerate((b.joint1, b.joint2)):
            for above in list(model.supports[joint])[1:]:
                at = model.idx_vs[above]
                moved[end, i, ..., at : at + model.nvs[above]] = 1.0
    return moved
