"""Whether the solver of a run was good enough.

A run calls the hot loop, which proves nothing, and a drift scheme closes what a wrong a has opened:
the constraints hold, and the motion is another one. So some samples are solved once more, with the
proof that `solve` gives.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from condyn_pin.dynamics.workspace import Workspace
from condyn_pin.simulation.defaults import default_solver
from condyn_pin.simulation.torques import Passive

if TYPE_CHECKING:
    from condyn_pin.dynamics.solvers.base import Solver
    from condyn_pin.simulation.recorder import Phase
    from condyn_pin.simulation.trajectory import Trajectory

# Samples of a phase that are looked at. A solver that does not converge misses at most of them.
_LOOKS = 20


def solver_notices(trajectory: Trajectory) -> list[str]:
    """Return a sentence on the error of the accelerations, if it is larger than its solver's.

    Nothing is said of a run that broke down, nor of a solver that answers another question.
    """
    run = trajectory.run
    rows = any(phase.scene.rows for phase in trajectory.phases)
    if not (run.status.ok and run.solver.exact and rows):
        return []
    by_default = run.solver == default_solver(trajectory.phases[-1].scene)
    worst, when = max(
        _bound(trajectory, phase, default_solver(phase.scene) if by_default else run.solver)
        for phase in trajectory.phases
    )
    if worst <= run.solver.accuracy:
        return []
    return [
        f"the accelerations may be off by {worst:.2g}, relative, at t = {when:.4g} s: give "
        f"{run.solver.title} more iterations or a smaller mu, or take Proximal() or Reference()"
    ]


def _bound(trajectory: Trajectory, phase: Phase, solver: Solver) -> tuple[float, float]:
    """Return the largest error bound at some samples of a phase, and its time [s]."""
    run, effects = trajectory.run, trajectory.run.effects
    workspace = Workspace(phase.scene, solver, drift=run.drift.rows)
    passive = Passive.of(phase.scene.robot, springs=effects.springs, damping=effects.damping)
    start, stop = phase.samples.start, phase.samples.stop
    bounds = []
    for i in np.unique(np.linspace(start, stop - 1, _LOOKS).astype(int)):
        q, v = trajectory.q[i], trajectory.v[i]
        tau = trajectory.tau[i] + passive.torque(q, v)
        solution = workspace.solve(q, v, tau, throw=False)
        bounds.append((solution.error_bound, float(trajectory.t[i])))
    return max(bounds)
