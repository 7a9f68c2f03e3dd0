"""The main job, timed: ABA, LCABA, proximal and dense KKT on the same states of the same scenes.

Error and time come from the same run. The error of a is taken against `Reference` at closed
states, relative to the larger of |a| and gravity, the worst over the states.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from condyn_pin import _pin
from condyn_pin._pin import pin
from condyn_pin.arrays import Array
from condyn_pin.bench_table import BenchRow, BenchTable
from condyn_pin.catalogue import motor_torque, standard_scenes
from condyn_pin.choice import untaken
from condyn_pin.errors import Interrupted
from condyn_pin.knobs import check_called
from condyn_pin.load import load_robot
from condyn_pin.machine import machine
from condyn_pin.scene import Scene
from condyn_pin.solvers.base import Solver
from condyn_pin.solvers.dense_kkt import DenseKKT
from condyn_pin.solvers.lcaba import LCABA
from condyn_pin.solvers.proximal import Proximal
from condyn_pin.solvers.reference import Reference
from condyn_pin.timed_calls import bare, unthrown
from condyn_pin.timing import Call, State, Times, interleaved
from condyn_pin.workspace import Workspace

ROBOTS = ("talos", "cassie", "solo12", "four_bar")

Progress = Callable[[str, int, int], None]


def silent(what: str, done: int, total: int) -> None:
    """Progress that nobody sees."""


@dataclass(frozen=True)
class Effort:
    """How long to look.

    Parameters
    ----------
    states : int
        Closed states for each scene.
    rounds, repeats : int
        As in `interleaved`.
    """

    states: int = 20
    rounds: int = 400
    repeats: int = 30


FULL = Effort()
QUICK = Effort(states=3, rounds=30, repeats=5)


def bench(
    robots: Sequence[str] = ROBOTS,
    *,
    solvers: Sequence[Solver] = (),
    effort: Effort = FULL,
    progress: Progress = silent,
) -> BenchTable:
    """Time some methods on the standard scenes of some robots.

    Parameters
    ----------
    robots : sequence of str
        Names that `load_robot` takes.
    solvers : sequence of Solver
        By default LCABA, proximal and dense KKT. On each scene those are timed that take it.
    effort : Effort
    progress : callable
        Called with (scene, round, rounds).

    Returns
    -------
    BenchTable

    Raises
    ------
    Interrupted
        With the scenes that were measured before Ctrl-C.
    """
    check_called("progress", progress, "scene, round, rounds")
    rows: list[BenchRow] = []
    try:
        for name in robots:
            for label, scene in standard_scenes(load_robot(name)).items():
                rows += bench_scene(label, scene, solvers=solvers, effort=effort, progress=progress)
    except KeyboardInterrupt as stop:
        raise Interrupted(BenchTable(tuple(rows), machine())) from stop
    return BenchTable(tuple(rows), machine())


def bench_scene(
    label: str,
    scene: Scene,
    *,
    solvers: Sequence[Solver] = (),
    effort: Effort,
    progress: Progress = silent,
) -> list[BenchRow]:
    """Time some methods on one scene."""
    rng = np.random.default_rng(0)
    states: list[State] = [
        (*scene.sample(rng), motor_torque(scene.robot, rng)) for _ in range(effort.states)
    ]
    reference = Workspace(scene, Reference())
    truth = [reference.solve(*state, throw=False).a for state in states]
    chosen = [s for s in solvers or _solvers(scene) if not untaken(scene, s)]
    candidates = [_Candidate(scene, solver, states, truth) for solver in chosen]
    model, data = pin.Model(scene.robot.model), scene.robot.model.createData()
    calls: dict[str, Call] = {"ABA": lambda q, v, tau: pin.aba(model, data, q, v, tau)}
    for candidate in candidates:
        calls |= candidate.calls()
    done = iter(range(1, effort.rounds + 1))
    times = interleaved(
        calls,
        states,
        rounds=effort.rounds,
        repeats=effort.repeats,
        tick=lambda: progress(label, next(done), effort.rounds),
    )
    dense = next((c.times(times) for c in reversed(candidates) if c.is_dense and c.timed), None)
    free = BenchRow(
        scene=label,
        method="ABA, unconstrained",
        rows=0,
        rank=0,
        bare_us=times["ABA"].median,
        bare_p95_us=times["ABA"].p95,
    )
    return [free, *(candidate.row(label, times, dense) for candidate in candidates)]


def _solvers(scene: Scene) -> list[Solver]:
    solvers: list[Solver] = [LCABA()] if _pin.HAS_LCABA else []
    solvers += [Proximal(), DenseKKT()]
    if scene.audit.redundant:  # where the exact matrix is singular, a damped one is the yardstick
        solvers.append(DenseKKT(mu=float(f"{1e-11 * scene.audit.delassus_norm:.1e}")))
    return solvers


class _Candidate:
    """One solver on one scene: its answers at the states, and what there is to time."""

    def __init__(
        self, scene: Scene, solver: Solver, states: Sequence[State], truth: Sequence[Array]
    ) -> None:
        self.scene, self.solver = scene, solver
        self.workspace = Workspace(scene, solver)
        self.solutions = [self.workspace.solve(*state, throw=False) for state in states]
        self.error = max(
            float(
                np.abs(solution.a - a).max() / max(np.abs(a).max(), scene.audit.yardstick.gravity)
            )
            for solution, a in zip(self.solutions, truth, strict=True)
        )
        self.timed = all(np.isfinite(solution.a).all() for solution in self.solutions)
        self.all_ok = all(solution.status.ok for solution in self.solutions)
        self.is_dense = isinstance(solver, DenseKKT)
        self.method = solver.title
        if isinstance(solver, DenseKKT) and solver.mu:
            self.method += f", mu {solver.mu:.1e}"

    def calls(self) -> dict[str, Call]:
        """Return the bare call, the hot loop and the full solve, by a name of their own."""
        if not self.timed:
            return {}
        workspace, key = self.workspace, self.method
        calls: dict[str, Call] = {
            f"{key} acceleration": workspace.acceleration,
            f"{key} solve": workspace.solve if self.all_ok else unthrown(workspace),
        }
        pinocchio = bare(workspace)
        return calls if pinocchio is None else calls | {f"{key} bare": pinocchio}

    def times(self, times: dict[str, Times]) -> Times:
        return times[f"{self.method} acceleration"]

    def row(self, label: str, times: dict[str, Times], dense: Times | None) -> BenchRow:
        """Return the row of this candidate."""
        proofs = [solution.proof for solution in self.solutions]
        statuses = Counter(solution.status.name.lower() for solution in self.solutions)
        row = BenchRow(
            scene=label,
            method=self.method,
            rows=self.scene.rows,
            rank=self.scene.audit.rank,
            error=self.error,
            dynamics_error=max(proof.dynamics for proof in proofs),
            constraint_error=max(proof.constraint for proof in proofs),
            iterations=max(solution.iterations for solution in self.solutions),
            status=", ".join(f"{n} {status}" for status, n in sorted(statuses.items())),
        )
        if not self.timed:
            return row
        hot, full = self.times(times), times[f"{self.method} solve"]
        bare = times.get(f"{self.method} bare")
        return row.timed(hot, full, bare, dense)
