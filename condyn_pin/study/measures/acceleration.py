"""Accelerations against those of `Reference`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from condyn_pin._core import _pin
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.timing import Call, State
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.solvers.lcaba import LCABA
from condyn_pin.dynamics.solvers.proximal import Proximal
from condyn_pin.dynamics.solvers.reference import Reference
from condyn_pin.dynamics.workspace import Workspace
from condyn_pin.errors import SolveFailed
from condyn_pin.study.measures.measure import Answer, Measure, relative, solve_without_throw


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

    def answer(self, workspace: Workspace, state: State, truth: Array, accuracy: float) -> Answer:
        """Return the answer of a workspace's solver at a state."""
        try:
            hot = workspace.acceleration(*state)
        except SolveFailed:
            hot = np.full(workspace.model.nv, np.nan)
        solution = workspace.solve(*state, accuracy=accuracy, throw=False)
        gravity = workspace.scene.nominal.estimator.gravity
        error = max(relative(a, truth, gravity) for a in (hot, solution.a))
        return Answer.of(solution, error, accuracy)

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
