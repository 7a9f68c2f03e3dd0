"""What is done to an answer of Pinocchio's own before it is one of the scene's equations.

Refinement. The residuals of an answer are solved for with the factor that it came from:

    [ -mu 1  J ] [ -dlam ]     [ s ]
    [  J^T   M ] [   da  ] = - [ r ],     r = M a + h - tau - J^T lam,   s = J a + gamma - a_ref

They are recomputed by Newton-Euler and forward kinematics. So the damping mu and what the factor
lost to rounding are both made up for; each correction leaves a share mu / (sigma + mu).

Approximated kinds. A hinge as two points and a planar pin as a ball are exact where the loop is
closed. Where it is open by a gap g, or J v is not 0, their J and gamma differ by about g omega.
Pinocchio's solve leaves both errors behind; where they are more than an assembled loop has, the
equations of the scene are solved as they are.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from condyn_pin._core import _pin, tolerances
from condyn_pin._core.arrays import Array
from condyn_pin.dynamics.solvers.base import BoundSolver
from condyn_pin.dynamics.solvers.null_space import NullSpace

if TYPE_CHECKING:
    from condyn_pin.dynamics.workspace import Workspace

# Violation [m] and velocity [m/s] from which on a loop counts as open; those of a loop that
# was assembled, or is kept closed in motion, are at 1e-15 to 1e-12.
_OPEN_SQUARED: Final = (0.1 * tolerances.CLOSED) ** 2


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
            rows = workspace.pinocchio_velocity(s)
            steps = self._cholesky.solve(np.concatenate([rows, r])).ravel()
            a = a - steps[m:]
            lam = lam + steps[:m]
        self.lam = lam
        return a


def exact_where_open(workspace: Workspace, closed: BoundSolver) -> BoundSolver:
    """Return a method that is exact on open loops too, from that by the rows that Pinocchio has."""
    dense: list[BoundSolver] = []  # started at the first state that needs it
    method = closed
    run, squares = closed.acceleration, [(gap.dot, gap) for gap in _gaps(workspace)]

    def acceleration(q: Array, v: Array, tau: Array) -> Array:
        nonlocal method
        a = run(q, v, tau)
        for square, gap in squares:
            if square(gap) > _OPEN_SQUARED:
                if not dense:
                    dense.append(NullSpace(tolerances.REFERENCE_RANK).start(workspace))
                method = dense[0]
                return method.acceleration(q, v, tau)
        method = closed
        return a

    return BoundSolver(acceleration, lambda: method.lam(), lambda: method.iterations())


def _gaps(workspace: Workspace) -> list[Array]:
    """Return views of c and J v in Pinocchio's memory, of the rows that stand for others."""
    gaps = []
    pairs = zip(
        workspace.pinocchio_constraints.constraints, workspace.constraint_datas, strict=True
    )
    for native, data in pairs:
        if not native.approximates:
            continue
        if native.anchored:
            gaps.append(data.contact_placement_error.vector[: native.size])
        gaps.append(data.contact_velocity_error.vector[: native.size])
    return gaps
