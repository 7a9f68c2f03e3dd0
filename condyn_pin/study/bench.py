"""The main job, timed: ABA, LCABA, proximal and dense KKT on the same states of the same scenes.

Beside them stand the same equations written by hand, without a guard and without a proof: what is
said to be faster than dense is faster than the fastest of these and of dense KKT.

Error and time come from the same run. The error of a is taken against `Reference` at closed
states, relative to the larger of |a| and gravity, the worst over the states.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from condyn_pin._core import _pin
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.machine import machine
from condyn_pin._core.parameters import check_called
from condyn_pin._core.timing import Call, State, Times, interleaved
from condyn_pin.dynamics.catalogue import standard_scenes
from condyn_pin.dynamics.choice import untaken
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.solvers.base import Solver
from condyn_pin.dynamics.solvers.dense_kkt import DenseKKT
from condyn_pin.dynamics.solvers.lcaba import LCABA
from condyn_pin.dynamics.solvers.proximal import Proximal
from condyn_pin.dynamics.solvers.reference import Reference
from condyn_pin.dynamics.workspace import Workspace
from condyn_pin.errors import Interrupted
from condyn_pin.io.load import load_robot
from condyn_pin.study.bench_table import BenchRow, BenchTable
from condyn_pin.study.by_hand import by_hand
from condyn_pin.study.measures.base import relative
from condyn_pin.study.states import SampledStates
from condyn_pin.study.timed_calls import bare, unthrown

BY_HAND = "by hand"  # in place of a status

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
        By default LCABA, proximal and dense KKT. On each scene those are timed that take it, and
        the equations written by hand (`condyn_pin.study.by_hand`).
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
    states = SampledStates(effort.states).of(scene)
    reference = Workspace(scene, Reference())
    truth = [reference.solve(*state, throw=False).a for state in states]
    chosen = [s for s in solvers or _solvers(scene) if not untaken(scene, s)]
    candidates = [_Candidate(scene, solver, states, truth) for solver in chosen]
    model, data = pin.Model(scene.robot.model), scene.robot.model.createData()
    calls: dict[str, Call] = {"ABA": lambda q, v, tau: pin.aba(model, data, q, v, tau)}
    for candidate in candidates:
        calls |= candidate.calls()
    others = [
        _ByHand(_named(name, _damping(scene)), answer, scene, states, truth)
        for name, answer in by_hand(scene, _damping(scene)).items()
    ]
    calls |= {one.method: one.answer for one in others if one.timed}
    done = iter(range(1, effort.rounds + 1))
    times = interleaved(
        calls,
        states,
        rounds=effort.rounds,
        repeats=effort.repeats,
        tick=lambda: progress(label, next(done), effort.rounds),
    )
    plain = [c.times(times) for c in candidates if c.is_dense and c.timed]
    plain += [times[one.method] for one in others if one.timed]
    dense = min(plain, key=lambda t: t.median, default=None)
    free = BenchRow(
        scene=label,
        method="ABA, unconstrained",
        rows=0,
        rank=0,
        bare_us=times["ABA"].median,
        bare_p95_us=times["ABA"].p95,
    )
    rows = [free, *(candidate.row(label, times, dense) for candidate in candidates)]
    return rows + [one.row(label, times, dense) for one in others]


def _solvers(scene: Scene) -> list[Solver]:
    solvers: list[Solver] = [LCABA()] if _pin.HAS_LCABA else []
    solvers += [Proximal(), DenseKKT()]
    if damping := _damping(scene):
        solvers.append(DenseKKT(mu=damping))
    return solvers


def _damping(scene: Scene) -> float:
    """Return what a dense matrix needs where redundant rows make the exact one singular [1/kg]."""
    return float(f"{1e-11 * scene.nominal.delassus_norm:.1e}") if scene.nominal.dependent else 0.0


def _named(method: str, mu: float) -> str:
    return f"{method}, mu {mu:.1e}" if mu else method


def _worst(scene: Scene, answers: Sequence[Array], truth: Sequence[Array]) -> float:
    gravity = scene.nominal.estimator.gravity
    return max(relative(a, true, gravity) for a, true in zip(answers, truth, strict=True))


class _ByHand:
    """A method that is none of a solver: it has a time and an error, and says nothing of either."""

    def __init__(
        self,
        method: str,
        answer: Call,
        scene: Scene,
        states: Sequence[State],
        truth: Sequence[Array],
    ) -> None:
        self.method, self.answer, self._scene = method, answer, scene
        try:
            answers = [np.asarray(answer(*state)) for state in states]
        except np.linalg.LinAlgError:  # singular
            answers = [np.full(scene.robot.nv, math.nan)] * len(states)
        self._error = _worst(scene, answers, truth)
        self.timed = math.isfinite(self._error)

    def row(self, label: str, times: dict[str, Times], dense: Times | None) -> BenchRow:
        """Return the row of this method."""
        row = BenchRow(
            scene=label,
            method=self.method,
            rows=self._scene.rows,
            rank=self._scene.nominal.rank,
            error=self._error,
            status=BY_HAND,
        )
        if not self.timed:
            return row
        hot = times[self.method]
        return replace(
            row,
            acceleration_us=hot.median,
            acceleration_p95_us=hot.p95,
            to_dense=dense.ratio(hot) if dense else math.nan,
        )


class _Candidate:
    """One solver on one scene: its answers at the states, and what there is to time."""

    def __init__(
        self, scene: Scene, solver: Solver, states: Sequence[State], truth: Sequence[Array]
    ) -> None:
        self.scene, self.solver = scene, solver
        self.workspace = Workspace(scene, solver)
        self.solutions = [self.workspace.solve(*state, throw=False) for state in states]
        self.error = _worst(scene, [solution.a for solution in self.solutions], truth)
        self.timed = all(np.isfinite(solution.a).all() for solution in self.solutions)
        self.all_ok = all(solution.status.ok for solution in self.solutions)
        self.is_dense = isinstance(solver, DenseKKT)
        self.method = _named(solver.title, solver.mu if isinstance(solver, DenseKKT) else 0.0)

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
        residuals = [solution.residuals for solution in self.solutions]
        statuses = Counter(solution.status.name.lower() for solution in self.solutions)
        row = BenchRow(
            scene=label,
            method=self.method,
            rows=self.scene.rows,
            rank=self.scene.nominal.rank,
            error=self.error,
            dynamics_error=max(each.dynamics for each in residuals),
            constraint_error=max(each.constraint for each in residuals),
            iterations=max(solution.iterations for solution in self.solutions),
            status=", ".join(f"{n} {status}" for status, n in sorted(statuses.items())),
        )
        if not self.timed:
            return row
        hot, full = self.times(times), times[f"{self.method} solve"]
        bare = times.get(f"{self.method} bare")
        return row.timed(hot, full, bare, dense)
