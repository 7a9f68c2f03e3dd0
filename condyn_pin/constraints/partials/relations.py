"""How the rows of a relation change with q and v, at fixed accelerations and forces.

With delta = J_s dq the displacement of c1 relative to c2, W changes by D(delta), its rate at that
velocity, linear in delta, and D(s) by its partials B(delta) at fixed s (`weights_bend`):

    (J v)_q         = W s_q + D(delta) s
    (J a + gamma)_q = W s'_q + D(delta) s' + D(s) s_q + D(s_q) s + B(delta) s
    (J a + gamma)_v = W s'_v + D(s) J_s + D(J_s) s

The wrench f = W^T lam at c2, in the axes of c1, changes by D(delta)^T lam, r by -delta_lin, and
R^T f besides by R^T (delta_ang x f).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.partials.formulas import Partials
from condyn_pin.constraints.partials.relative_motion import RelativeMotion
from condyn_pin.constraints.rows.related import Related

_skew = pin.skew


def of_relation(b: Related, of: RelativeMotion, R: Array, r: Array, lam: Array) -> Partials:
    """Return the partials of the rows, and of the wrenches on both bodies."""
    W, D = b.relation.weights(R, r), _rates(b, R, r)
    at_s = np.tensordot(of.velocity, D, 1)  # D(s)
    bend = np.einsum("irk,k->ri", b.relation.weights_bend(R, r, of.velocity), of.velocity)
    by_s = _applied(D, of.velocity)  # (rows, 6): delta to D(delta) s
    s_q = W @ of.s_q + (_applied(D, of.s) + bend) @ of.J + (at_s + by_s) @ of.velocity_q
    s_v = W @ of.s_v + (at_s + by_s) @ of.J
    f, f_q = W.T @ lam, np.einsum("irk,r->ki", D, lam) @ of.J
    moved = np.concatenate([f_q[:3], f_q[3:] + _skew(r) @ f_q[:3] + _skew(f[:3]) @ of.J[:3]])
    turned = [
        R.T @ (part - _skew(x) @ of.J[3:]) for part, x in ((f_q[:3], f[:3]), (f_q[3:], f[3:]))
    ]
    return Partials(W @ of.J, s_q, s_v, moved, np.concatenate(turned))


def gap_of_relation(b: Related, of: RelativeMotion, R: Array, r: Array) -> tuple[Array, Array]:
    """Return the partials of c and of J v: that of c is J, for c' = J v."""
    W = b.relation.weights(R, r)
    return W @ of.J, W @ of.velocity_q + _applied(_rates(b, R, r), of.velocity) @ of.J


def wrenches_of_relation(b: Related, c1Mc2: Any, lam: Array) -> tuple[Array, Array]:
    """Return the force at the origin of c1 in its axes, and the same for c2."""
    R, r = c1Mc2.rotation, c1Mc2.translation
    f = b.relation.weights(R, r).T @ lam
    at_c2 = np.concatenate([R.T @ f[:3], R.T @ f[3:]])
    return np.concatenate([f[:3], f[3:] + _skew(r) @ f[:3]]), at_c2


def _rates(b: Related, R: Array, r: Array) -> Array:
    """Return the rate of W at each of the six unit velocities (6, rows, 6)."""
    return np.array([b.relation.weights_rate(R, r, e) for e in np.eye(6)])


def _applied(D: Array, x: Array) -> Array:
    """Return the matrix (rows, 6) of delta to D(delta) x."""
    return np.asarray(np.einsum("irk,k->ri", D, x))
