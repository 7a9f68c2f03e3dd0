"""Accelerations against those of `Reference`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from condyn_pin import _pin
from condyn_pin._pin import pin
from condyn_pin.arrays import Array
from condyn_pin.errors import SolveFailed
from condyn_pin.scene import Scene
from condyn_pin.solvers.lcaba import LCABA
from condyn_pin.solvers.proximal import Proximal
from condyn_pin.solvers.reference import Reference
from condyn_pin.timing import Call, State
from condyn_pin.trade.measures.base import Answer, Measure, relative, unthrown
from condyn_pin.workspace import Workspace


@dataclass(frozen=True)
class AccelerationMeasure(Measure):
    """The error of a, relative to the larger of |a|_inf and gravity.

    Both ways to an answer are judged, `Workspace.acceleration` and `Workspace.solve`, and the
    larger error counts: what is right on its first call only is found out.
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
        gravity = workspace.scene.audit.yardstick.gravity
        error = max(relative(a, truth, gravity) for a in (hot, solution.a))
        return Answer.of(solution, error, accuracy)

    def calls(self, workspace: Workspace) -> Mapping[str, Call]:
        """Return the hot loop, the solve with its proof, and Pinocchio's own call."""
        calls: dict[str, Call] = {"once": workspace.acceleration, "solve": unthrown(workspace)}
        if isinstance(workspace.solver, LCABA | Proximal):
            bare = pin.constraintDynamics
            if isinstance(workspace.solver, LCABA):
                bare = _pin.lcaba()
            model, data = workspace.model, workspace.data
            models, datas = workspace.constraint_models, workspace.constraint_datas
            settings = workspace.proximal_settings
            calls["bare"] = lambda q, v, tau: bare(model, data, q, v, tau, models, datas, settings)
        return calls
