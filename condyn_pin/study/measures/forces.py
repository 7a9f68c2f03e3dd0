"""Generalised constraint forces J^T lam, against `Reference`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from condyn_pin._core.arrays import Array
from condyn_pin._core.timing import Call, State
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.solvers.reference import Reference
from condyn_pin.dynamics.workspace import Workspace
from condyn_pin.study.measures.measure import Answer, Measure, relative, solve_without_throw


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

    def answer(self, workspace: Workspace, state: State, truth: Array, accuracy: float) -> Answer:
        """Return the answer of a workspace's solver at a state."""
        solution = workspace.solve(*state, accuracy=accuracy, throw=False)
        force = workspace.jacobian(state[0]).T @ solution.lam
        error = relative(force, truth, workspace.scene.nominal.weight)
        # a status of ok speaks of a, and promises nothing of forces
        return Answer.of(solution, error, promised=float("inf"))

    def calls(self, workspace: Workspace) -> Mapping[str, Call]:
        """Return the solve with its proof."""
        return {"once": solve_without_throw(workspace)}
