"""The same robot in MuJoCo: its file, its states there and back, its equalities made stiff."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

import condyn_pin as cp

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
    bridge : MujocoBridge
    model : mujoco.MjModel
        Of `Robot.to_mjcf`, without contacts and joint limits.
    data : mujoco.MjData
    """

    bridge: cp.study.MujocoBridge
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
        return cls(cp.study.MujocoBridge(robot, model), model, mujoco.MjData(model))

    def set(self, q: np.ndarray, v: np.ndarray) -> None:
        """Begin at a state of Pinocchio."""
        mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[:], self.data.qvel[:] = self.bridge.to_mujoco(q, v)

    def state(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the present state as Pinocchio has it."""
        return self.bridge.from_mujoco(self.data.qpos, self.data.qvel)

    def physics(self) -> np.ndarray:
        """Return the present state as `mujoco.rollout` takes it."""
        kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
        state = np.zeros(mujoco.mj_stateSize(self.model, kind))
        mujoco.mj_getState(self.model, self.data, state, kind)
        return state
