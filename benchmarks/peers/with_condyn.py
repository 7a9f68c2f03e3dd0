"""condyn_pin itself, on the same states and the same clock."""

from __future__ import annotations

import numpy as np

import condyn_pin as cp
from condyn_pin._core._pin import HAS_LCABA
from condyn_pin.simulation.plan import default_solver
from peers import export
from peers.exported import ACCELERATION, DERIVATIVES, MOTION, Exported
from peers.harness import Candidate, main
from peers.stepping import Step, end_of, rk4, semi_implicit

STEP = 1e-3  # [s]


def candidates(scene: Exported) -> list[Candidate]:
    """Return the hot loop and the full solve of some solvers, derivatives, and time steps."""
    ours = export.scenes()[scene.name]
    solvers: list[cp.dynamics.Solver] = [cp.Proximal(), *([cp.LCABA()] if HAS_LCABA else [])]
    found = [hot(scene, ours, solver) for solver in solvers]
    return [
        *found,
        proved(scene, ours),
        derivatives(scene, ours),
        motion(scene, ours, semi_implicit, "semi-implicit Euler", 50.0),
        motion(scene, ours, rk4, "RK4", 50.0),
    ]


def hot(scene: Exported, ours: cp.Scene, solver: cp.dynamics.Solver) -> Candidate:
    """Return `Workspace.acceleration`."""
    workspace = cp.Workspace(ours, solver)

    def call(i: int) -> np.ndarray:
        return workspace.acceleration(*scene.state(i))

    return Candidate(ACCELERATION, f"{solver.title}, acceleration", call, call)


def proved(scene: Exported, ours: cp.Scene, engine: str = "python") -> Candidate:
    """Return `Workspace.solve`: a, lam, and their errors recomputed; by Python or by the core."""
    workspace = cp.Workspace(ours, cp.Proximal(), engine=engine)

    def call(i: int) -> np.ndarray:
        return workspace.solve(*scene.state(i)).a

    note = "recomputes the errors of the answer; no peer does"
    return Candidate(ACCELERATION, "Proximal, solve with proof", call, call, note)


def derivatives(scene: Exported, ours: cp.Scene, engine: str = "python") -> Candidate:
    """Return the solve and the derivatives of a and of lam; by Python or by the core."""
    workspace = cp.Workspace(ours, cp.Proximal(), engine=engine)

    def call(i: int) -> tuple[np.ndarray, ...]:
        d = workspace.derivatives(*scene.state(i))
        return d.da_dq, d.da_dv, d.da_dtau

    def answer(i: int) -> tuple[np.ndarray, ...]:
        da_dq, da_dv, da_dtau = call(i)
        return da_dq, da_dv, da_dtau[:, scene.motors]

    note = "with the solve and its proof; also those of lam"
    return Candidate(DERIVATIVES, "kkt, after Proximal", call, answer, note)


def motion(scene: Exported, ours: cp.Scene, step: Step, method: str, wave: float) -> Candidate:
    """Return a loop of steps in Python, with Baumgarte's alpha = beta = wave [1/s].

    The solver is the one that `simulate` takes by default.
    """
    drift = cp.Baumgarte(wave, wave)
    workspace, tau = cp.Workspace(ours, default_solver(ours), drift=drift), np.zeros(scene.nv)
    model, acceleration = workspace.model, workspace.acceleration

    def a(q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return acceleration(q, v, tau)

    def call(_: int) -> np.ndarray:
        return end_of(step, model, a, scene.state(0)[:2], scene.duration, STEP)

    name = f"{method}, 1 ms, Baumgarte {wave:g} 1/s"
    return Candidate(MOTION, name, call, call, "a loop in Python")


if __name__ == "__main__":
    main("condyn_pin", cp.__version__, candidates)
