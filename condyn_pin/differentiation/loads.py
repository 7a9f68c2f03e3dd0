"""How the torques of forces on frames change with q.

With L the Jacobian of the frame in its own axes, one column a coordinate, and w the wrench in the
same axes,

    tau_i = L_i . w

A step of coordinate j moves the frame by L_j. Of the joints above j it turns the column, for it is
carried with the body of the frame, and a w that keeps its direction in the world turns the other
way:

    dL_i/dq_j = -L_j x L_i    if j belongs to a joint below that of i, else 0,
    dw/dq_j   = w x omega_j   in axes of the world, else 0.

Where the axes of a joint turn with its own q, v_J = S(q) v, its columns change by dS besides. S is
made of sines, cosines and powers of few coordinates, so that a central difference of order eight
gives dS to rounding.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, Final

import numpy as np

from condyn_pin._pin import LOCAL, pin
from condyn_pin.applied_force import AppliedForce
from condyn_pin.arrays import Array
from condyn_pin.differentiation.partials import dual_cross
from condyn_pin.loads import Loads, frame_jacobian, in_axes

# Of f'(0) from f(h) - f(-h), f(2 h) - f(-2 h), and so on; the remainder is h^8 / 630 f^(9).
_STENCIL: Final = (4 / 5, -1 / 5, 4 / 105, -1 / 280)
_STEP: Final = 0.03


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
        for i, columns, dS in _turning(model, q, joint):
            on_joint = (data.oMi[i].actInv(oMf)).act(pin.Force(wrench)).vector
            total[columns, columns] += np.einsum("kij,k->ij", dS, on_joint)
    return total


def _turning(model: Any, q: Array, joint: int) -> Iterator[tuple[int, slice, Array]]:
    """Yield the joints above a frame whose axes turn with their q, and dS (6, nv, nv)."""
    for i in list(model.supports[joint])[1:]:
        each = model.joints[i]
        if each.nq == each.nv > 1:  # else S is constant
            dS = _axes_partial(each, q)
            if dS.any():
                yield i, slice(each.idx_v, each.idx_v + each.nv), dS


def _axes_partial(joint: Any, q: Array) -> Array:
    """Return dS_i/dq_j (6, nv, nv) of a joint at q."""
    data, n = joint.createData(), joint.nv

    def axes(j: int, step: float) -> Array:
        moved = q.copy()
        moved[joint.idx_q + j] += step
        joint.calc(data, moved)
        return np.array(data.S).reshape(6, n)

    dS = np.zeros((6, n, n))
    for j in range(n):
        for k, weight in enumerate(_STENCIL, 1):
            dS[:, :, j] += weight / _STEP * (axes(j, k * _STEP) - axes(j, -k * _STEP))
    return dS
