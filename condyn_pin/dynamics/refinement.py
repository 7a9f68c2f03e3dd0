"""Refinement: the residuals of an answer, solved for with the factor that it came from.

    [ -mu 1  J ] [ -dlam ]     [ s ]
    [  J^T   M ] [   da  ] = - [ r ],     r = M a + h - tau - J^T lam,   s = J a + gamma - a_ref

The residuals are recomputed by Newton-Euler and forward kinematics. So the damping mu and what the
factor lost to rounding are both made up for; each correction leaves a share mu / (sigma + mu).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from condyn_pin._core import _pin
from condyn_pin._core.arrays import Array

if TYPE_CHECKING:
    from condyn_pin.dynamics.workspace import Workspace


class Refinement:
    """Corrections by the factor that `pin.constraintDynamics` leaves behind.

    `lam` are the forces of the rows that Pinocchio has, after the last correction.
    """

    def __init__(self, workspace: Workspace, times: int) -> None:
        self._workspace, self._times = workspace, times
        self._cholesky = _pin.constraint_cholesky(workspace.data)
        self.lam: Array = np.zeros(0)

    def correct(self, q: Array, v: Array, tau: Array, a: Array, lam: Array) -> Array:
        """Return a (nv,) after the corrections, from a and the forces of Pinocchio's rows."""
        workspace, m = self._workspace, len(lam)
        residuals = workspace.equations.residuals
        for _ in range(self._times):
            r, s = residuals(q, v, tau, a, workspace.scene_forces(lam))
            slips = workspace.pinocchio_velocity(s)
            steps = self._cholesky.solve(np.concatenate([slips, r])).ravel()
            a = a - steps[m:]
            lam = lam + steps[:m]
        self.lam = lam
        return a
