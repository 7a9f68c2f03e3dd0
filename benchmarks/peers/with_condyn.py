"""condyn_pin itself, on the same states and the same clock."""

from __future__ import annotations

import numpy as np

import condyn_pin as cp
from condyn_pin._pin import HAS_LCABA, pin
from peers import export
from peers.exported import ACCELERATION, DERIVATIVES, MOTION, Exported
from peers.harness import Candidate, main

STEP = 1e-3  # [s]


def candidates(scene: Exported) -> list[Candidate]:
    """Return the hot loop and the full solve of some solvers, derivatives, and time steps."""
    ours = export.scenes()[scene.name]
    solvers: list[cp.Solver] = [cp.Proximal(), *([cp.LCABA()] if HAS_LCABA else [])]
    found = [hot(scene, ours, solver) for solver in solvers]
    return [
        *found,
        proved(scene, ours),
        derivatives(scene, ours),
        *(motion(scene, ours, wave) for wave in (0.0, 50.0)),
    ]


def hot(scene: Exported, ours: cp.Scene, solver: cp.Solver) -> Candidate:
    """Return `Workspace.acceleration`."""
    workspace = cp.Workspace(ours, solver)

    def call(i: int) -> np.ndarray:
        return workspace.acceleration(*scene.state(i))

    return Candidate(ACCELERATION, f"{solver.title}, acceleration", call, call)


def proved(scene: Exported, ours: cp.Scene) -> Candidate:
    """Return `Workspace.solve`: a, lam, and their errors recomputed."""
    workspace = cp.Workspace(ours, cp.Proximal())

    def call(i: int) -> np.ndarray:
        return workspace.solve(*scene.state(i)).a

    note = "recomputes the errors of the answer; no peer does"
    return Candidate(ACCELERATION, "Proximal, solve with proof", call, call, note)


def derivatives(scene: Exported, ours: cp.Scene) -> Candidate:
    """Return the solve and the derivatives of a and of lam."""
    workspace = cp.Workspace(ours, cp.Proximal())

    def call(i: int) -> tuple[np.ndarray, ...]:
        d = workspace.derivatives(*scene.state(i))
        return d.da_dq, d.da_dv, d.da_dtau

    def answer(i: int) -> tuple[np.ndarray, ...]:
        da_dq, da_dv, da_dtau = call(i)
        return da_dq, da_dv, da_dtau[:, scene.motors]

    note = "with the solve and its proof; also those of lam"
    return Candidate(DERIVATIVES, "kkt, after Proximal", call, answer, note)


def motion(scene: Exported, ours: cp.Scene, wave: float) -> Candidate:
    """Return a loop of semi-implicit steps in Python, with Baumgarte's alpha = beta = wave."""
    drift = cp.Baumgarte(wave, wave) if wave else None
    workspace = cp.Workspace(ours, cp.Proximal(), drift=drift)
    model, count, tau = workspace.model, round(scene.duration / STEP), np.zeros(scene.nv)

    def call(_: int) -> np.ndarray:
        q, v, _tau = scene.state(0)
        for _step in range(count):
            v = v + STEP * workspace.acceleration(q, v, tau)
            q = pin.integrate(model, q, STEP * v)
        return q

    method = "semi-implicit Euler, 1 ms" + (f", Baumgarte {wave:g} 1/s" if wave else "")
    return Candidate(MOTION, method, call, call, "a loop in Python")


if __name__ == "__main__":
    main("condyn_pin", cp.__version__, candidates)
