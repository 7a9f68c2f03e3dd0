"""How the rows of a relation change with q and v, at fixed accelerations and forces.

With delta = J_s dq the slip that a step makes, W changes by D(delta), the rate of W at that slip,
which is linear in it, and D(s) by its partials B(delta) at fixed s (`weights_bend`):

    (J v)_q         = W s_q + D(delta) s
    (J a + gamma)_q = W s'_q + D(delta) s' + D(s) s_q + D(s_q) s + B(delta) s
    (J a + gamma)_v = W s'_v + D(s) J_s + D(J_s) s

The wrench f = W^T lam at c2, in the axes of c1, changes by D(delta)^T lam, r by -delta_lin, and
R^T f besides by R^T (delta_ang x f).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.partials.formulas import End, Partials, slip_of, turn_of
from condyn_pin.constraints.rows.related import Related

_skew = pin.skew


class _Slip(NamedTuple):
    """The slip of c1 past c2, all six components, and its partials."""

    J: Array  # (6, nv)
    s: Array  # (6,)
    s_q: Array  # (6, nv)
    dot: Array  # (6,), component by component in the axes of c1
    dot_q: Array
    dot_v: Array


def of_relation(b: Related, one: End, two: End, c1Mc2: Any, lam: Array) -> Partials:
    """Return the partials of the rows, and of the wrenches on both bodies."""
    R, r = c1Mc2.rotation, c1Mc2.translation
    of, W, D = _slip(one, two, R, r), b.relation.weights(R, r), _rates(b, R, r)
    at_slip = np.tensordot(of.s, D, 1)  # D(s)
    bend = np.einsum("irk,k->ri", b.relation.weights_bend(R, r, of.s), of.s)
    by_slip = _applied(D, of.s)  # (rows, 6): delta to D(delta) s
    s_q = W @ of.dot_q + (_applied(D, of.dot) + bend) @ of.J + (at_slip + by_slip) @ of.s_q
    s_v = W @ of.dot_v + (at_slip + by_slip) @ of.J
    f, f_q = W.T @ lam, np.einsum("irk,r->ki", D, lam) @ of.J
    moved = np.concatenate([f_q[:3], f_q[3:] + _skew(r) @ f_q[:3] + _skew(f[:3]) @ of.J[:3]])
    turned = [
        R.T @ (part - _skew(x) @ of.J[3:]) for part, x in ((f_q[:3], f[:3]), (f_q[3:], f[3:]))
    ]
    return Partials(W @ of.J, s_q, s_v, moved, np.concatenate(turned))


def gap_of_relation(b: Related, one: End, two: End, c1Mc2: Any) -> tuple[Array, Array]:
    """Return the partials of c and of J v: that of c is J, for c' = J v."""
    R, r = c1Mc2.rotation, c1Mc2.translation
    of, W = _slip(one, two, R, r), b.relation.weights(R, r)
    return W @ of.J, W @ of.s_q + _applied(_rates(b, R, r), of.s) @ of.J


def wrenches_of_relation(b: Related, c1Mc2: Any, lam: Array) -> tuple[Array, Array]:
    """Return the force at the origin of c1 in its axes, and the same for c2."""
    R, r = c1Mc2.rotation, c1Mc2.translation
    f = b.relation.weights(R, r).T @ lam
    at_c2 = np.concatenate([R.T @ f[:3], R.T @ f[3:]])
    return np.concatenate([f[:3], f[3:] + _skew(r) @ f[:3]]), at_c2


def _rates(b: Related, R: Array, r: Array) -> Array:
    """Return the rate of W at each of the six slips (6, rows, 6)."""
    return np.array([b.relation.weights_rate(R, r, e) for e in np.eye(6)])


def _applied(D: Array, x: Array) -> Array:
    """Return the matrix (rows, 6) of delta to D(delta) x."""
    return np.asarray(np.einsum("irk,k->ri", D, x))


def _slip(one: End, two: End, R: Array, r: Array) -> _Slip:
    shift, turn = slip_of(one, two, R, r, at_c2=True), turn_of(one, two, R)
    w2, alpha2 = R @ two.v[3:], R @ two.a[3:]
    turn_q = one.v_q[3:] - _skew(w2) @ turn.J - R @ two.v_q[3:]
    rate = one.a[3:] - alpha2 + _skew(one.v[3:]) @ w2
    return _Slip(
        np.concatenate([shift.J, turn.J]),
        np.concatenate([shift.slip, one.v[3:] - w2]),
        np.concatenate([shift.slip_q, turn_q]),
        np.concatenate([shift.s, rate]),
        np.concatenate([shift.s_q, turn.s_q]),
        np.concatenate([shift.s_v, turn.s_v]),
    )
