"""How the rows of constraints between two frames change with q and v.

Surfaces and edges on the world, welds, cut joints, rods and relations: the relative motions of
all of them at once (`condyn_pin.constraints.partials.ends`), and what each makes of its own. The
formulas are in `condyn_pin.constraints.partials.formulas`, and those of points, which have less to
do, in `condyn_pin.constraints.partials.points`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.baumgarte import Baumgarte
from condyn_pin.constraints.partials.ends import EndPartials
from condyn_pin.constraints.partials.formulas import (
    End,
    Frames,
    Partials,
    direction,
    dual_cross,
    of_cut,
    of_frame,
    of_pair,
    of_point,
    of_rod,
    of_weld,
)
from condyn_pin.constraints.partials.relations import (
    gap_of_relation,
    of_relation,
    wrenches_of_relation,
)
from condyn_pin.constraints.partials.relative_motion import RelativeMotion, apart, at_c2, twist_of
from condyn_pin.constraints.rows.any_bound import AnyBound
from condyn_pin.constraints.rows.bound import POINT, Bound
from condyn_pin.constraints.rows.related import Related

_skew = pin.skew

_STRAIGHT = 1e-4  # [rad]; below, the series of (1 - angle cot(angle)) / sin^2 is exact


class PairPartials:
    """The partials of all constraints between two frames in one scene, but those of points."""

    def __init__(self, frames: Frames, bounds: Sequence[AnyBound], drift: Baumgarte | None) -> None:
        self._frames, self._drift = frames, drift
        chosen = [
            b for b in bounds if isinstance(b, Related) or (isinstance(b, Bound) and not b.is_point)
        ]
        self._pairs, self.k = chosen, len(chosen)
        self._held = [b for b in chosen if isinstance(b, Bound) and b.is_held]
        self._between = [b for b in chosen if isinstance(b, Related) or not b.is_held]
        several = len(self._between) > 1
        self._ends = EndPartials(frames, self._between) if several else None

    def write(self, lam: Array, pulls: Array, by_state: Array, J: Array) -> None:
        """Write J (m, nv) and by_state, -[s_q, s_v]; add what turns of J^T lam to pulls, -r_q."""
        n = J.shape[1]
        s_q, s_v = by_state[:, :n], by_state[:, n:]  # with the other sign
        for b, of in self._partials(lam, pulls):
            np.multiply(b.sign, of.J, out=J[b.rows])
            np.multiply(-b.sign, of.s_q, out=s_q[b.rows])
            np.multiply(-b.sign, of.s_v, out=s_v[b.rows])
            if self._drift:
                c_q, v_q = gap_of(b, *self._frames.ends(b), self._frames.between(b))
                s_q[b.rows] -= b.sign * (self._drift.Kp * c_q + self._drift.Kd * v_q)

    def _partials(self, lam: Array, pulls: Array) -> Iterator[tuple[Bound | Related, Partials]]:
        """Yield the partials of each constraint; add what turns of J^T lam to -r_q, `pulls`."""
        for held in self._held:
            yield held, of_frame(held, *self._frames.partials(held.joint1, held.placement1))
        for b, one, two, of in self._of_between(lam):
            if of.w1_q is not None:
                pulls += one.J.T @ of.w1_q
            if of.w2_q is not None:
                pulls -= two.J.T @ of.w2_q
            yield b, of

    def _of_between(self, lam: Array) -> Iterator[tuple[Bound | Related, End, End, Partials]]:
        """Yield the constraints between two frames with their ends and partials."""
        if self._ends is None:  # a single one is quicker by itself
            for b in self._between:
                ends = self._frames.ends(b)
                yield b, *ends, _of_pair(b, *ends, self._frames.between(b), _force(b, lam))
            return
        at = self._ends.evaluate()
        twists = twist_of(at.one, at.two, at.X)
        motions = at_c2(twists, at.r)
        for i, b in enumerate(self._between):
            R, r, force = at.R[i], at.r[i], _force(b, lam)
            if isinstance(b, Related):
                of = of_relation(b, motions.of(i), R, r, force)
            elif b.is_plain:
                of = of_weld(twists.of(i), at.X[i], force)
            elif b.is_rod:
                of = of_rod(R, r, motions.of(i), float(force[0]))
            else:
                of = of_cut(b, motions.of(i), R, force)
            yield b, at.one.of(i), at.two.of(i), of

    def turning(self, out: Array) -> None:
        """Write the partials (m, nv) of J v by q."""
        for b in self._pairs:
            if isinstance(b, Bound) and b.is_held:
                v_q, *_ = self._frames.partials(b.joint1, b.placement1)
                out[b.rows] = b.sign * v_q[list(b.selection)]
            else:
                _, v_q = gap_of(b, *self._frames.ends(b), self._frames.between(b))
                out[b.rows] = b.sign * v_q

    def by_frame(self, b: Bound | Related, lam: Array, end: int) -> tuple[Array, Array]:
        """Return r (nv, 6) and s (rows, 6) by a twist of c1 or c2, of a ball too."""
        (one, two), c1Mc2 = self._frames.ends(b), self._frames.between(b)
        moved, rest = (one, two) if end == 1 else (two, one)
        nothing, force = np.zeros((6, 6)), b.sign * lam
        moving = moved.by_twist()
        still = End(rest.v, rest.a, nothing, nothing, nothing, nothing)
        pair = (moving, still) if end == 1 else (still, moving)
        if isinstance(b, Related) or not b.is_held:
            of = _of_pair(b, *pair, c1Mc2, force)
        elif b.selection == POINT:
            of = of_point(moving)
        else:
            of = of_frame(b, moving.v_q, moving.a_q, moving.a_v, moving.J)
        w1 = nothing if of.w1_q is None else of.w1_q
        w2 = nothing if of.w2_q is None else of.w2_q
        at1, at2 = wrenches(b, c1Mc2, force)
        if end == 1:
            w1 = w1 + dual_cross(at1)
        else:
            w2 = w2 + dual_cross(at2)
        s = of.s_q
        if self._drift:
            c_q, v_q = gap_of(b, *pair, c1Mc2)
            s = s + self._drift.Kp * c_q + self._drift.Kd * v_q
        return two.J.T @ w2 - one.J.T @ w1, b.sign * s


def wrenches(b: Bound | Related, c1Mc2: Any, force: Array) -> tuple[Array, Array]:
    """Return the force of a constraint at the origin of c1 in its axes, and the same for c2."""
    if isinstance(b, Related):
        return wrenches_of_relation(b, c1Mc2, force)
    six = np.zeros(6)
    if b.is_rod:
        six[:3] = force[0] * c1Mc2.translation / np.linalg.norm(c1Mc2.translation)
    else:
        six[list(b.selection)] = force
    if b.is_held:  # nothing says where c2 is
        return six, np.zeros(6)
    if b.is_plain and b.size == 6:
        return six, c1Mc2.toActionMatrix().T @ six
    R = c1Mc2.rotation
    on_c2 = np.concatenate([R.T @ six[:3], R.T @ six[3:]])
    if b.is_plain:
        return six, on_c2
    return np.concatenate([six[:3], six[3:] + _skew(c1Mc2.translation) @ six[:3]]), on_c2


def _of_pair(b: Bound | Related, one: End, two: End, c1Mc2: Any, force: Array) -> Partials:
    """Return the partials of a constraint whose other side is somewhere."""
    if isinstance(b, Related):
        R, r = c1Mc2.rotation, c1Mc2.translation
        of = at_c2(twist_of(one, two, c1Mc2.toActionMatrix()), r)
        return of_relation(b, of, R, r, force)
    return of_pair(b, one, two, c1Mc2, force)


def _force(b: Bound | Related, lam: Array) -> Array:
    """Return the rows of lam that act on body 1."""
    return lam[b.rows] if b.sign > 0 else -lam[b.rows]


def gap_of(b: Bound | Related, one: End, two: End, c1Mc2: Any) -> tuple[Array, Array]:
    """Return the partials (rows, nv) of c, zero without an anchor, and of J v by q.

    With delta = J_s dq the displacement of c1 relative to c2, M = E1^-1 E2 and u = R e the axis of
    a hinge,

        d(-log6 M) = Jlog6(M) X^-1 delta,   d(-log R) = Jlog(R) R^T delta_ang,   du = u x delta_ang.
    """
    X, R, r = c1Mc2.toActionMatrix(), c1Mc2.rotation, c1Mc2.translation
    twist = twist_of(one, two, X)
    if isinstance(b, Related):
        return gap_of_relation(b, at_c2(twist, r), R, r)
    if b.is_plain and b.size == 6:
        c_q, v_q = pin.Jlog6(c1Mc2) @ np.linalg.solve(X, twist.J), twist.velocity_q
    else:
        # Pinocchio's ball compares the origins, and a contact without anchor has one only
        levered = not b.is_plain and (b.anchored or b.joint2 > 0)
        of = at_c2(twist, r) if levered else apart(one, two, c1Mc2, twist)
        if b.is_rod:
            c_q, v_q = _of_rod(of, r)
        else:
            chosen = list(b.selection)
            c_q = np.concatenate([-of.dr, _turned(b, R, of.J[3:])])[chosen]
            v_q = of.velocity_q[chosen]
    return c_q if b.anchored else np.zeros_like(c_q), v_q


def _turned(b: Bound, R: Array, Ja: Array) -> Array:
    """Return the partials of the angular part of c."""
    if not b.is_hinge:
        return np.asarray(pin.Jlog3(R) @ R.T @ Ja)
    e = np.eye(3)[b.axis]
    u = R @ e
    across, cosine = _skew(u) @ e, float(u @ e)
    sine = float(np.linalg.norm(across))
    angle = np.arctan2(sine, cosine)
    scale = angle / sine if sine else 1.0
    bend = 1 / 3 if angle < _STRAIGHT else (1 - angle * cosine / sine) / sine**2
    u_q = _skew(u) @ Ja
    return np.asarray(-scale * _skew(e) @ u_q - bend * np.outer(across, e @ u_q))


def _of_rod(of: RelativeMotion, r: Array) -> tuple[Array, Array]:
    n, n_q = direction(r, of.dr)
    return -(n @ of.dr)[None], (n @ of.velocity_q[:3] + of.velocity[:3] @ n_q)[None]
