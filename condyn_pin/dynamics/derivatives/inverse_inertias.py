"""How w, what bodies and joints give way to in `Soft`, changes with what bodies weigh.

    w = J_i M^-1 J_i^T,    y = M^-1 J_i^T,    w_pi = -y . (M y)_pi,    (M y)_pi = Y(q, 0, y)

with Y the regressor without gravity. A body has the mean of w over three axes at its centre of mass
c, whose J_lin turns with it,

    c = m c / m,    J_lin' = -c' x J_ang,    mean' = -2/3 tr(skew(c') J_ang M^-1 J_lin^T).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from condyn_pin._core._pin import LOCAL, pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.trees import whole_data
from condyn_pin.constraints.forces import frame_jacobian
from condyn_pin.dynamics.derivatives.parameters import inertia_regressor
from condyn_pin.dynamics.raw import weightless
from condyn_pin.io.mjcf_write import drawn

if TYPE_CHECKING:
    from condyn_pin.dynamics.workspace import Workspace


def inverse_inertias_by_inertias(workspace: Workspace) -> Array:
    """Return w of `inverse_inertias` by the inertial parameters (m, 10 (njoints - 1))."""
    model = workspace.model
    data, q, still = whole_data(model), drawn(workspace.scene.robot), weightless(model)
    M = np.array(pin.crba(model, data, q))
    pin.computeJointJacobians(model, data, q)
    size, rest = 10 * (model.njoints - 1), np.zeros(model.nv)

    def gives(moved: Array) -> Array:
        """Return w of each row by the parameters (rows, size), for y in the columns."""
        return np.array([-y @ inertia_regressor(still, q, rest, y) for y in moved.T])

    def body(joint: int) -> Array:
        by = np.zeros((2, size))
        if joint == 0:
            return by
        mass, c = model.inertias[joint].mass, model.inertias[joint].lever
        J = frame_jacobian(model, data, joint, pin.SE3(np.eye(3), c), LOCAL)
        moved = np.linalg.solve(M, J.T)
        by[:] = gives(moved).reshape(2, 3, -1).mean(axis=1)
        if mass:
            B = J[3:] @ moved[:, :3]
            by_c = -2 / 3 * np.array([B[1, 2] - B[2, 1], B[2, 0] - B[0, 2], B[0, 1] - B[1, 0]])
            own = 10 * (joint - 1)
            by[0, own] -= by_c @ c / mass
            by[0, own + 1 : own + 4] += by_c / mass
        return by

    def columns(velocities: Sequence[int]) -> Array:
        moved = np.linalg.solve(M, np.eye(model.nv)[:, list(velocities)])
        return np.asarray(gives(moved).sum(axis=0))

    w = np.zeros((workspace.scene.rows, size))
    for bound in workspace.bounds:
        w[bound.rows] = bound.yields(body, columns)  # linear in both
    return w
