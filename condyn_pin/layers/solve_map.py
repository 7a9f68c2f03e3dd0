"""SolveMap: accelerations and constraint forces as a function of (q, v, tau)."""

from __future__ import annotations

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.constraints.baumgarte import Baumgarte
from condyn_pin.dynamics.derivatives.base import Derivatives
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.solvers.base import Solver
from condyn_pin.dynamics.workspace import Workspace
from condyn_pin.layers.layer_map import Pair
from condyn_pin.layers.state_map import StateMap


class SolveMap(StateMap):
    """(a, lam) of a scene, in memory of its own."""

    def __init__(self, scene: Scene, solver: Solver | None, drift: Baumgarte | None) -> None:
        self._workspace = Workspace(scene, solver, drift=drift)
        super().__init__(scene.robot)
        self.x_size, self.y_size = scene.robot.nv, scene.rows

    def answer(self, q: Array, v: Array, tau: Array, *_: Array) -> Pair:
        """Return a and lam."""
        found = self._workspace.solve(q, v, tau)
        return found.a, found.lam

    def change(self, q: Array, v: Array, tau: Array, *_: Array) -> tuple[Pair, Derivatives]:
        """Return a and lam, and their derivatives."""
        found = self._workspace.derivatives(q, v, tau)
        return (found.solution.a, found.solution.lam), found

    def matrices(self, change: Derivatives) -> Pair:
        """Return the derivatives of a (nv, 3 nv) and of lam (m, 3 nv)."""
        d = change
        of_a = np.hstack([d.da_dq, d.da_dv, d.da_dtau])
        return of_a, np.hstack([d.dlam_dq, d.dlam_dv, d.dlam_dtau])
