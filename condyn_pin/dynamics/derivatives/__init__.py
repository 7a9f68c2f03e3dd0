"""Derivatives of accelerations and constraint forces: one file a method."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin._core import tolerances
from condyn_pin._core.arguments import Given
from condyn_pin._core.arrays import Array
from condyn_pin._core.threads import one_blas_thread, single_threaded
from condyn_pin.constraints.forces import AppliedForce
from condyn_pin.dynamics.derivatives.kkt import KktDerivatives
from condyn_pin.dynamics.derivatives.others import (
    DifferenceDerivatives,
    PinocchioDerivatives,
    check_derivatives,
)
from condyn_pin.dynamics.derivatives.solution_derivatives import Derivatives
from condyn_pin.dynamics.proof import failure
from condyn_pin.dynamics.solution import Solution, Status
from condyn_pin.dynamics.workspace import Workspace
from condyn_pin.errors import unknown_name

# By the name that `derivatives` takes.
METHODS: dict[str, Callable[[Workspace, Solution, Array, Array], Derivatives]] = {
    "kkt": lambda workspace, *of: (
        workspace.solver.differentiated(workspace, *of) or KktDerivatives(workspace, *of)
    ),
    "pinocchio": PinocchioDerivatives,
    "differences": DifferenceDerivatives,
}

__all__ = ["METHODS", "Derivatives", "differentiate"]


def differentiate(
    workspace: Workspace,
    q: ArrayLike,
    v: ArrayLike,
    tau: ArrayLike,
    forces: Sequence[AppliedForce],
    method: str,
    check: bool,
    accuracy: float,
) -> Derivatives:
    """Return the derivatives of a and lam by q, v and tau, with the arguments of `derivatives`."""
    if not isinstance(method, str) or method not in METHODS:
        raise unknown_name("method", str(method), METHODS)
    if workspace.core and workspace.engine == "core":
        workspace.core.check(forces, method)
    if check:
        found = workspace.derivatives(q, v, tau, forces=forces, method=method, accuracy=accuracy)
        _check(workspace, q, v, tau, found)
        return found
    return _by_python(workspace, (q, v, tau), forces, method, accuracy)


@single_threaded
@one_blas_thread
def _by_python(
    workspace: Workspace, given: Given, forces: Sequence[AppliedForce], method: str, accuracy: float
) -> Derivatives:
    state = workspace.scene.robot.arguments.accept(*given)
    equations, linearisation = workspace.equations, workspace.linearisation
    if method == "kkt" and linearisation.uses_given_model:
        equations.recursion = linearisation  # once for the proof and for the derivatives
    try:
        solution = workspace._answered(state, forces, accuracy, False)
    finally:
        equations.recursion = None
    if solution.status is not Status.OK:
        # far from closed loops a may belong to no state, but its derivatives belong to it
        off = max(solution.residuals.violation, solution.residuals.velocity) > tolerances.OPEN
        in_doubt = off and solution.error_bound <= accuracy
        if not np.isfinite(solution.a).all() or (workspace.solver.exact and not in_doubt):
            raise failure(workspace, solution)
    # much is formed when it is asked for first, and the caller may have gone on in these arrays
    return METHODS[method](workspace, solution, state[1].copy(), state[2].copy())


@single_threaded
@one_blas_thread
def _check(
    workspace: Workspace, q: ArrayLike, v: ArrayLike, tau: ArrayLike, found: Derivatives
) -> None:
    _, v_, tau_ = workspace.scene.robot.arguments.accept(q, v, tau)
    check_derivatives(found, DifferenceDerivatives(workspace, found.solution, v_, tau_))
