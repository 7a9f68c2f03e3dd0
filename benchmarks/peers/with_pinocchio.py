"""Pinocchio called directly, as its examples do."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from peers.bare import Bare, acceleration, settings_of
from peers.exported import ACCELERATION, MOTION, Exported
from peers.harness import Candidate, main
from peers.stepping import Step, end_of, rk4, semi_implicit

DEFAULT = {"absolute_accuracy": 1e-12, "relative_accuracy": 1e-12, "mu": 0.0, "max_iterations": 1}
STEP = 1e-3  # [s]


def candidates(scene: Exported) -> list[Candidate]:
    """Return constraintDynamics with other settings, lcaba, and two loops of time steps."""
    few = {**scene.settings, "mu": 1e-8, "max_iterations": 2}
    found = [
        acceleration(scene, "constraintDynamics, default settings (mu 0)", DEFAULT),
        acceleration(scene, "constraintDynamics, mu 1e-8, 2 iterations", few),
        motion(scene, "semi-implicit Euler, 1 ms", semi_implicit),
        motion(scene, "RK4, 1 ms", rk4),
    ]
    return [*found, lcaba(scene)] if hasattr(pin, "lcaba") else found


def lcaba(scene: Exported) -> Candidate:
    """Return lcaba as its documentation has it: stale from the second call on."""
    bare = Bare(scene)
    pin.computeJointMinimalOrdering(bare.model, bare.data, bare.models)
    wanted = settings_of({**scene.settings, "mu": 1e-6, "max_iterations": 5})

    def call(i: int) -> np.ndarray:
        q, v, tau = scene.state(i)
        return pin.lcaba(bare.model, bare.data, q, v, tau, bare.models, bare.datas, wanted)

    stale = any(c.rows == 6 for c in scene.constraints)
    note = "every second call on the same Data is wrong" if stale else ""
    return Candidate(
        ACCELERATION, "lcaba, mu 1e-6, 5 iterations", call, lambda i: call(i).copy(), note
    )


def motion(scene: Exported, method: str, step: Step) -> Candidate:
    """Return a loop of time steps in Python."""
    bare, tau = Bare(scene), np.zeros(scene.nv)
    model, data = bare.model, bare.data
    args = (bare.models, bare.datas, settings_of(scene.settings))

    def a(q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return pin.constraintDynamics(model, data, q, v, tau, *args)

    def call(_: int) -> np.ndarray:
        return end_of(step, model, a, scene.state(0)[:2], scene.duration, STEP)

    return Candidate(MOTION, method, call, call, "a loop in Python; no drift control")


if __name__ == "__main__":
    main("Pinocchio", pin.__version__, candidates)
