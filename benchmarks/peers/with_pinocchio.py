"""Pinocchio called directly, as its examples do."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from peers.bare import Bare, acceleration, settings_of
from peers.exported import ACCELERATION, MOTION, Exported
from peers.harness import Candidate, main

DEFAULT = {"absolute_accuracy": 1e-12, "relative_accuracy": 1e-12, "mu": 0.0, "max_iterations": 1}
STEP = 1e-3  # [s]


def candidates(scene: Exported) -> list[Candidate]:
    """Return constraintDynamics, lcaba, their derivatives and two loops of time steps."""
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
    wanted = settings_of({**scene.settings, "mu": 1e-6})

    def call(i: int) -> np.ndarray:
        q, v, tau = scene.state(i)
        return pin.lcaba(bare.model, bare.data, q, v, tau, bare.models, bare.datas, wanted)

    note = "with 6-row constraints every second call on the same Data is wrong"
    return Candidate(ACCELERATION, "lcaba, mu 1e-6", call, lambda i: call(i).copy(), note)


def motion(scene: Exported, method: str, step: Any) -> Candidate:
    """Return a loop of time steps in Python."""
    bare, wanted = Bare(scene), settings_of(scene.settings)
    model, data = bare.model, bare.data
    tau, count = np.zeros(scene.nv), round(scene.duration / STEP)
    args = (bare.models, bare.datas, wanted)

    def a(q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return pin.constraintDynamics(model, data, q, v, tau, *args)

    def call(_: int) -> np.ndarray:
        q, v, _tau = scene.state(0)
        for _step in range(count):
            q, v = step(model, a, q, v)
        return q

    return Candidate(MOTION, method, call, call, "a loop in Python; no drift control")


def semi_implicit(model: pin.Model, a: Any, q: np.ndarray, v: np.ndarray) -> tuple[Any, Any]:
    """Return the state after v += h a, q += h v."""
    v = v + STEP * a(q, v)
    return pin.integrate(model, q, STEP * v), v


def rk4(model: pin.Model, a: Any, q: np.ndarray, v: np.ndarray) -> tuple[Any, Any]:
    """Return the state after a step of the classical method, increments in the space at q."""
    h = STEP
    a1 = a(q, v)
    v2 = v + h / 2 * a1
    a2 = a(pin.integrate(model, q, h / 2 * v), v2)
    v3 = v + h / 2 * a2
    a3 = a(pin.integrate(model, q, h / 2 * v2), v3)
    v4 = v + h * a3
    a4 = a(pin.integrate(model, q, h * v3), v4)
    q = pin.integrate(model, q, h / 6 * (v + 2 * v2 + 2 * v3 + v4))
    return q, v + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)


if __name__ == "__main__":
    main("Pinocchio", pin.__version__, candidates)
