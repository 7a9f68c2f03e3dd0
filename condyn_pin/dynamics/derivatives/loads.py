"""How the torques of forces on frames change with q.

With L the Jacobian of the frame in its own axes, one column a coordinate, and w the wrench in the
same axes,

    tau_i = L_i . w

A step of coordinate j moves the frame by L_j. Of the joints above j it turns the column, for it is
carried with the body of the frame, and a w that keeps its direction in the world turns the other
way:

    dL_i/dq_j = -L_j x L_i    if j belongs to a joint below that of i, else 0,
    dw/dq_j   = w x omega_j   in axes of the world, else 0.

Where the axes of a joint turn with its own q, v_J = S(q) v, its columns change by dS besides.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from condyn_pin._core._pin import LOCAL, pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.joints import axes
from condyn_pin.constraints.forces import AppliedForce, Loads, frame_jacobian, in_axes
from condyn_pin.constraints.partials.motion import dual_cross
from condyn_pin.dynamics.derivatives.carried import slope


def load_partial(loads: Loads, q: Array, forces: Sequence[AppliedForce]) -> Array:
    """Return the derivative (nv, nv) of sum_f J_f^T f by q, for forces with constant numbers."""
    model, data = loads.model, loads.data
    pin.computeJointJacobians(model, data, q)
    owner = np.concatenate([np.full(j.nv, j.id) for j in model.joints if j.nv > 0 and j.idx_v >= 0])
    below = owner[:, None] < owner[None, :]
    total = np.zeros((model.nv, model.nv))
    for (joint, placement), in_world, wrench in loads.bind(forces):
        L = frame_jacobian(model, data, joint, placement, LOCAL)
        if in_world:
            wrench = in_axes((data.oMi[joint] * placement).rotation, wrench)
            turned = np.vstack([pin.skew(wrench[:3]), pin.skew(wrench[3:])])
            total += L.T @ (turned @ L[3:])
        total += below * (L.T @ dual_cross(wrench) @ L)
        oMf = data.oMi[joint] * placement
        for i, columns, dS in _turning(loads, q, joint):
            on_joint = (data.oMi[i].actInv(oMf)).act(pin.Force(wrench)).vector
            total[columns, columns] += np.einsum("kij,k->ij", dS, on_joint)
    return total


def _turning(loads: Loads, q: Array, end: int) -> Iterator[tuple[int, slice, Array]]:
    """Yield the joints above a frame whose axes turn with their q, their columns, and S by q."""
    model = loads.model
    for i in list(model.supports[end])[1:]:
        if i in loads.turning:
            joint = model.joints[i]
            columns = slice(joint.idx_v, joint.idx_v + joint.nv)
            yield i, columns, _axes_by_q(model, joint, q, np.eye(model.nv)[columns])


def _axes_by_q(model: Any, joint: Any, q: Array, directions: Array) -> Array:
    """Return S (6, k) of a joint by each of its coordinates, (6, k, k)."""

    def moved(step: Array) -> Array:
        return axes(joint, pin.integrate(model, q, step))

    return np.stack([slope(moved, direction) for direction in directions], axis=-1)
