"""MuJoCo: soft equality constraints, the state in its own coordinates.

Pinocchio's velocity of a free joint is in the axes of its body, MuJoCo's linear part in those of
the world. With R the rotation of the body, X = diag(R, 1, ...),

    v_mj = X v,    tau_mj = X tau,    a_mj = X a + R (omega x v) in the linear rows.

Springs, dampers, limits and contacts are switched off: all compute the same motion.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import mujoco.rollout
import numpy as np

from peers.exported import ACCELERATION, DERIVATIVES, MOTION, Exported
from peers.harness import Candidate, main

STEP = 1e-3  # [s]


@dataclass(frozen=True)
class Knobs:
    """Options of MuJoCo that trade accuracy."""

    solver: str = "Newton"
    solref: tuple[float, float] = (0.02, 1.0)
    impedance: float | None = None  # both ends of solimp; None: MuJoCo's 0.9 ... 0.95
    integrator: str = "Euler"

    def __str__(self) -> str:
        solimp = f"solimp {self.impedance:g}" if self.impedance else "default"
        solref = f", solref {self.solref[0]:g}" if self.solref != Knobs.solref else ""
        return f"{self.solver}, {solimp}{solref}"


SOFT, SOFT_CG = Knobs(), Knobs(solver="CG")
STIFF = Knobs(impedance=0.9999, solref=(0.002, 1.0))
STIFF_CG = Knobs(solver="CG", impedance=0.9999, solref=(0.002, 1.0))
BEST = Knobs(impedance=0.9999, solref=(0.005, 1.0), integrator="RK4")


def candidates(scene: Exported) -> list[Candidate]:
    """Return forward dynamics, differences and time steps, soft and stiff."""
    accelerations = [forward(scene, parameters) for parameters in (SOFT, SOFT_CG, STIFF, STIFF_CG)]
    differences = [
        transition(scene, parameters, centred)
        for parameters in (SOFT, STIFF)
        for centred in (False, True)
    ]
    steps = [stepping(scene, parameters) for parameters in (SOFT, STIFF, BEST)]
    return [*accelerations, *differences, *steps, *(rolled(scene, k) for k in (STIFF, BEST))]


class Engine:
    """A model with its parameters, memory, and the exported states in MuJoCo's coordinates."""

    def __init__(self, scene: Exported, parameters: Knobs) -> None:
        self.scene = scene
        self.model = mujoco.MjModel.from_xml_path(str(scene.folder / "scene.xml"))
        for flag in ("SPRING", "DAMPER", "PASSIVE", "LIMIT", "CONTACT", "FRICTIONLOSS"):
            bit = getattr(mujoco.mjtDisableBit, f"mjDSBL_{flag}", 0)
            self.model.opt.disableflags |= int(bit)
        self.model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_EULERDAMP)
        self.model.opt.timestep = STEP
        self.model.opt.solver = getattr(mujoco.mjtSolver, f"mjSOL_{parameters.solver.upper()}")
        self.model.opt.integrator = getattr(
            mujoco.mjtIntegrator,
            {"Euler": "mjINT_EULER", "RK4": "mjINT_RK4"}[parameters.integrator],
        )
        self.model.eq_solref[:] = parameters.solref
        if parameters.impedance:
            self.model.eq_solimp[:, :2] = parameters.impedance
        self.data = mujoco.MjData(self.model)
        self.qpos = [self.positions(q) for q in scene.states["q"]]
        self.maps = [self.map(q) for q in scene.states["q"]]
        self.qvel = [X @ v for X, v in zip(self.maps, scene.states["v"], strict=True)]
        self.torque = [X @ tau for X, tau in zip(self.maps, scene.states["tau"], strict=True)]

    def set(self, i: int) -> None:
        """Put the engine into state i."""
        self.data.qpos[:] = self.qpos[i]
        self.data.qvel[:] = self.qvel[i]
        self.data.qfrc_applied[:] = self.torque[i]

    def positions(self, q: np.ndarray) -> np.ndarray:
        """Return q as MuJoCo counts it: quaternions w x y z, free joints in the world."""
        qpos = q.copy()
        for joint in self.scene.joints:
            x = q[joint.idx_q : joint.idx_q + joint.nq]
            if joint.kind == "free":
                _check_at_origin(joint)
                qpos[joint.idx_q + 3 : joint.idx_q + 7] = np.roll(x[3:], 1)
            elif joint.kind == "ball":
                qpos[joint.idx_q : joint.idx_q + 4] = np.roll(x, 1)
        return qpos

    def configuration(self, qpos: np.ndarray) -> np.ndarray:
        """Return MuJoCo's positions as Pinocchio counts them."""
        q = qpos.copy()
        for joint in self.scene.joints:
            if joint.kind in ("free", "ball"):
                start = joint.idx_q + joint.nq - 4
                q[start : start + 4] = np.roll(qpos[start : start + 4], -1)
        return q

    def map(self, q: np.ndarray) -> np.ndarray:
        """Return X."""
        X = np.eye(self.scene.nv)
        for rows, _, R in free_joints(self.scene, q):
            X[rows, rows] = R
        return X

    def acceleration(self, i: int, qacc: np.ndarray) -> np.ndarray:
        """Return a from MuJoCo's: X' a_mj - omega x v in the linear rows."""
        v, a = self.scene.states["v"][i], self.maps[i].T @ qacc
        for linear, angular, _ in free_joints(self.scene, self.scene.states["q"][i]):
            a[linear] -= np.cross(v[angular], v[linear])
        return a


def free_joints(scene: Exported, q: np.ndarray) -> list[tuple[slice, slice, np.ndarray]]:
    """Return linear rows, angular rows and rotation of each free joint."""
    found = []
    for joint in scene.joints:
        if joint.kind == "free":
            R = np.zeros(9)
            mujoco.mju_quat2Mat(R, np.roll(q[joint.idx_q + 3 : joint.idx_q + 7], 1))
            k = joint.idx_v
            found.append((slice(k, k + 3), slice(k + 3, k + 6), R.reshape(3, 3)))
    return found


def _check_at_origin(joint: object) -> None:
    R, p = joint.placement  # type: ignore[attr-defined]
    if not (np.array_equal(R, np.eye(3)) and not np.any(p)):
        raise ValueError("a free joint must stand at the origin of the world")


def forward(scene: Exported, parameters: Knobs) -> Candidate:
    """Return mj_forward."""
    engine = Engine(scene, parameters)

    def call(i: int) -> None:
        engine.set(i)
        mujoco.mj_forward(engine.model, engine.data)

    def answer(i: int) -> np.ndarray:
        call(i)
        return engine.acceleration(i, engine.data.qacc)

    return Candidate(ACCELERATION, f"mj_forward, {parameters}", call, answer, "soft constraints")


def transition(scene: Exported, parameters: Knobs, centred: bool) -> Candidate:
    """Return mjd_transitionFD, finite differences of a time step."""
    engine = Engine(scene, parameters)
    nv, nu = engine.model.nv, engine.model.nu
    A, B = np.zeros((2 * nv, 2 * nv)), np.zeros((2 * nv, nu))

    def call(i: int) -> None:
        engine.set(i)
        mujoco.mjd_transitionFD(engine.model, engine.data, 1e-6, centred, A, B, None, None)

    def answer(i: int) -> tuple[np.ndarray, ...]:
        call(i)
        F_q, F_v = A[nv:, :nv] / STEP, (A[nv:, nv:] - np.eye(nv)) / STEP
        engine.set(i)
        mujoco.mj_forward(engine.model, engine.data)
        return in_body_axes(engine, i, F_q, F_v, B[nv:] / STEP, engine.data.qacc.copy())

    method = f"mjd_transitionFD, {'centred' if centred else 'one-sided'}, {parameters}"
    return Candidate(DERIVATIVES, method, call, answer, "finite differences of a soft step")


def in_body_axes(
    engine: Engine, i: int, F_q: np.ndarray, F_v: np.ndarray, F_u: np.ndarray, qacc: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return da_dq, da_dv, da_du in Pinocchio's coordinates from those of a_mj = F(q, v_mj, u).

    While q turns by dphi, v stays in body axes: v_mj moves by -R [v]x dphi, and the result is
    looked at from axes that turn, which adds [R' a_mj]x dphi.
    """
    scene, X = engine.scene, engine.maps[i]
    q, v, _ = scene.state(i)
    turned = np.zeros_like(F_q)
    free = free_joints(scene, q)
    for linear, angular, R in free:
        turned[linear, angular] = -R @ _cross(v[linear])
    da_dq, da_dv = X.T @ (F_q @ X + F_v @ turned), X.T @ F_v @ X
    for linear, angular, R in free:
        da_dq[linear, angular] += _cross(R.T @ qacc[linear])
        da_dv[linear, linear] -= _cross(v[angular])
        da_dv[linear, angular] += _cross(v[linear])
    return da_dq, da_dv, X.T @ F_u


def _cross(x: np.ndarray) -> np.ndarray:
    return np.array([[0.0, -x[2], x[1]], [x[2], 0.0, -x[0]], [-x[1], x[0], 0.0]])


def stepping(scene: Exported, parameters: Knobs) -> Candidate:
    """Return a Python loop of mj_step."""
    engine = Engine(scene, parameters)
    count = round(scene.duration / STEP)

    def call(_: int) -> None:
        mujoco.mj_resetData(engine.model, engine.data)
        engine.data.qpos[:], engine.data.qvel[:] = engine.qpos[0], engine.qvel[0]
        for _step in range(count):
            mujoco.mj_step(engine.model, engine.data)

    def answer(_: int) -> np.ndarray:
        call(0)
        return engine.configuration(engine.data.qpos)

    return Candidate(MOTION, f"mj_step, {parameters.integrator}, 1 ms, {parameters}", call, answer)


def rolled(scene: Exported, parameters: Knobs) -> Candidate:
    """Return mujoco.rollout, the loop in C++, in one thread."""
    engine = Engine(scene, parameters)
    model, data, count = engine.model, engine.data, round(scene.duration / STEP)
    data.qpos[:], data.qvel[:] = engine.qpos[0], engine.qvel[0]
    kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
    start = np.zeros(mujoco.mj_stateSize(model, kind))
    mujoco.mj_getState(model, data, start, kind)
    state, sensor = np.zeros((1, count, start.size)), np.zeros((1, count, model.nsensordata))
    roll = mujoco.rollout.Rollout(nthread=0)

    def call(_: int) -> None:
        roll.rollout(model, data, start[None], None, nstep=count, state=state, sensordata=sensor)

    def answer(_: int) -> np.ndarray:
        call(0)
        mujoco.mj_setState(model, data, state[0, -1], kind)
        return engine.configuration(data.qpos)

    method = f"mujoco.rollout, {parameters.integrator}, 1 ms, {parameters}"
    return Candidate(MOTION, method, call, answer, "the loop is in C++")


if __name__ == "__main__":
    main("MuJoCo", mujoco.__version__, candidates)
