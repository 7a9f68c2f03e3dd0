"""Reach: what the two bodies of a row bring to J before they cancel.

J = J1 - X J2 is rounded to eps (|J1| + |X J2|), however small it is itself. Pinocchio forms either
from columns at the origin of the world, so that each is rounded to eps times its distance from
there at least: far away that is what counts.
"""

from __future__ import annotations

from math import sqrt
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from condyn_pin._core._pin import LOCAL, pin
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.rows.any_bound import OnFrames
from condyn_pin.constraints.rows.couplings import Coupled
from condyn_pin.constraints.rows.rolling import Rolled

if TYPE_CHECKING:
    from condyn_pin.constraints.rows.equations import Equations

# What is rounding of a row, as a share of what its two bodies bring to it.
ROUNDED: Final = 1e-13


def cancellation_scale(equations: Equations, q: Array) -> Array:
    """Return the sizes of what J is a difference of (m, nv).

    The same for all shifts of a constraint, and for all its turns. Of all places of a machine it is
    least near the origin of the world.
    """
    model, data = equations.model, equations.data
    pin.computeJointJacobians(model, data, q)
    found = np.zeros((equations.m, model.nv))
    ends: list[tuple[Any, int, Any, float]] = []  # those that move, and an arm between the two
    for bound in equations.bounds:
        if isinstance(bound, Coupled):
            found[bound.rows, list(bound.velocity)] = 1.0, abs(bound.ratio)
        elif isinstance(bound, Rolled):
            ends.append((bound, bound.joint1, bound.placement1, bound.radius))
        else:
            assert isinstance(bound, OnFrames)
            c1, c2 = bound.ends(data.oMi)
            apart = _length(c2.translation - c1.translation)
            both = ((bound.joint1, bound.placement1, apart), (bound.joint2, bound.placement2, 0.0))
            ends += [(bound, *end) for end in both if end[0]]
    if not ends:
        return found
    sixes = [pin.getFrameJacobian(model, data, end[1], end[2], LOCAL) for end in ends]
    # by end, linear or angular, component and column
    shift, turn = np.abs(sixes).reshape(len(ends), 2, 3, -1).max(axis=2).swapaxes(0, 1)
    arm = np.array([[end[3]] for end in ends])
    away = np.array([[_length(data.oMi[end[1]].translation)] for end in ends])
    moved = np.maximum(shift + arm * turn, away * turn)
    for k, (bound, *_) in enumerate(ends):
        found[bound.rows] += [(turn if angle else moved)[k] for angle in bound.turns(model)]
    return found


def _length(x: Array) -> float:
    return sqrt(x.dot(x))
