"""How the rows of one constraint change with q and v, at fixed accelerations and forces.

The rows themselves are in `condyn_pin.constraints.rows.loops`, `cut_joints` and `rods`, and how
relative velocities change in `relative_motion`; the rest follows by the product rule. A force that
is fixed in c1 turns in c2: its wrench on body 2 changes too, and that on body 1 where its lever
does.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from condyn_pin._core._pin import LOCAL, pin
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.partials.relative_motion import (
    RelativeMotion,
    apart,
    at_c2,
    spatial_cross,
    twist_of,
)
from condyn_pin.constraints.rows.bound import FRAME, Bound
from condyn_pin.constraints.rows.related import Related

_skew = pin.skew


class End(NamedTuple):
    """One end of a constraint: a frame on a joint, everything in its own axes; or many of them."""

    v: Array  # (6,)
    a: Array  # (6,), spatial
    v_q: Array  # (6, nv)
    a_q: Array
    a_v: Array
    J: Array

    def classical(self) -> tuple[Array, Array, Array]:
        """Return the acceleration of the origin, and its derivatives by q and v."""
        v, w = self.v[:3], self.v[3:]
        W, V = _skew(w), _skew(v)
        return (
            self.a[:3] + W @ v,
            self.a_q[:3] + W @ self.v_q[:3] - V @ self.v_q[3:],
            self.a_v[:3] + W @ self.J[:3] - V @ self.J[3:],
        )

    def of(self, i: int) -> End:
        """Return one among many."""
        return End(*(part[i] for part in self))

    def by_twist(self) -> End:
        """Return it with its partials by a twist of the frame on its body."""
        turning = spatial_cross(self.v), spatial_cross(self.a)
        return End(self.v, self.a, *turning, np.zeros((6, 6)), np.eye(6))


class Frames:
    """The frames that constraints hold, from what Pinocchio's derivatives left in its data."""

    def __init__(self, model: Any, data: Any) -> None:
        self._model, self.data = model, data
        self._world = End(*np.zeros((2, 6)), *np.zeros((4, 6, model.nv)))

    @property
    def nv(self) -> int:
        """Number of coordinates."""
        return int(self._model.nv)

    def moves(self, joint: int) -> Array:
        """Return one where a coordinate moves a joint (nv,)."""
        moved = np.zeros(self.nv)
        for above in list(self._model.supports[joint])[1:]:
            at = self._model.idx_vs[above]
            moved[at : at + self._model.nvs[above]] = 1.0
        return moved

    def between(self, b: Bound | Related) -> Any:
        """Return c1Mc2."""
        oMi = self.data.oMi
        return (oMi[b.joint1] * b.placement1).actInv(oMi[b.joint2] * b.placement2)

    def ends(self, b: Bound | Related) -> tuple[End, End]:
        """Return c1 and c2."""
        return self.end(b.joint1, b.placement1), self.end(b.joint2, b.placement2)

    def end(self, joint: int, placement: Any) -> End:
        """Return a frame on a joint as the end of a constraint."""
        if joint == 0:
            return self._world
        v, a = placement.actInv(self.data.v[joint]), placement.actInv(self.data.a[joint])
        return End(v.vector, a.vector, *self.partials(joint, placement))

    def partials(self, joint: int, placement: Any) -> tuple[Array, Array, Array, Array]:
        """Return v_q, a_q, a_v and J of a frame on a joint."""
        found: tuple[Array, Array, Array, Array] = pin.getFrameAccelerationDerivatives(
            self._model, self.data, joint, placement, LOCAL
        )
        if self._model.nv > 1:
            return found
        v_q, a_q, a_v, J = (part.reshape(6, 1) for part in found)  # Pinocchio gives vectors
        return v_q, a_q, a_v, J


class Partials(NamedTuple):
    """Partial derivatives of the rows of one constraint, and of its wrenches on the two bodies."""

    J: Array  # (rows, nv)
    s_q: Array  # (rows, nv), of J a + gamma
    s_v: Array  # (rows, nv)
    w1_q: Array | None = None  # (6, nv), of the wrench at the origin of c1, in its axes
    w2_q: Array | None = None  # (6, nv), the same of c2


def of_frame(b: Bound, _v_q: Array, a_q: Array, a_v: Array, J: Array) -> Partials:
    """Return the partials of a surface or an edge: rows of the frame's own velocity."""
    if b.selection == FRAME:
        return Partials(J, a_q, a_v)
    chosen = list(b.selection)
    return Partials(J[chosen], a_q[chosen], a_v[chosen])


def of_point(one: End) -> Partials:
    """Return the partials of a point on the world."""
    _, a_q, a_v = one.classical()
    return Partials(one.J[:3], a_q, a_v)


def of_pair(b: Bound, one: End, two: End, c1Mc2: Any, lam: Array) -> Partials:
    """Return the partials of a loop between two bodies, or with an anchor in the world."""
    X = c1Mc2.toActionMatrix()
    twist = twist_of(one, two, X)
    if b.is_plain and b.size == 6:
        return of_weld(twist, X, lam)
    if b.is_plain:
        return of_cut(b, apart(one, two, c1Mc2, twist), c1Mc2.rotation, lam)
    of = at_c2(twist, c1Mc2.translation)
    if b.is_rod:
        return of_rod(c1Mc2.rotation, c1Mc2.translation, of, float(lam[0]))
    return of_cut(b, of, c1Mc2.rotation, lam)


def of_weld(twist: RelativeMotion, X: Array, lam: Array) -> Partials:
    """Return the partials of a weld between two bodies."""
    return Partials(twist.J, twist.s_q, twist.s_v, None, X.T @ dual_cross(lam) @ twist.J)


def of_cut(b: Bound, of: RelativeMotion, R: Array, lam: Array) -> Partials:
    """Return the partials of a ball or of a cut joint between two bodies."""
    chosen, six = list(b.selection), np.zeros(6)
    six[chosen] = lam
    F, T = _skew(six[:3]), _skew(six[3:])
    # a plain ball is held at both origins: no lever changes
    w1_q = None if b.is_plain else np.concatenate([np.zeros_like(of.dr), -F @ of.dr])
    w2_q = -np.concatenate([R.T @ F @ of.J[3:], R.T @ T @ of.J[3:]])
    return Partials(of.J[chosen], of.s_q[chosen], of.s_v[chosen], w1_q, w2_q)


def of_rod(R: Array, r: Array, of: RelativeMotion, lam: float) -> Partials:
    """Return the partials of n . s' - (|s|^2 - (n . s)^2) / |r|, and of the force lam n."""
    v, v_q, dr = of.velocity[:3], of.velocity_q[:3], of.dr
    distance, J = float(np.linalg.norm(r)), of.J[:3]
    n, n_q = direction(r, dr)
    along, along_q = n @ v, n @ v_q + v @ n_q
    across = v @ v - along**2
    s_q = n @ of.s_q[:3] + of.s[:3] @ n_q + across / distance**2 * (n @ dr)
    s_q -= 2 * (v @ v_q - along * along_q) / distance
    s_v = n @ of.s_v[:3] - 2 * (v @ J - along * (n @ J)) / distance
    F_q, F = lam * n_q, lam * _skew(n)
    w1_q = np.concatenate([F_q, _skew(r) @ F_q - F @ dr])
    turned = R.T @ (F_q - F @ of.J[3:])
    w2_q = np.concatenate([turned, np.zeros_like(turned)])
    return Partials((n @ J)[None], s_q[None], s_v[None], w1_q, w2_q)


def direction(r: Array, dr: Array) -> tuple[Array, Array]:
    """Return n = r / |r| and how it changes."""
    distance = np.linalg.norm(r)
    n = r / distance
    return n, (np.eye(3) - np.outer(n, n)) @ dr / distance


def dual_cross(wrench: Array) -> Array:
    """Return the matrix D with D x = x x* wrench, for a spatial motion x."""
    D, F = np.zeros((6, 6)), _skew(-wrench[:3])
    D[:3, 3:] = D[3:, :3] = F
    D[3:, 3:] = _skew(-wrench[3:])
    return D
