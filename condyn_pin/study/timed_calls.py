"""Calls that are timed: `Workspace.solve` whatever its status, and Pinocchio's own."""

from __future__ import annotations

from functools import partial

from condyn_pin._core import _pin
from condyn_pin._core._pin import pin
from condyn_pin._core.timing import Call
from condyn_pin.dynamics.solvers.lcaba import LCABA
from condyn_pin.dynamics.solvers.proximal import Proximal
from condyn_pin.dynamics.workspace import Workspace


def unthrown(workspace: Workspace) -> Call:
    """Return `Workspace.solve`, which then answers whatever its status."""
    return partial(workspace.solve, throw=False)


def bare(workspace: Workspace) -> Call | None:
    """Return the call of Pinocchio behind the solver of a workspace, if it is one call."""
    if not isinstance(workspace.solver, LCABA | Proximal):
        return None
    call = _pin.lcaba() if isinstance(workspace.solver, LCABA) else pin.constraintDynamics
    model, data = workspace.model, workspace.data
    models, datas = workspace.constraint_models, workspace.constraint_datas
    settings = workspace.proximal_settings
    return lambda q, v, tau: call(model, data, q, v, tau, models, datas, settings)
