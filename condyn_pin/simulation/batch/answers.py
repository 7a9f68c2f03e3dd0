"""What a worker does to some rows of a batch: it solves, and differentiates, state by state."""

from __future__ import annotations

from math import nan
from typing import Final

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core.work import Arrays, Messages
from condyn_pin.dynamics.derivatives.differences import BLOCKS
from condyn_pin.dynamics.solution import Solution
from condyn_pin.dynamics.workspace import Workspace
from condyn_pin.errors import SolveFailed
from condyn_pin.simulation.batch.inputs import RowForces
from condyn_pin.simulation.batch.solution import STATUSES

_CODES: Final = {status: code for code, status in enumerate(STATUSES)}


def answer_rows(
    method: str | None,
    accuracy: float | None,
    forces: RowForces,
    workspace: Workspace,
    inputs: Arrays,
    outputs: Arrays,
) -> Messages:
    """Solve some rows, and differentiate them if there is a method for it."""
    q, v, tau = inputs["q"], inputs["v"], inputs["tau"]
    for i, state in enumerate(zip(q, v, np.broadcast_to(tau, v.shape), strict=True)):
        applied = forces.at(inputs, i)
        if method is None:
            solution = workspace.solve(*state, forces=applied, accuracy=accuracy, throw=False)
            _put(outputs, i, solution)
            continue
        try:
            found = workspace.derivatives(*state, forces=applied, method=method, accuracy=accuracy)
        except SolveFailed as failed:
            _put(outputs, i, failed.solution)
            for name in BLOCKS:
                outputs[name][i] = nan
        else:
            _put(outputs, i, found.solution)
            for name in BLOCKS:
                outputs[name][i] = getattr(found, name)
    return {}


def by_core(
    differentiates: bool,
    accuracy: float | None,
    forces: RowForces,
    workspace: Workspace,
    inputs: Arrays,
    outputs: Arrays,
    threads: int,
) -> tuple[NDArray[np.intp], Messages]:
    """Answer some rows by the compiled core; return those that are left."""
    core = workspace.compiled
    work = core.differentiate if differentiates else core.solve
    state = inputs["q"], inputs["v"], inputs["tau"]
    applied = forces.of_all(inputs)
    return work(state, outputs, accuracy=accuracy, threads=threads, forces=applied), {}


def _put(outputs: Arrays, i: int, solution: Solution) -> None:
    for name in ("a", "lam", "residuals", "iterations"):
        outputs[name][i] = getattr(solution, name)
    outputs["statuses"][i] = _CODES[solution.status]
    outputs["solve_times"][i] = solution.solve_time
