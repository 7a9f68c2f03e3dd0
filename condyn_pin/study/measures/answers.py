"""Measures at one state: accelerations, constraint forces, derivatives, against `Reference`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf, isfinite
from typing import ClassVar

import numpy as np

from condyn_pin._core import _pin
from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import Grid
from condyn_pin._core.arrays import Array
from condyn_pin._core.timing import Call, State
from condyn_pin.dynamics.derivatives import METHODS
from condyn_pin.dynamics.derivatives.others import directions
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.solution import Solution
from condyn_pin.dynamics.solvers.lcaba import LCABA
from condyn_pin.dynamics.solvers.proximal import Proximal
from condyn_pin.dynamics.solvers.reference import Reference
from condyn_pin.dynamics.workspace import Workspace
from condyn_pin.errors import InvalidArgument, SolveFailed, unknown_name
from condyn_pin.study.measures.measure import ComparedAnswer, Measure, relative, solve_without_throw


@dataclass(frozen=True)
class AccelerationMeasure(Measure):
    """The error of a, relative to the larger of |a|_inf and gravity.

    Both ways to an answer are judged, `Workspace.acceleration` and `Workspace.solve`, and the
    larger error counts: an answer that is right on the first call only is caught.
    """

    name: ClassVar[str] = "acceleration"

    def truth(self, scene: Scene, state: State) -> Array:
        """Return a by `Reference`."""
        return Workspace(scene, Reference()).solve(*state, throw=False).a

    def answer(
        self, workspace: Workspace, state: State, truth: Array, accuracy: float
    ) -> ComparedAnswer:
        """Return the answer of a workspace's solver at a state."""
        try:
            hot = workspace.acceleration(*state)
        except SolveFailed:
            hot = np.full(workspace.model.nv, np.nan)
        solution = workspace.solve(*state, accuracy=accuracy, throw=False)
        gravity = workspace.scene.nominal.estimator.gravity
        error = max(relative(a, truth, gravity) for a in (hot, solution.a))
        return ComparedAnswer.of(solution, error, accuracy)

    def calls(self, workspace: Workspace) -> Mapping[str, Call]:
        """Return the hot loop, the solve with its residuals, and Pinocchio's own call."""
        calls: dict[str, Call] = {
            "once": workspace.acceleration,
            "solve": solve_without_throw(workspace),
        }
        if isinstance(workspace.solver, LCABA | Proximal):
            call = _pin.lcaba() if isinstance(workspace.solver, LCABA) else pin.constraintDynamics
            model, data = workspace.model, workspace.data
            models, datas = workspace.constraint_models, workspace.constraint_datas
            settings = workspace.proximal_settings
            calls["bare"] = lambda q, v, tau: call(model, data, q, v, tau, models, datas, settings)
        return calls


@dataclass(frozen=True)
class ForceMeasure(Measure):
    """The error of J^T lam, relative to the larger of |J^T lam|_inf and the robot's weight.

    J^T lam is unique even if rows are redundant; then lam itself is not, and has noise along them
    without effect. The time is that of `Workspace.solve`, which returns lam.
    """

    name: ClassVar[str] = "forces"

    def truth(self, scene: Scene, state: State) -> Array:
        """Return J^T lam by `Reference` (nv,) [N, N m]."""
        workspace = Workspace(scene, Reference())
        lam = workspace.solve(*state, throw=False).lam
        return workspace.jacobian(state[0]).T @ lam

    def answer(
        self, workspace: Workspace, state: State, truth: Array, accuracy: float
    ) -> ComparedAnswer:
        """Return the answer of a workspace's solver at a state."""
        solution = workspace.solve(*state, accuracy=accuracy, throw=False)
        force = workspace.jacobian(state[0]).T @ solution.lam
        error = relative(force, truth, workspace.scene.nominal.weight)
        # a status of ok speaks of a, and promises nothing of forces
        return ComparedAnswer.of(solution, error, promised=float("inf"))

    def calls(self, workspace: Workspace) -> Mapping[str, Call]:
        """Return the solve with its proof."""
        return {"once": solve_without_throw(workspace)}


@dataclass(frozen=True)
class DerivativeMeasure(Measure):
    """The error of da/dq, da/dv and da/dtau, each relative to its largest entry, or to 1.

    The worst of the three. Where rows are redundant da/dq counts along the constraints only: across
    them a has no derivative. The truth is the implicit function theorem at the answer of
    `Reference`, which central differences confirm (`derivatives(check=True)`).

    Parameters
    ----------
    method : {"kkt", "pinocchio", "differences"}
        As in `condyn_pin.derivatives`.

    Raises
    ------
    UnknownName
        If there is no such method.
    """

    name: ClassVar[str] = "derivatives"
    sweeps: ClassVar[tuple[Grid, ...]] = ({"method": tuple(METHODS)},)

    method: str = "kkt"

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise unknown_name("method", str(self.method), METHODS)

    def truth(self, scene: Scene, state: State) -> Array:
        """Return da/dq, da/dv and da/dtau at the answer of `Reference`, (nv, 3 nv)."""
        workspace = Workspace(scene, Reference())
        solution = workspace.solve(*state, throw=False)
        return _blocks(workspace, solution, state, "kkt")

    def answer(
        self, workspace: Workspace, state: State, truth: Array, accuracy: float
    ) -> ComparedAnswer:
        """Return the answer of a workspace's solver at a state."""
        if not workspace.solver.exact:
            raise InvalidArgument(
                f"{workspace.solver.title} solves other equations: derivatives are those of hard "
                "constraints"
            )
        solution = workspace.solve(*state, accuracy=accuracy, throw=False)
        error = inf
        if isfinite(solution.error_bound):
            found = self._formed(workspace, solution, state)
            J, redundant = workspace.jacobian(solution.q), workspace.scene.nominal.dependent
            error = _worst(found, truth, directions(J, redundant))
        return ComparedAnswer.of(solution, error, promised=inf)

    def calls(self, workspace: Workspace) -> Mapping[str, Call]:
        """Return solve and derivatives, all matrices formed."""

        def once(q: Array, v: Array, tau: Array) -> Array:
            solution = workspace.solve(q, v, tau, throw=False)
            return self._formed(workspace, solution, (q, v, tau))

        return {"once": once, "solve": solve_without_throw(workspace)}

    def _formed(self, workspace: Workspace, solution: Solution, state: State) -> Array:
        return _blocks(workspace, solution, state, self.method)


def _blocks(workspace: Workspace, solution: Solution, state: State, method: str) -> Array:
    """Return the derivatives of a by q, v and tau, (nv, 3 nv)."""
    _, v, tau = state
    found = METHODS[method](workspace, solution, v, tau)
    return np.hstack([found.da_dq, found.da_dv, found.da_dtau])


def _worst(found: Array, truth: Array, along: Array) -> float:
    """Largest relative error of da/dq, da/dv and da/dtau; da/dq only in the directions `along`."""
    pairs = zip(np.hsplit(found, 3), np.hsplit(truth, 3), strict=True)
    (q, true_q), *others = pairs
    return max(relative(x, y, 1.0) for x, y in [(q @ along.T, true_q @ along.T), *others])
