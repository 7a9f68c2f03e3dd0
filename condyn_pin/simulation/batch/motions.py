"""Motions: what a worker does with its rows of a `simulate_batch`."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from dataclasses import dataclass, field
from math import nan
from time import perf_counter
from typing import Final

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core.arguments import normalised
from condyn_pin._core.arrays import Array
from condyn_pin._core.parallel.memory import Arrays, Kind
from condyn_pin._core.parallel.transports import Messages
from condyn_pin.constraints.applied_force import AppliedForce
from condyn_pin.constraints.drift import Drift
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.solvers import Solver
from condyn_pin.dynamics.workspace import Workspace
from condyn_pin.errors import NotAssembled, SolveFailed, StepFailed
from condyn_pin.simulation.batch.forces import RowForces
from condyn_pin.simulation.batch.trajectory import RUN_STATUSES
from condyn_pin.simulation.hybrid_phase import HybridPhase
from condyn_pin.simulation.integrators import Integrator
from condyn_pin.simulation.outcome import RunStatus
from condyn_pin.simulation.plan import plan
from condyn_pin.simulation.run import follow, start
from condyn_pin.simulation.slopes import TorqueJacobian
from condyn_pin.simulation.torques import Torque
from condyn_pin.simulation.trajectory import Trajectory
from condyn_pin.simulation.uninterrupted import uninterrupted

_CODES: Final = {status: code for code, status in enumerate(RUN_STATUSES)}
ENDS: Final = (
    "t",
    "q",
    "v",
    "violation",
    "constraint_velocity",
    "energy_error",
    "run_times",
    "statuses",
)
SAMPLED: Final = ("t", "q", "v", "a", "lam", "tau")

# What `simulate` raises of a state that no motion begins at.
_CANNOT_BEGIN: Final = (NotAssembled, SolveFailed, StepFailed)

# The runner of this thread's last chunk: a worker does chunk after chunk of one batch.
_last = threading.local()


@dataclass(frozen=True)
class Motions:
    """The kernel: some rows of states in, their motions out."""

    function: Torque | None = field(compare=False)  # its == may be that of arrays
    jacobian: TorqueJacobian | None = field(compare=False)
    duration: float  # [s]
    dt: float  # [s]
    integrator: Integrator
    drift: Drift
    solver: Solver | None
    every: int
    forces: RowForces

    def __call__(self, workspace: Workspace, inputs: Arrays, outputs: Arrays) -> Messages:
        """Simulate the rows; return why those ended early that did."""
        runner: Runner | None = getattr(_last, "runner", None)
        if runner is None or not runner.fits(self, workspace):
            _last.runner = runner = Runner(self, workspace)
        tau, words = inputs["tau0"], {}
        for i, (q, v) in enumerate(zip(inputs["q0"], inputs["v0"], strict=True)):
            begun = perf_counter()
            try:
                torques = tau if tau.ndim == 1 else tau[i]
                trajectory = runner.run(q, v, torques, self.forces.at(inputs, i))
            except _CANNOT_BEGIN as error:
                words[i] = str(error)
                _put_nothing(outputs, i, q, v)
            else:
                words |= {i: trajectory.reason} if trajectory.reason else {}
                _put(outputs, i, trajectory)
            outputs["run_times"][i] = perf_counter() - begun
        return words


class Runner:
    """One motion after the other from what they share: a plan, and a phase.

    Parameters
    ----------
    motions : Motions
    workspace : Workspace
    """

    def __init__(self, motions: Motions, workspace: Workspace) -> None:
        self.motions, self.workspace = motions, workspace
        self._plan = plan(
            workspace.scene, motions.function or 0.0, duration=motions.duration, dt=motions.dt,
            integrator=motions.integrator, drift=motions.drift, solver=motions.solver,
            record=motions.every, forces=motions.forces.forces, jacobian=motions.jacobian,
        )  # fmt: skip
        self._phase: HybridPhase | None = None

    def fits(self, motions: Motions, workspace: Workspace) -> bool:
        """Return whether these motions can be run here too."""
        mine = self.motions
        same = mine == motions and mine.function is motions.function
        same = same and mine.jacobian is motions.jacobian
        return same and self.workspace is workspace

    def run(
        self, q: Array, v: Array, tau: Array, forces: tuple[AppliedForce, ...] = ()
    ) -> Trajectory:
        """Return the motion from a state under torques and forces of its own.

        Raises
        ------
        NotAssembled, SolveFailed, StepFailed
            If it cannot begin.
        KeyboardInterrupt
            If it was interrupted, which is meant for all.
        """
        constant = None if self.motions.function else tau
        if self._plan.pushed:
            self._plan.pushed.hold(constant, forces)
        elif constant is not None:
            self._plan.tau.hold(constant)
        phase, self._phase = self._phase, None  # one that cannot begin leaves none
        state = _start(self.workspace, q, v)
        trajectory, phase = follow(self._plan, *state, phase=phase)
        uninterrupted(trajectory)
        self._phase = phase
        return trajectory


def _start(workspace: Workspace, q: Array, v: Array) -> tuple[Array, Array]:
    """Return a first state; what is clearly closed is not looked at twice."""
    q_, v_ = normalised(workspace.model, "q", q), v.copy()
    with np.errstate(all="ignore"):  # what overflows is clearly not closed
        gap = max(workspace.equations.open_by(q_, v_))
    if gap < tolerances.NEARLY_CLOSED / 10:
        return q_, v_
    return start(workspace.scene, q, v)


def of_ends(scene: Scene) -> dict[str, Kind]:
    """Return what a row of each array of a `BatchTrajectory` is."""
    robot, number = scene.robot, Kind(())
    return {
        "q": Kind((robot.nq,)),
        "v": Kind((robot.nv,)),
        **dict.fromkeys(
            ("t", "violation", "constraint_velocity", "energy_error", "run_times"), number
        ),
        "statuses": Kind((), "i1"),
    }


def of_samples(scene: Scene, kept: int) -> dict[str, Kind]:
    """Return the same of its `Samples`, if so many of each motion are kept."""
    n, m = scene.robot.nv, scene.rows
    widths = {"q": (scene.robot.nq,), "v": (n,), "a": (n,), "lam": (m,), "tau": (n,), "t": ()}
    return {f"samples_{name}": Kind((kept, *widths[name])) for name in SAMPLED}


def _put(outputs: Arrays, i: int, found: Trajectory) -> None:
    ends = {
        "t": found.t[-1],
        "q": found.q[-1],
        "v": found.v[-1],
        "violation": found.violation.max(),
        "constraint_velocity": found.constraint_velocity.max(),
        "energy_error": np.abs(found.energy.error).max(),
        "statuses": _CODES[found.status],
    }
    for name, value in ends.items():
        outputs[name][i] = value
    for name, samples in samples_of(outputs):
        samples[i, : len(found)] = getattr(found, name)
        samples[i, len(found) :] = nan


def _put_nothing(outputs: Arrays, i: int, q: Array, v: Array) -> None:
    """Put the status of a motion that could not begin."""
    outputs["q"][i], outputs["v"][i], outputs["t"][i] = q, v, 0.0
    for name in ("violation", "constraint_velocity", "energy_error"):
        outputs[name][i] = nan
    outputs["statuses"][i] = _CODES[RunStatus.FAILED]
    for _, samples in samples_of(outputs):
        samples[i] = nan


def samples_of(outputs: Arrays) -> Iterator[tuple[str, Array]]:
    """Return the arrays of the samples that are kept, by the names of `Samples`."""
    return ((n, outputs[f"samples_{n}"]) for n in SAMPLED if f"samples_{n}" in outputs)
