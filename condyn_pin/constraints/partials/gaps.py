"""How the gap of one constraint and its rate change with q, for drift control.

With delta = J_s dq the slip of c1 past c2 that a step makes, M = E1^-1 E2 and u = R e the axis of
a hinge,

    d(-log6 M) = Jlog6(M) X^-1 delta,    d(-log R) = Jlog(R) R^T delta_ang,    du = u x delta_ang.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.partials.formulas import End, Slip, direction, slip_of, spatial_cross
from condyn_pin.constraints.partials.relations import gap_of_relation
from condyn_pin.constraints.rows.bound import Bound
from condyn_pin.constraints.rows.related import Related

_skew = pin.skew

_STRAIGHT = 1e-4  # [rad]; below, the series of (1 - angle cot(angle)) / sin^2 is exact


class ConstraintViolation(NamedTuple):
    """Partial derivatives by q of the rows of one constraint."""

    c_q: Array  # (rows, nv), of the violation; zero without an anchor
    v_q: Array  # (rows, nv), of J v


def gap_of(b: Bound | Related, one: End, two: End, c1Mc2: Any) -> ConstraintViolation:
    """Return the partials of the gap of a constraint and of its rate."""
    if isinstance(b, Related):
        return ConstraintViolation(*gap_of_relation(b, one, two, c1Mc2))
    if b.is_plain and b.size == 6:
        c_q, v_q = _of_weld(one, two, c1Mc2)
    else:
        R, r = c1Mc2.rotation, c1Mc2.translation
        # Pinocchio's ball compares the origins, and a contact without anchor has one only
        at_c2 = not b.is_plain and (b.anchored or b.joint2 > 0)
        slip = slip_of(one, two, R, r, at_c2=at_c2)
        if b.is_rod:
            c_q, v_q = _of_rod(slip, r)
        else:
            pairs = zip((-slip.dr, slip.slip_q), _of_turn(b, one, two, R), strict=True)
            c_q, v_q = (np.vstack(pair)[list(b.selection)] for pair in pairs)
    return ConstraintViolation(c_q if b.anchored else np.zeros_like(c_q), v_q)


def _of_weld(one: End, two: End, c1Mc2: Any) -> tuple[Array, Array]:
    X = c1Mc2.toActionMatrix()
    J = one.J - X @ two.J
    c_q = pin.Jlog6(c1Mc2) @ np.linalg.solve(X, J)
    return c_q, one.v_q - spatial_cross(X @ two.v) @ J - X @ two.v_q


def _of_turn(b: Bound, one: End, two: End, R: Array) -> tuple[Array, Array]:
    Ja = one.J[3:] - R @ two.J[3:]
    v_q = one.v_q[3:] - _skew(R @ two.v[3:]) @ Ja - R @ two.v_q[3:]
    if not b.is_hinge:
        return pin.Jlog3(R) @ R.T @ Ja, v_q
    e = np.eye(3)[b.axis]
    u = R @ e
    across, cosine = np.cross(u, e), float(u @ e)
    sine = float(np.linalg.norm(across))
    angle = np.arctan2(sine, cosine)
    scale = angle / sine if sine else 1.0
    bend = 1 / 3 if angle < _STRAIGHT else (1 - angle * cosine / sine) / sine**2
    u_q = _skew(u) @ Ja
    return -scale * _skew(e) @ u_q - bend * np.outer(across, e @ u_q), v_q


def _of_rod(slip: Slip, r: Array) -> tuple[Array, Array]:
    n, n_q = direction(r, slip.dr)
    return -(n @ slip.dr)[None], (n @ slip.slip_q + slip.slip @ n_q)[None]
