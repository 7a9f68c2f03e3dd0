"""The verb simulate: a scene in motion."""

from __future__ import annotations

from math import ceil

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin.drift import Baumgarte, Drift
from condyn_pin.drift.no_drift import NoDrift
from condyn_pin.scene import Scene
from condyn_pin.simulation.anchoring import anchored
from condyn_pin.simulation.integrators import Integrator
from condyn_pin.simulation.integrators.runge_kutta4 import RungeKutta4
from condyn_pin.simulation.system import System
from condyn_pin.simulation.torques import Torque
from condyn_pin.simulation.trajectory import Trajectory
from condyn_pin.solvers.base import Solver
from condyn_pin.workspace import Workspace


def simulate(
    scene: Scene,
    q: ArrayLike,
    v: ArrayLike,
    tau: float | ArrayLike | Torque = 0.0,
    *,
    duration: float,  # [s]
    dt: float = 1e-3,  # [s]
    integrator: Integrator | None = None,
    drift: Drift | None = None,
    solver: Solver | None = None,
    record: int = 1,
) -> Trajectory:
    """Return the motion of a scene."""
    scene = anchored(scene, np.array(q, dtype=float))
    integrator = RungeKutta4() if integrator is None else integrator
    if drift is None:
        drift = NoDrift() if integrator.keeps_constraints else Baumgarte(0.1 / dt, 0.1 / dt)
    system = System(Workspace(scene, solver, drift=drift.rows), tau)
    stepper, correct = integrator.start(system, dt), drift.start(system, dt)
    steps = ceil(duration / dt - 1e-9)
    rows = []
    t = 0.0
    q_, v_ = np.array(q, dtype=float), np.array(v, dtype=float)
    for k in range(steps):
        q1, v1, a = stepper.step(k * dt, q_, v_)
        rows.append((k * dt, q_, v_, a, stepper.lam()))
        if correct:
            q1, v1 = correct((k + 1) * dt, q1, v1)
        q_, v_ = q1, v1
    t = steps * dt
    a = system.acceleration(t, q_, v_)
    rows.append((t, q_, v_, a, system.lam()))
    return Trajectory(scene, *(np.array(column) for column in zip(*rows, strict=True)))
