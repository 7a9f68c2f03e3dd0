"""The same robot in MuJoCo: its file, its states there and back, its equalities made stiff."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

import condyn_pin as cp
from condyn_pin._pin import pin

# solref and solimp of equalities: MuJoCo's own, and two that are as stiff as they may be.
SETTINGS = {
    "default": None,
    "solref .002, solimp .9999": (0.002, 0.9999),
    "solref .005, solimp .9999": (0.005, 0.9999),
}

# As stiff as it may be at smaller steps: solref is no less than two of them.
SMALL_STEPS = {
    "solref .0005, solimp .9999": (0.0005, 0.9999),
    "solref .0002, solimp .9999": (0.0002, 0.9999),
}

INTEGRATORS = {
    "Euler": mujoco.mjtIntegrator.mjINT_EULER,
    "RK4": mujoco.mjtIntegrator.mjINT_RK4,
    "implicitfast": mujoco.mjtIntegrator.mjINT_IMPLICITFAST,
}


@dataclass(frozen=True, eq=False)
class Twin:
    """A robot in both engines.

    Attributes
    ----------
    robot : Robot
    model : mujoco.MjModel
        Of `Robot.to_mjcf`, without contacts and joint limits.
    data : mujoco.MjData
    """

    robot: cp.Robot
    model: Any
    data: Any

    @classmethod
    def of(
        cls,
        robot: cp.Robot,
        setting: str,
        integrator: str,
        dt: float,
        *,
        conservative: bool,
    ) -> Twin:
        """Return a robot in MuJoCo; without damping if it is to conserve energy."""
        model = mujoco.MjModel.from_xml_string(robot.to_mjcf())
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_LIMIT
        if conservative:
            model.dof_damping[:] = 0.0
        stiff = (SETTINGS | SMALL_STEPS)[setting]
        if stiff:
            model.eq_solref[:, 0], model.eq_solref[:, 1] = stiff[0], 1.0
            model.eq_solimp[:, :2] = stiff[1]
        model.opt.timestep, model.opt.integrator = dt, INTEGRATORS[integrator]
        return cls(robot, model, mujoco.MjData(model))

    def set(self, q: np.ndarray, v: np.ndarray) -> None:
        """Begin at a state of Pinocchio."""
        mujoco.mj_resetData(self.model, self.data)
        for joint, x, dof in self._joints():
            part, speed = q[joint.idx_q :][: joint.nq].copy(), v[joint.idx_v :][: joint.nv].copy()
            if joint.nq == 7:
                speed[:3] = pin.XYZQUATToSE3(part).rotation @ speed[:3]
            if joint.nq >= 4:
                part[-4:] = np.roll(part[-4:], 1)  # x y z w to w x y z
            self.data.qpos[x : x + joint.nq] = part
            self.data.qvel[dof : dof + joint.nv] = speed

    def state(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the present state as Pinocchio has it."""
        q, v = pin.neutral(self.robot.model), np.zeros(self.robot.nv)
        for joint, x, dof in self._joints():
            part = self.data.qpos[x : x + joint.nq].copy()
            speed = self.data.qvel[dof : dof + joint.nv].copy()
            if joint.nq >= 4:
                part[-4:] = np.roll(part[-4:], -1)
            if joint.nq == 7:
                speed[:3] = pin.XYZQUATToSE3(part).rotation.T @ speed[:3]
            q[joint.idx_q : joint.idx_q + joint.nq] = part
            v[joint.idx_v : joint.idx_v + joint.nv] = speed
        return q, v

    def physics(self) -> np.ndarray:
        """Return the present state as `mujoco.rollout` takes it."""
        kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
        state = np.zeros(mujoco.mj_stateSize(self.model, kind))
        mujoco.mj_getState(self.model, self.data, state, kind)
        return state

    def _joints(self) -> list[tuple[Any, int, int]]:
        pairs = []
        for i in range(1, self.robot.model.njoints):
            there = self.model.joint(self.robot.model.names[i])
            pairs.append((self.robot.model.joints[i], int(there.qposadr[0]), int(there.dofadr[0])))
        return pairs
