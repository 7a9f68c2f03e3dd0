"""Rows of constraints as formulas of SymPy: J of each kind that has one.

J v of a constraint between frames c1 and c2 is selected from the velocity of c1 relative to c2, in
the axes of c1. The Jacobians (6, nv) of both and the placement of c2 in c1 give it.
"""

from __future__ import annotations

from typing import Any, Final, Protocol

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.constraints.rows.bound import FRAME, POINT, BoundBetweenFrames, BoundConstraint
from condyn_pin.constraints.rows.special import (
    BoundCoupling,
    BoundRelation,
    BoundRolling,
    RelativePosition,
)
from condyn_pin.errors import UnsupportedConstraint

# Entries of rotations below this are rounding of cos(90 deg).
_ROUNDING: Final = 1e-15


class Bodies(Protocol):
    """Bodies of a model in symbols: q (nq, 1), and frames of joints."""

    q: Any
    nv: int

    def frame(self, joint: int, placement: Any) -> tuple[tuple[Any, Any], Any]:
        """Placement (R, p) of a frame in the world, and its Jacobian (6, nv) in own axes."""


def symbolic_rows(sp: Any, bodies: Bodies, bound: BoundConstraint) -> Any:
    """Rows of J (size, nv) of one constraint, with its sign."""
    if isinstance(bound, BoundCoupling):
        return _coupled(sp, bodies, bound)
    if isinstance(bound, BoundRolling):
        return _rolled(sp, bodies, bound)
    relative = isinstance(bound, BoundRelation) and isinstance(bound.relation, RelativePosition)
    if not isinstance(bound, BoundBetweenFrames) and not relative:
        raise UnsupportedConstraint(
            f"{bound.name}: rows of functions have no formula here; write them in SymPy beside "
            "those of symbolic()"
        )
    b: Any = bound
    (R1, p1), J1 = bodies.frame(b.joint1, b.placement1)
    if isinstance(bound, BoundBetweenFrames) and bound.is_held:
        return b.sign * J1[list(b.selection), :]
    (R2, p2), J2 = bodies.frame(b.joint2, b.placement2)
    R, r = R1.T * R2, R1.T * (p2 - p1)
    if isinstance(bound, BoundBetweenFrames) and bound.is_rod:
        along = (r / sp.sqrt(r.dot(r))).T
        return b.sign * along * (J1[:3, :] - R * J2[:3, :])
    if isinstance(bound, BoundBetweenFrames) and bound.selection == POINT:
        return b.sign * (J1[:3, :] - R * J2[:3, :])
    linear = J1[:3, :] - skew_matrix(sp, r) * J1[3:, :] - R * J2[:3, :]
    if isinstance(bound, BoundBetweenFrames) and bound.selection == FRAME:
        linear = J1[:3, :] - R * J2[:3, :] - skew_matrix(sp, r) * R * J2[3:, :]
    six = sp.Matrix.vstack(linear, J1[3:, :] - R * J2[3:, :])
    chosen = b.relation.chosen if relative else b.selection
    return b.sign * six[list(chosen), :]


def _coupled(sp: Any, bodies: Bodies, b: BoundCoupling) -> Any:
    J = sp.zeros(1, bodies.nv)
    bends = b.bends or ((),) * len(b.weights)
    for at_q, at_v, weight, bend in zip(b.configuration, b.velocity, b.weights, bends, strict=True):
        x = bodies.q[at_q]
        J[0, at_v] = exact_number(sp, weight) + sum(
            power * exact_number(sp, k) * x ** (power - 1) for power, k in enumerate(bend, 2)
        )
    return b.sign * J


def _rolled(sp: Any, bodies: Bodies, b: BoundRolling) -> Any:
    (R1, _), J1 = bodies.frame(b.joint1, b.placement1)
    plane, radius = R1.T * exact_matrix(sp, b.placement2.rotation), exact_number(sp, b.radius)
    t, n = plane[:, 0], plane[:, 2]
    r = -radius * n
    if b.axle is not None:
        e = sp.eye(3)[:, b.axle]
        across = e.cross(n)
        t = across / sp.sqrt(across.dot(across))
        r = radius * e.cross(t)
    T = sp.Matrix.hstack(t, n.cross(t), n).T
    three = T * (J1[:3, :] - skew_matrix(sp, r) * J1[3:, :])
    return b.sign * three[list(b.selection), :]


def skew_matrix(sp: Any, x: Any) -> Any:
    """Matrix (3, 3) of the cross product x times."""
    return sp.Matrix([[0, -x[2], x[1]], [x[2], 0, -x[0]], [-x[1], x[0], 0]])


def exact_number(sp: Any, x: float) -> Any:
    """Number of a model: exact where it is whole."""
    x = float(x)
    return sp.Integer(round(x)) if abs(x - round(x)) < _ROUNDING else sp.Float(x, 17)


def exact_matrix(sp: Any, x: Array) -> Any:
    """Matrix of numbers of a model."""
    array = np.asarray(x, dtype=float)
    array = array[:, None] if array.ndim == 1 else array
    return sp.Matrix(*array.shape, [exact_number(sp, each) for each in array.ravel()])
