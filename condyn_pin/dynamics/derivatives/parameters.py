"""Derivatives of an answer by what the model is made of.

With r_x and s_x the partials of the two residuals by a parameter x, at the answer,

    M da - J^T dlam = -r_x dx,        J da = -s_x dx.

Gravity and inertial parameters enter r linearly: r = Y(q, v, a) pi + ..., the regressor form.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.trees import whole_data
from condyn_pin.constraints.rows.bound import AnyBound
from condyn_pin.errors import InvalidArgument, unknown_name

if TYPE_CHECKING:
    from condyn_pin.dynamics.derivatives.linearised import Linearisation

ENDS = ("first", "second")


def gravity_regressor(model: Any, q: Array) -> Array:
    """Return the derivative of h by the vector of gravity (nv, 3)."""
    columns = []
    for direction in np.eye(3):
        pulled = pin.Model(model)
        pulled.gravity = pin.Motion(direction, np.zeros(3))
        columns.append(np.array(pin.computeGeneralizedGravity(pulled, whole_data(pulled), q)))
    return np.column_stack(columns)


def inertia_regressor(model: Any, q: Array, v: Array, a: Array) -> Array:
    """Return Y (nv, 10 (njoints - 1)) with M a + h = Y pi + armature a."""
    Y = pin.computeJointTorqueRegressor(model, whole_data(model), q, v, a)
    return np.array(Y).reshape(model.nv, -1)  # a single row comes as a vector


def placement_partials(
    linearisation: Linearisation, bounds: Sequence[AnyBound],
    name: str, frame: str, q: Array, v: Array, a: Array, lam: Array,
) -> tuple[Array, Array]:  # fmt: skip
    """Return r_x (nv, 6) and s_x (m, 6) for a twist x of one frame of a constraint."""
    found = {bound.name: bound for bound in bounds}
    if name not in found:
        raise unknown_name("constraint", name, found)
    if frame not in ENDS:
        raise InvalidArgument(f"frame = {frame!r}: one of {', '.join(ENDS)} is needed")
    bound = found[name]
    end = bound.end(frame)
    r, rows = linearisation.by_frame(q, v, a, lam, name, end)
    s = np.zeros((len(lam), 6))
    s[bound.rows] = rows
    return r, s
