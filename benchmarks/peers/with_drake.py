"""Drake: nearly rigid constraints in discrete time, by SAP.

It has no a of a state but over a step, a = (v_next - v) / h. `drake_plant.py` has its coordinates.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib.metadata import version

import numpy as np
from pydrake.autodiffutils import ExtractGradient, ExtractValue, InitializeAutoDiff
from pydrake.systems.analysis import Simulator

from peers.drake_plant import Engine, rotation
from peers.exported import ACCELERATION, DERIVATIVES, MOTION, Exported
from peers.harness import Candidate, main

STEP = 1e-3  # [s] with 1e-5 the errors of a are the same: they are those of the soft constraints
NOTE = "nearly rigid constraints; a is the change of v over a step"


def candidates(scene: Exported) -> list[Candidate]:
    """Return a step, its derivatives by automatic differentiation, and motions."""
    return [
        acceleration(scene, STEP),
        derivatives(scene, STEP),
        *(motion(scene, h) for h in (STEP, STEP / 10)),
    ]


def acceleration(scene: Exported, step: float) -> Candidate:
    """Return one discrete update."""
    engine = Engine(scene, step)
    plant, context = engine.plant, engine.context

    def call(i: int) -> np.ndarray:
        plant.SetPositionsAndVelocities(context, engine.x[i])
        engine.torque.FixValue(context, engine.tau[i])
        return plant.EvalUniquePeriodicDiscreteUpdate(context).value()

    def answer(i: int) -> np.ndarray:
        q, v, _ = scene.state(i)
        after = call(i).ravel()
        slope = (after - engine.x[i])[plant.num_positions() :] / step
        return engine.acceleration(q, v, slope)

    return Candidate(ACCELERATION, f"SAP, one step of {step:g} s", call, answer, NOTE)


def derivatives(scene: Exported, step: float) -> Candidate:
    """Return one discrete update in numbers that carry their derivatives by q, v and tau.

    The state is handed over with its derivatives by Pinocchio's coordinates. How Drake's differ
    from these is found by central differences, once for each state.
    """
    engine = Engine(scene, step)
    nq, nv = engine.plant.num_positions(), scene.nv
    plant = engine.plant.ToAutoDiffXd()
    context = plant.CreateDefaultContext()
    torque = plant.get_applied_generalized_force_input_port()
    inputs = [_seeded(engine, i) for i in range(scene.count)]

    def call(i: int) -> np.ndarray:
        x, tau = inputs[i]
        plant.SetPositionsAndVelocities(context, x)
        torque.FixValue(context, tau)
        return plant.EvalUniquePeriodicDiscreteUpdate(context).value()

    def answer(i: int) -> tuple[np.ndarray, ...]:
        after = call(i).ravel()[nq:]
        before = inputs[i][0][nq:]
        slope = (ExtractValue(after).ravel() - ExtractValue(before).ravel()) / step
        partial = (ExtractGradient(after) - ExtractGradient(before)) / step
        q, v, _ = scene.state(i)
        turn = np.column_stack([engine.acceleration(q, v, e) for e in np.eye(nv)])
        turn -= engine.acceleration(q, v, np.zeros(nv))[:, None]
        found = turn @ partial
        found += _slopes(scene, i, lambda q, v, tau: engine.acceleration(q, v, slope))
        return found[:, :nv], found[:, nv : 2 * nv], found[:, 2 * nv :][:, scene.motors]

    method = f"SAP, AutoDiffXd, one step of {step:g} s"
    return Candidate(DERIVATIVES, method, call, answer, NOTE)


def _seeded(engine: Engine, i: int) -> tuple[np.ndarray, np.ndarray]:
    """Return Drake's state and torque with their derivatives by Pinocchio's q, v and tau."""
    state = _slopes(engine.scene, i, lambda q, v, tau: engine.state(q, v))
    torque = _slopes(engine.scene, i, lambda q, v, tau: engine.velocity(q, tau))
    return (
        InitializeAutoDiff(engine.x[i], state).ravel(),
        InitializeAutoDiff(engine.tau[i], torque).ravel(),
    )


def _slopes(scene: Exported, i: int, f: Callable[..., np.ndarray]) -> np.ndarray:
    """Return the derivatives of f(q, v, tau) by central differences, (size, 3 nv)."""
    h, n, (q, v, tau) = 1e-6, scene.nv, scene.state(i)

    def at(d: np.ndarray) -> np.ndarray:
        return f(integrate(scene, q, d[:n]), v + d[n : 2 * n], tau + d[2 * n :])

    return np.column_stack([(at(d) - at(-d)) / (2 * h) for d in h * np.eye(3 * n)])


def integrate(scene: Exported, q: np.ndarray, dq: np.ndarray) -> np.ndarray:
    """Return q moved by a small dq, to second order."""
    moved = q.copy()
    for joint in scene.joints:
        here, d = slice(joint.idx_q, joint.idx_q + joint.nq), dq[joint.idx_v :][: joint.nv]
        if joint.kind == "free":
            R = rotation(q[here][3:])
            moved[here][:3] += R @ d[:3]
        if joint.kind in ("free", "ball"):
            w, u = q[here][-1], q[here][-4:-1]
            half = d[-3:] / 2
            turned = np.r_[u + w * half + np.cross(u, half), w - u @ half]
            moved[here][-4:] = turned / np.linalg.norm(turned)
        else:
            moved[here] += d
    return moved


def motion(scene: Exported, step: float) -> Candidate:
    """Return Simulator.AdvanceTo."""
    engine = Engine(scene, step)
    simulator = Simulator(engine.plant)
    context = simulator.get_mutable_context()
    engine.torque.FixValue(context, np.zeros(scene.nv))
    simulator.Initialize()

    def call(_: int) -> None:
        context.SetTime(0.0)
        engine.plant.SetPositionsAndVelocities(context, engine.x[0])
        simulator.Initialize()
        simulator.AdvanceTo(scene.duration)

    def answer(_: int) -> np.ndarray:
        call(0)
        return engine.configuration(engine.plant.GetPositionsAndVelocities(context))

    return Candidate(MOTION, f"SAP, Simulator, {1e3 * step:g} ms", call, answer)


if __name__ == "__main__":
    main("Drake", version("drake"), candidates)
