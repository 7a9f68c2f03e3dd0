"""Columns of answers, named by joint and by constraint: of one state, or of many."""

from __future__ import annotations

from typing import Any

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.dynamics.residuals import Residuals
from condyn_pin.dynamics.scene import Scene
from condyn_pin.model.joints import coordinate_names

# How `Solution` and `BatchSolution` call the numbers of `Residuals`.
_ERRORS = {
    "dynamics": "dynamics_error", "constraint": "constraint_error", "violation": "violation",
    "velocity": "velocity_violation", "bound": "error_bound",
}  # fmt: skip


def solution_columns(
    scene: Scene, status: Any, q: Array, a: Array, lam: Array, residuals: Array
) -> dict[str, Any]:
    """Return statuses, q, a, lam and errors of N states by name, each (N,)."""
    model, table = scene.robot.model, {"status": status}
    for kind, values, names in (
        ("q", q, coordinate_names(model, "q")),
        ("a", a, coordinate_names(model, "v")),
        ("lam", lam, scene.row_names),
    ):
        columns = np.atleast_2d(values).T
        table |= {f"{kind} {name}": each for name, each in zip(names, columns, strict=True)}
    errors = zip(Residuals._fields, np.atleast_2d(residuals).T, strict=True)
    return table | {_ERRORS[name]: each for name, each in errors}
