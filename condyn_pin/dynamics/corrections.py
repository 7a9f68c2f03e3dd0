"""What is done to an answer of Pinocchio's own before it is one of the scene's equations.

Refinement. The residuals of an answer are solved for with the factor that it came from:

    [ -mu 1  J ] [ -dlam ]     [ s ]
    [  J^T   M ] [   da  ] = - [ r ],     r = M a + h - tau - J^T lam,   s = J a + gamma - a_ref

They are recomputed by Newton-Euler and forward kinematics. So the damping mu and what the factor
lost to rounding are both made up for; each correction leaves a share mu / (sigma + mu).

Approximated kinds. A hinge as two points and a planar pin as a ball are exact where the loop is
closed. Where it is open by a gap g, or J v is not 0, their J and gamma differ by about g omega. Hot
loops have the answer of these rows, which is that of the closed machine to the first order as well;
`solve` has that of the scene's own rows (`NullSpace`).
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from condyn_pin._core import _pin, tolerances
from condyn_pin._core.arrays import Array, quietly
from condyn_pin.dynamics.solvers.base import BoundSolver
from condyn_pin.dynamics.solvers.null_space import NullSpace

if TYPE_CHECKING:
    from condyn_pin.dynamics.workspace import Workspace

# Squares of violations [m] and velocities [m/s] from which on a loop counts as open.
OPEN_SQUARED: Final = tolerances.OPEN**2

# Velocity of rows from which on hot loops have the scene's own rows [m/s, rad/s]: what points in
# place of a hinge differ by is as small as that. Stages of a step have one field and no limit.
SLIPPING: Final = 1e-4


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


def consistent_where_open(workspace: Workspace, closed: BoundSolver) -> BoundSolver:
    """A method that leaves out redundant rows where loops are open, from one that does not.

    Open loops are solved by `NullSpace`. Where J v is not 0, forces lose what moves nothing.
    """
    exact = cache(lambda: NullSpace(tolerances.REFERENCE_RANK).start(workspace))
    rounded = workspace.scene.nominal.rounded_file is not None
    method, moving_at = closed, np.zeros(0)
    open_by = quietly(workspace.equations.open_by)  # of numbers that are none the status says it

    def acceleration(q: Array, v: Array, tau: Array) -> Array:
        nonlocal method, moving_at
        gap, rate = open_by(q, v)
        method = exact() if rounded or gap > tolerances.OPEN else closed
        moving_at = q.copy() if method is closed and rate > tolerances.OPEN else np.zeros(0)
        return method.acceleration(q, v, tau)

    @quietly
    def lam() -> Array:
        lam = method.lam()
        if not moving_at.size:
            return lam
        J = workspace.equations.jacobian(moving_at)
        return workspace.scene.nominal.redundancy.kept(lam, J, np.zeros(len(lam)))

    return BoundSolver(acceleration, lam, lambda: method.iterations())


def without_idle_rows(method: BoundSolver, idle: NDArray[np.bool_]) -> BoundSolver:
    """A method without forces along rows that are zero at every configuration.

    Where J v is not 0 such a row may miss a gamma that no acceleration meets, and damping makes a
    force of it.
    """

    def lam() -> Array:
        found = method.lam()
        found[idle] = 0.0
        return found

    exact = method.exact and without_idle_rows(method.exact, idle)
    return replace(method, lam=lam, exact=exact)


def exact_where_slipping(workspace: Workspace, method: BoundSolver) -> BoundSolver:
    """A method with the scene's own rows where J v is far from 0, and Pinocchio's differ by it."""
    return replace(exact_where_open(workspace, method, slips=True), open_rows=method.open_rows)


def exact_where_open(workspace: Workspace, closed: BoundSolver, slips: bool = False) -> BoundSolver:
    """A method with the scene's own rows where Pinocchio's, which stand for them, differ.

    With `slips`, only where rows slip by more than SLIPPING, whatever is open.
    """
    dense: list[BoundSolver] = []  # started at the first state that needs it
    method = closed
    views = _gaps(workspace, slips)
    run, squares = closed.acceleration, [(gap.dot, gap) for gap in views]
    least = -1.0 if workspace.scene.nominal.rounded_file else OPEN_SQUARED
    least = SLIPPING**2 if slips else least
    rows = closed.open_rows

    def acceleration(q: Array, v: Array, tau: Array) -> Array:
        nonlocal method
        a = run(q, v, tau)
        if rows and rows.held is not None:
            method = closed
            return a
        for square, gap in squares:
            if square(gap) > least:
                if not dense:
                    dense.append(NullSpace(tolerances.REFERENCE_RANK).start(workspace))
                method = dense[0]
                return method.acceleration(q, v, tau)
        method = closed
        return a

    return BoundSolver(acceleration, lambda: method.lam(), lambda: method.iterations())


def _gaps(workspace: Workspace, slips: bool = False) -> list[Array]:
    """Views of c and J v in Pinocchio's memory, of the rows that stand for others."""
    gaps = []
    pairs = zip(
        workspace.pinocchio_constraints.constraints, workspace.constraint_datas, strict=True
    )
    for native, data in pairs:
        if not native.approximates:
            continue
        if native.anchored and not slips:
            gaps.append(data.contact_placement_error.vector[: native.size])
        gaps.append(data.contact_velocity_error.vector[: native.size])
    return gaps
