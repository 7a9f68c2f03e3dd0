"""Reach: what the two bodies of a row bring to J before they cancel.

J = J1 - X J2 is rounded to eps (|J1| + |X J2|), however small it is itself. Pinocchio forms either
from columns at the origin of the world, so that each is rounded to eps times its distance from
there at least: far away that is what counts.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from condyn_pin._core._pin import LOCAL, pin
from condyn_pin._core.arrays import Array
from condyn_pin.constraints.rows.any_bound import OnFrames
from condyn_pin.constraints.rows.bound import Coupled, Rolled

if TYPE_CHECKING:
    from condyn_pin.constraints.rows.equations import Equations

# What is rounding of a row, as a share of what its two bodies bring to it.
ROUNDED: Final = 1e-13


def reach(equations: Equations, q: Array) -> Array:
    """Return the sizes of what J is a difference of (m, nv).

    The same for all shifts of a constraint, and for all its turns. Of all places of a machine it
    is least near the origin of the world.

    Parameters
    ----------
    equations : Equations
    q : (nq,) array
    """
    model, data = equations.model, equations.data
    placements: list[Any] = equations.placements(q)
    pin.computeJointJacobians(model, data, q)
    found = np.zeros((equations.m, model.nv))
    for bound, ends in zip(equations.bounds, placements, strict=True):
        if isinstance(bound, Coupled):
            found[bound.rows, list(bound.velocity)] = 1.0, abs(bound.ratio)
            continue
        shifts, turns = np.zeros((2, model.nv))
        if isinstance(bound, Rolled):
            reached: tuple[tuple[int, Any, float], ...] = (
                (bound.joint1, bound.placement1, bound.radius),
            )
        else:
            assert isinstance(bound, OnFrames)
            apart = float(np.linalg.norm(ends[1].translation - ends[0].translation))
            reached = (
                (bound.joint1, bound.placement1, apart),
                (bound.joint2, bound.placement2, 0.0),
            )
        for joint, placement, arm in reached:
            if joint:
                six = pin.getFrameJacobian(model, data, joint, placement, LOCAL)
                shift, turn = np.abs(six).reshape(2, 3, -1).max(axis=1)
                away = float(np.linalg.norm(data.oMi[joint].translation))
                shifts += np.maximum(shift + arm * turn, away * turn)
                turns += turn
        found[bound.rows] = [turns if angle else shifts for angle in bound.turns(model)]
    return found
