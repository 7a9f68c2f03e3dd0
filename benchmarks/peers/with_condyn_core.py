"""condyn_pin's compiled core, on the same states and the same clock."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import condyn_pin as cp
from peers import export
from peers.exported import MOTION, Exported
from peers.harness import Candidate, main
from peers.with_condyn import STEP, derivatives, proved


def candidates(scene: Exported) -> list[Candidate]:
    """Return the solve with its proof, the derivatives, and time steps."""
    ours = export.scenes()[scene.name]
    euler, rk4 = cp.SemiImplicitEuler(), cp.RungeKutta4()
    return [
        proved(scene, ours, engine="core"),
        derivatives(scene, ours, engine="core"),
        motion(scene, ours, euler, "semi-implicit Euler"),
        motion(scene, ours, rk4, "RK4"),
    ]


def motion(
    scene: Exported, ours: cp.Scene, integrator: cp.simulation.Integrator, name: str
) -> Candidate:
    """Return `simulate_batch` of one motion, one thread, with Baumgarte's alpha = beta = 50 1/s."""
    drift, core, loose = cp.Baumgarte(50.0, 50.0), cp.Native(threads=1), without_springs(ours)
    q, v = (each[None] for each in scene.state(0)[:2])

    def call(_: int) -> np.ndarray:
        found = cp.simulate_batch(
            loose, q, v, duration=scene.duration, dt=STEP, integrator=integrator, drift=drift,
            executor=core,
        )  # fmt: skip
        return found.q[0]

    method = f"{name}, 1 ms, Baumgarte 50 1/s"
    return Candidate(MOTION, method, call, call, "the loop is in C++; energy and gaps recorded")


def without_springs(scene: cp.Scene) -> cp.Scene:
    """Return the same machine without springs and damping: no peer's motion has any."""
    model = scene.robot.model.copy()
    model.damping = np.zeros(model.nv)
    return cp.Scene(replace(scene.robot, model=model, springs=[]), scene.constraints)


if __name__ == "__main__":
    main("condyn_pin, compiled", cp.__version__, candidates)
