"""SolveMap: accelerations and constraint forces as a function of (q, v, tau) and of inertias."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.constraints.baumgarte import Baumgarte
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.solvers.base import Solver
from condyn_pin.dynamics.workspace import Workspace
from condyn_pin.errors import InvalidArgument
from condyn_pin.layers.layer_map import Pair
from condyn_pin.layers.state_map import StateMap
from condyn_pin.model.smaller import weighing


class SolveChange:
    """How an answer changes, with inertias behind q, v and tau."""

    def __init__(self, of: Any, bodies: int) -> None:
        self.of, self._shape = of, (bodies, 10)
        self.by_inertias = np.vstack(of.by_inertias())

    def jvp(self, dq: Array, dv: Array, dtau: Array, by: Array) -> Pair:
        """Return (da, dlam) along steps of q, v, tau and inertias."""
        da, dlam = self.of.jvp(dq, dv, dtau)
        more = self.by_inertias @ by.ravel()
        return da + more[: len(da)], dlam + more[len(da) :]

    def vjp(self, da: Array, dlam: Array) -> tuple[Array, ...]:
        """Return the gradients by q, v, tau and inertias."""
        by = (np.concatenate((da, dlam)) @ self.by_inertias).reshape(self._shape)
        return (*self.of.vjp(da, dlam), by)


class SolveMap(StateMap):
    """(a, lam) of a scene, in memory of its own."""

    def __init__(
        self, scene: Scene, solver: Solver | None, drift: Baumgarte | None,
        wrt: Sequence[str] = (),
    ) -> None:  # fmt: skip
        if tuple(wrt) not in ((), ("inertias",)):
            raise InvalidArgument(f'wrt = {wrt!r}: ["inertias"], or nothing, is what a solve has')
        self._scene, self._drift = scene, drift
        self._workspace = Workspace(scene, solver, drift=drift)
        self._bodies, self._last = scene.robot.model.njoints - 1, b""
        super().__init__(scene.robot, dict.fromkeys(wrt, (self._bodies, 10)))
        self.x_size, self.y_size = scene.robot.nv, scene.rows

    def answer(self, q: Array, v: Array, tau: Array, *p: Array) -> Pair:
        """Return a and lam."""
        found = self._weighing(*p).solve(q, v, tau)
        return found.a, found.lam

    def change(self, q: Array, v: Array, tau: Array, *p: Array) -> tuple[Pair, Any]:
        """Return a and lam, and their derivatives."""
        found = self._weighing(*p).derivatives(q, v, tau)
        pair = found.solution.a, found.solution.lam
        return pair, SolveChange(found, self._bodies) if p else found

    def matrices(self, change: Any) -> Pair:
        """Return the derivatives of a (nv, 3 nv + inertias) and of lam (m, the same)."""
        d = change.of if isinstance(change, SolveChange) else change
        of_a, of_lam = [d.da_dq, d.da_dv, d.da_dtau], [d.dlam_dq, d.dlam_dv, d.dlam_dtau]
        if isinstance(change, SolveChange):
            of_a.append(change.by_inertias[: self.x_size])
            of_lam.append(change.by_inertias[self.x_size :])
        return np.hstack(of_a), np.hstack(of_lam)

    def __reduce__(self) -> tuple[Any, ...]:
        wrt = tuple(self.inputs)[3:]
        return SolveMap, (self._scene, self._workspace.solver, self._drift, wrt)

    def _weighing(self, *inertias: Array) -> Workspace:
        """Return the workspace of the robot with these inertias; its own without any."""
        if inertias and inertias[0].tobytes() != self._last:
            heavy = replace(self._scene, robot=weighing(self._scene.robot, inertias[0]))
            self._workspace = Workspace(heavy, self._workspace.solver, drift=self._drift)
            self._last = inertias[0].tobytes()
        return self._workspace
