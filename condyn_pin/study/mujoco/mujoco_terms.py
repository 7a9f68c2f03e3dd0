"""MuJoCo's terms in Pinocchio's coordinates.

By qvel = X v (`mujoco_bridge` has X) and the principle of virtual work,

    M = X' M_mj X,    h = X' (h_mj + M_mj Xdot v),    tau_passive = X' qfrc_passive,
    a = X' (qacc_smooth - Xdot v),    J = J_mj X.
"""

from __future__ import annotations

import copy
from math import asin
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin.constraints.rows.bound import ConstraintViolation

if TYPE_CHECKING:
    from condyn_pin.study.mujoco.mujoco_bridge import MujocoBridge

# What would add rows beside equalities, and torques beside those given.
_OFF: Final = ("ACTUATION", "CONTACT", "LIMIT", "FRICTIONLOSS")


class LoopRows(NamedTuple):
    """A loop in one engine: its rows of J (m, nv), and how far it is open [m, rad]."""

    J: Array
    violation: ConstraintViolation


class MujocoTerms:
    """MuJoCo's terms at a state, in Pinocchio's coordinates; loops by the name of the equality."""

    def __init__(self, bridge: MujocoBridge, q: Array, v: Array, tau: Array) -> None:
        import mujoco

        self._bridge, self._state = bridge, (q, v)
        mj = copy.copy(bridge.model)
        for name in _OFF:
            mj.opt.disableflags |= int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{name}"))
        mj.opt.enableflags = 0
        mj.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
        self.data = mujoco.MjData(mj)
        self.data.qpos[:], self.data.qvel[:] = bridge.to_mujoco(q, v)
        self.data.qfrc_applied[:] = bridge.torque_to_mujoco(q, tau)
        mujoco.mj_forward(mj, self.data)
        M = np.zeros((mj.nv, mj.nv))
        if int(mujoco.__version__.split(".")[0]) >= 4:
            mujoco.mj_fullM(mj, self.data, M)
        else:
            mujoco.mj_fullM(mj, M, self.data.qM)
        X = bridge.velocity_map(q)
        turning = bridge.acceleration_to_mujoco(q, v, np.zeros_like(v))  # Xdot v
        self.M: Array = X.T @ M @ X
        self.h: Array = X.T @ (self.data.qfrc_bias + M @ turning)
        self.passive: Array = X.T @ self.data.qfrc_passive
        self.loops: dict[str, LoopRows] = {}
        J = self.data.efc_J.reshape(-1, mj.nv) @ X
        equality = self.data.efc_type == int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)
        for k, tag in equalities_of(mj).items():
            here = equality & (self.data.efc_id == k)
            if here.any():
                name = mj.equality(k).name or f"{tag}{k}"
                gap = _gap(self.data.efc_pos[here], mj.eq_data[k, 10])
                self.loops[name] = LoopRows(J[here], gap)

    def acceleration(self, tau: Array) -> Array:
        """Return a without constraints; MuJoCo's own, unless joints are held that it would move."""
        if self._bridge.without:
            return np.asarray(np.linalg.solve(self.M, tau + self.passive - self.h), dtype=float)
        return self._bridge.acceleration_from_mujoco(*self._state, self.data.qacc_smooth)


def equalities_of(mj: Any) -> dict[int, str]:
    """Return the kinds of equalities that are like loops or couplings, by index."""
    import mujoco

    kinds = {"connect": mujoco.mjtEq.mjEQ_CONNECT, "weld": mujoco.mjtEq.mjEQ_WELD,
             "joint": mujoco.mjtEq.mjEQ_JOINT, "tendon": mujoco.mjtEq.mjEQ_TENDON}  # fmt: skip
    tags = {int(kind): tag for tag, kind in kinds.items()}
    return {k: tags[int(kind)] for k, kind in enumerate(mj.eq_type) if int(kind) in tags}


def _gap(rows: Array, torque_scale: float) -> ConstraintViolation:
    """Return how far an equality is open; the angular rows of a weld are scale sin(angle / 2)."""
    sine = float(np.linalg.norm(rows[3:])) / (torque_scale or 1.0)
    return ConstraintViolation(float(np.linalg.norm(rows[:3])), 2.0 * asin(min(sine, 1.0)))
