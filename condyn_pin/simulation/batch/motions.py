"""Motions: what a worker does with its rows of a `simulate_batch`."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import nan
from time import perf_counter
from typing import Final

import numpy as np

from condyn_pin._core import tolerances
from condyn_pin._core.arguments import normalised
from condyn_pin._core.arrays import Array
from condyn_pin._core.threads import Kept
from condyn_pin._core.work import Arrays, Messages
from condyn_pin.constraints.contacts.base import Contact
from condyn_pin.constraints.drift import Drift
from condyn_pin.constraints.forces import AppliedForce
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.solvers import Solver
from condyn_pin.dynamics.workspace import Workspace
from condyn_pin.errors import NotAssembled, SolveFailed, StepFailed
from condyn_pin.simulation.batch.inputs import RowForces
from condyn_pin.simulation.batch.samples import samples_in
from condyn_pin.simulation.batch.trajectory import RUN_STATUSES
from condyn_pin.simulation.fit import check_penetration
from condyn_pin.simulation.hybrid_phase import HybridPhase
from condyn_pin.simulation.integrators import Integrator
from condyn_pin.simulation.motion_limits import MotionLimits
from condyn_pin.simulation.outcome import RunStatus, uninterrupted
from condyn_pin.simulation.plan import Plan, plan
from condyn_pin.simulation.run import follow, start
from condyn_pin.simulation.torques import Torque, TorqueJacobian
from condyn_pin.simulation.trajectory import Trajectory

_CODES: Final = {status: code for code, status in enumerate(RUN_STATUSES)}

# What `simulate` raises of a state that no motion begins at.
_CANNOT_BEGIN: Final = (NotAssembled, SolveFailed, StepFailed)


@dataclass(frozen=True)
class Motions:
    """The kernel: some rows of states in, their motions out."""

    function: Torque | None = field(compare=False)  # its == may be that of arrays
    jacobian: TorqueJacobian | None = field(compare=False)
    duration: float  # [s]
    dt: float  # [s]
    integrator: Integrator | None
    drift: Drift | None
    solver: Solver | None
    every: int = 1
    limits: MotionLimits = field(default_factory=MotionLimits)
    forces: RowForces = field(default_factory=RowForces)
    contacts: tuple[Contact, ...] = ()  # of the scene: workspaces hold none

    def plan(self, scene: Scene) -> Plan:
        """Return the plan of the first of them."""
        planned = plan(
            scene, self.function or 0.0, duration=self.duration, dt=self.dt,
            integrator=self.integrator, drift=self.drift, solver=self.solver,
            record=self.every, forces=self.forces.forces, jacobian=self.jacobian,
            limits=self.limits,
        )  # fmt: skip
        return replace(planned, at_events=False)  # as many samples of each motion

    def __call__(self, workspace: Workspace, inputs: Arrays, outputs: Arrays) -> Messages:
        """Simulate the rows; return why those ended early that did."""
        # functions are not compared: their == may be that of arrays
        asked = self, id(self.function), id(self.jacobian)
        runner = _runners.of(workspace, asked, lambda: _Runner(self, workspace))
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


class _Runner:
    """One motion after the other from what they share: a plan, and a phase."""

    def __init__(self, motions: Motions, workspace: Workspace) -> None:
        self.motions, self.workspace = motions, workspace
        self._scene = workspace.scene
        if motions.contacts:
            self._scene = replace(workspace.scene, contacts=motions.contacts)
        self._plan = motions.plan(self._scene)
        self._phase: HybridPhase | None = None

    def run(self, q: Array, v: Array, tau: Array, forces: tuple[AppliedForce, ...]) -> Trajectory:
        """Return the motion from a state; KeyboardInterrupt if it was interrupted, for all."""
        self._plan.tau.hold(None if self.motions.function else tau, forces)
        phase, self._phase = self._phase, None  # one that cannot begin leaves none
        state = _start(self.workspace, q, v, self._plan)
        check_penetration(self._scene, state[0], self._plan.integrator)
        trajectory, phase = follow(self._plan, *state, phase=phase)
        uninterrupted(trajectory)
        self._phase = phase
        return trajectory


_runners = Kept[_Runner]()


def _start(workspace: Workspace, q: Array, v: Array, plan: Plan) -> tuple[Array, Array]:
    """Return a first state; what is clearly closed is not checked twice."""
    q_, v_ = normalised(workspace.model, "q", q), v.copy()
    with np.errstate(all="ignore"):  # what overflows is clearly not closed
        gap = max(workspace.equations.open_by(q_, v_))
    if gap < tolerances.NEARLY_CLOSED / 10:
        return q_, v_
    return start(workspace.scene, q, v, plan)


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
    if samples := samples_in(outputs):
        for name, kept in samples.arrays.items():
            its = getattr(found, name)
            kept[i, : len(found)] = its.columns if name == "contact" else its
            kept[i, len(found) :] = nan


def _put_nothing(outputs: Arrays, i: int, q: Array, v: Array) -> None:
    """Put the status of a motion that could not begin."""
    for name, array in outputs.items():
        if name != "statuses":
            array[i] = nan
    outputs["q"][i], outputs["v"][i], outputs["t"][i] = q, v, 0.0
    outputs["statuses"][i] = _CODES[RunStatus.FAILED]
