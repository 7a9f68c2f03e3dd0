"""The verb simulate_batch: many motions of one scene."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from concurrent.futures import Executor
from dataclasses import dataclass
from math import nan
from time import perf_counter
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from condyn_pin import tolerances
from condyn_pin.arguments import normalised
from condyn_pin.arrays import Array, read_only
from condyn_pin.batch.chunks import Progress, silent
from condyn_pin.batch.memory import Arrays, Kind
from condyn_pin.batch.rows import MISSING, Rows
from condyn_pin.batch.states import check_states
from condyn_pin.batch.trajectory import RUN_STATUSES, BatchTrajectory, Samples
from condyn_pin.batch.verbs import check_chunk
from condyn_pin.drift.base import Drift
from condyn_pin.errors import NotAssembled, SolveFailed, StepFailed, WorkersLost
from condyn_pin.scene import Scene
from condyn_pin.simulation.integrators import Integrator
from condyn_pin.simulation.leg import Leg
from condyn_pin.simulation.outcome import RunStatus
from condyn_pin.simulation.plan import Plan, plan
from condyn_pin.simulation.run import follow, start
from condyn_pin.simulation.torques import Torque
from condyn_pin.simulation.trajectory import Trajectory
from condyn_pin.solvers.base import Solver
from condyn_pin.workspace import Workspace

# Samples that are looked at where none is to be kept, at most, and how many steps are between two
# of them, at least: gaps and energies change slowly, and a look costs half a step.
_LOOKS: Final = 50
_APART: Final = 10

# A chunk that takes about a tenth of a second, for steps of some microseconds a solve.
_SOLVES: Final = 10_000

_CODES: Final = {status: code for code, status in enumerate(RUN_STATUSES)}
_SAMPLED: Final = ("t", "q", "v", "a", "lam", "tau")

# The runner of this thread's last chunk: a worker does chunk after chunk of one batch.
_last = threading.local()


def simulate_batch(
    scene: Scene,
    Q0: ArrayLike,
    V0: ArrayLike,
    TAU: float | ArrayLike | Torque = 0.0,
    *,
    duration: float,
    dt: float = 1e-3,
    integrator: Integrator | None = None,
    drift: Drift | None = None,
    solver: Solver | None = None,
    record: int | None = None,
    executor: Executor | None = None,
    chunk: int | None = None,
    progress: Progress = silent,
) -> BatchTrajectory:
    """Return the motions of a scene from many states.

    M(q) a + h(q, v) = tau - k (q - q0) - d v + J(q)^T lam,    J a + gamma = a_ref,    row by row

    Parameters
    ----------
    scene : Scene
        Contacts without an anchor are anchored where they are at the start of each motion.
    Q0, V0 : (N, nq), (N, nv) array_like
        States that satisfy the constraints, up to 1e-4 m and rad.
    TAU : 0, (nv,) or (N, nv) array_like, or callable, optional
        The torques applied [N, N m]: the same for all, constant for each, or tau(t, q, v), a
        function of a module if there is an executor.
    duration, dt, integrator, drift, solver
        As in `simulate`.
    record : int, optional
        Every which sample is kept. By default none is: every tenth is looked at, or
        fifty of each motion.
    executor, chunk, progress
        As in `solve_batch`; a chunk takes about a tenth of a second by default.

    Returns
    -------
    BatchTrajectory
        To the bit what `simulate` returns, whoever did the work. Motions that break down, or
        cannot begin, raise nothing: ``failed`` has their indices, ``counts`` their number.

    Raises
    ------
    InvalidArgument
        If an argument cannot be used; the text names the row.
    WorkersLost
        As in `solve_batch`; its ``done`` is the BatchTrajectory of what was simulated.
    UnsupportedConstraint, StaleModel
        As in `solve_batch`.

    Notes
    -----
    Cost: that of the steps, divided by the workers, and half a millisecond a motion; two where
    contacts are anchored anew.
    """
    begun = perf_counter()
    function = TAU if callable(TAU) else None
    every = 1 if record is None else record
    planned = plan(
        scene, 0.0 if function is None else function, duration=duration, dt=dt,
        integrator=integrator, drift=drift, solver=solver, record=every,
    )  # fmt: skip
    every = max(planned.steps // _LOOKS, _APART) if record is None else record
    nv = scene.robot.nv
    zero = function is not None or (isinstance(TAU, int | float) and TAU == 0)
    given: ArrayLike = np.zeros(nv) if zero else TAU  # type: ignore[assignment]
    q, v, tau = check_states(scene.robot.model, Q0, V0, given, suffix="0")
    method = planned.method
    kernel = _Motions(function, duration, dt, method.integrator, method.drift, solver, every)
    most = max(1, int(_SOLVES / planned.steps / max(method.integrator.solves_per_step, 1)))
    rows = Rows(kernel, scene, solver, None, executor, check_chunk(chunk), most, progress)
    kept = len(range(0, planned.steps, every)) + 1 if record is not None else 0
    kinds = _of_ends(scene) | (_of_samples(scene, kept) if kept else {})
    try:
        outputs = rows.fill(len(q), {"q0": q, "v0": v, "tau0": tau}, kinds)
    except WorkersLost as lost:
        lost.done = _batch(planned, lost.done, begun)
        raise
    return _batch(planned, outputs, begun)


@dataclass(frozen=True)
class _Motions:
    """The kernel: some rows of states in, their motions out."""

    function: Torque | None
    duration: float  # [s]
    dt: float  # [s]
    integrator: Integrator
    drift: Drift
    solver: Solver | None
    every: int

    def __call__(self, workspace: Workspace, inputs: Arrays, outputs: Arrays) -> None:
        """Simulate the rows."""
        runner: _Runner | None = getattr(_last, "runner", None)
        if runner is None or runner.workspace is not workspace or runner.motions != self:
            _last.runner = runner = _Runner(self, workspace)
        tau = inputs["tau0"]
        for i, (q, v) in enumerate(zip(inputs["q0"], inputs["v0"], strict=True)):
            begun = perf_counter()
            trajectory = runner.run(q, v, tau if tau.ndim == 1 else tau[i])
            if trajectory is None:
                _put_nothing(outputs, i, q, v)
            else:
                _put(outputs, i, trajectory)
            outputs["run_times"][i] = perf_counter() - begun


class _Runner:
    """One motion after the other from what they share: a plan, and a leg.

    Parameters
    ----------
    motions : _Motions
    workspace : Workspace
    """

    def __init__(self, motions: _Motions, workspace: Workspace) -> None:
        self.motions, self.workspace = motions, workspace
        self._plan = plan(
            workspace.scene, motions.function or 0.0, duration=motions.duration, dt=motions.dt,
            integrator=motions.integrator, drift=motions.drift, solver=motions.solver,
            record=motions.every,
        )  # fmt: skip
        self._leg: Leg | None = None

    def run(self, q: Array, v: Array, tau: Array) -> Trajectory | None:
        """Return the motion from a state under torques of its own; None if it cannot begin."""
        if not self.motions.function:
            self._plan.method.tau.hold(tau)
        try:
            state = _start(self.workspace, q, v)
            trajectory, self._leg = follow(self._plan, *state, leg=self._leg)
        except (NotAssembled, SolveFailed, StepFailed):
            self._leg = None
            return None
        return trajectory


def _start(workspace: Workspace, q: Array, v: Array) -> tuple[Array, Array]:
    """Return a first state; what is clearly closed is not looked at twice."""
    q_, v_ = normalised(workspace.model, "q", q), v.copy()
    if max(workspace.equations.open_by(q_, v_)) < tolerances.NEARLY_CLOSED / 10:
        return q_, v_
    return start(workspace.scene, q, v)


def _of_ends(scene: Scene) -> dict[str, Kind]:
    robot, number = scene.robot, Kind(())
    return {
        "q": Kind((robot.nq,)),
        "v": Kind((robot.nv,)),
        **dict.fromkeys(("t", "violation", "slip", "energy_error", "run_times"), number),
        "statuses": Kind((), "i1"),
    }


def _of_samples(scene: Scene, kept: int) -> dict[str, Kind]:
    n, m = scene.robot.nv, scene.rows
    widths = {"q": (scene.robot.nq,), "v": (n,), "a": (n,), "lam": (m,), "tau": (n,), "t": ()}
    return {f"samples_{name}": Kind((kept, *widths[name])) for name in _SAMPLED}


def _put(outputs: Arrays, i: int, found: Trajectory) -> None:
    ends = {
        "t": found.t[-1],
        "q": found.q[-1],
        "v": found.v[-1],
        "violation": found.violation.max(),
        "slip": found.slip.max(),
        "energy_error": np.abs(found.energy.error).max(),
        "statuses": _CODES[found.status],
    }
    for name, value in ends.items():
        outputs[name][i] = value
    for name, samples in _samples_of(outputs):
        samples[i, : len(found)] = getattr(found, name)
        samples[i, len(found) :] = nan


def _put_nothing(outputs: Arrays, i: int, q: Array, v: Array) -> None:
    """Put the status of a motion that could not begin."""
    outputs["q"][i], outputs["v"][i], outputs["t"][i] = q, v, 0.0
    for name in ("violation", "slip", "energy_error"):
        outputs[name][i] = nan
    outputs["statuses"][i] = _CODES[RunStatus.FAILED]
    for _, samples in _samples_of(outputs):
        samples[i] = nan


def _samples_of(outputs: Arrays) -> Iterator[tuple[str, Array]]:
    return ((n, outputs[f"samples_{n}"]) for n in _SAMPLED if f"samples_{n}" in outputs)


def _batch(planned: Plan, outputs: Arrays, begun: float) -> BatchTrajectory:
    """Return the outputs as a value; what is missing is NaN."""
    missing = outputs["statuses"] == MISSING
    for array in outputs.values():
        if array.dtype.kind == "f" and missing.any():
            array[missing] = nan
        read_only(array)
    method, samples = planned.method, dict(_samples_of(outputs))
    return BatchTrajectory(
        planned.scene, method.integrator, method.drift, method.dt, planned.steps,
        **{name: outputs[name] for name in _of_ends(planned.scene)},
        samples=Samples(**samples) if samples else None, seconds=perf_counter() - begun,
    )  # fmt: skip
