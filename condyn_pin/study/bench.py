"""The main job, timed: ABA, LCABA, proximal and dense KKT on the same states of the same scenes.

Beside them stand the same equations written by hand, without a guard and without a proof: what is
said to be faster than dense is faster than the fastest of these and of dense KKT.

Error and time come from the same run. The error of a is taken against `Reference` at closed
states, relative to the larger of |a| and gravity, the worst over the states.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf, isfinite, nan

import numpy as np

from condyn_pin._core._pin import pin
from condyn_pin._core.arguments import check_called
from condyn_pin._core.timing import Call, Times, interleaved, machine
from condyn_pin._core.tolerances import SOLVED
from condyn_pin.dynamics.scene import Scene, standard_scenes
from condyn_pin.dynamics.solvers.base import Solver
from condyn_pin.dynamics.solvers.constrained_aba import ConstrainedABA
from condyn_pin.dynamics.solvers.dense_kkt import DenseKKT
from condyn_pin.dynamics.solvers.lcaba import LCABA
from condyn_pin.dynamics.solvers.proximal import Proximal
from condyn_pin.dynamics.solvers.pv import PV
from condyn_pin.dynamics.workspace import Workspace, untaken
from condyn_pin.errors import Interrupted
from condyn_pin.io.load import load_robot
from condyn_pin.study.bench_compiled import CPP, compiled_by, compiled_methods, fastest_dense
from condyn_pin.study.bench_table import BenchRow, BenchTable
from condyn_pin.study.by_hand import by_hand
from condyn_pin.study.case import Case, measure_errors, prepare
from condyn_pin.study.measures.acceleration import AccelerationMeasure
from condyn_pin.study.measures.base import relative
from condyn_pin.study.states import SampledStates

BY_HAND = "by hand"  # in place of a status

ROBOTS = ("talos", "cassie", "solo12", "four_bar")

Progress = Callable[[str, int, int], None]

# What a sample need not last longer than beside batches, which answer all states in a call [s].
_ENOUGH = 1e-3


def silent(what: str, done: int, total: int) -> None:
    """Progress that nobody sees."""


@dataclass(frozen=True)
class Effort:
    """How long to look: closed states of each scene, and `rounds`, `repeats` of `interleaved`."""

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
    native: bool = False,
    progress: Progress = silent,
) -> BenchTable:
    """Time some methods on the standard scenes of some robots.

    On each scene those solvers are timed that take it, by default LCABA, proximal and dense KKT,
    and the equations written by hand (`condyn_pin.study.by_hand`). With `native` these come beside
    `ConstrainedABA`, `PV` and what is compiled, timed in C++ in the same rounds; MissingExtra where
    it is not installed. Progress is called with (scene,
    round, rounds). Ctrl-C raises `Interrupted` with the scenes that were measured before.
    """
    check_called("progress", progress, "scene, round, rounds")
    rows: list[BenchRow] = []
    where = machine() | (compiled_by() if native else {})
    try:
        for name in robots:
            for label, scene in standard_scenes(load_robot(name)).items():
                rows += bench_scene(
                    label, scene, solvers=solvers, effort=effort, native=native, progress=progress
                )
    except KeyboardInterrupt as stop:
        raise Interrupted(BenchTable(tuple(rows), where)) from stop
    return BenchTable(tuple(rows), where)


@dataclass(frozen=True)
class _Candidate:
    """A row that has no times yet, and what there is to time by name: "once", "solve", "bare"."""

    row: BenchRow
    calls: Mapping[str, Call]
    is_dense: bool


def bench_scene(
    label: str,
    scene: Scene,
    *,
    solvers: Sequence[Solver] = (),
    effort: Effort,
    native: bool = False,
    progress: Progress = silent,
) -> list[BenchRow]:
    """Time some methods on one scene."""
    case = prepare(label, scene, AccelerationMeasure(), SampledStates(effort.states), SOLVED)
    asked = solvers or [*_solvers(scene), *([ConstrainedABA(), PV()] if native else [])]
    chosen = [s for s in asked if not untaken(scene, s)]
    damping = _damping(scene)
    compiled = compiled_methods(case, damping) if native else []
    written = {_named(name, damping): call for name, call in by_hand(scene, damping).items()}
    candidates = [
        _unconstrained(case),
        *(_solver(case, solver) for solver in chosen),
        *(_equations(case, method, call) for method, call in written.items()),
    ]
    calls: dict[tuple[int, str], Call] = {
        (i, what): call for i, c in enumerate(candidates) for what, call in c.calls.items()
    } | {(i, CPP): method.call for i, method in enumerate(compiled)}
    done = iter(range(1, effort.rounds + 1))
    times = interleaved(
        calls,
        case.states,
        rounds=effort.rounds,
        repeats=effort.repeats,
        enough=_ENOUGH if native else inf,
        tick=lambda: progress(label, next(done), effort.rounds),
    )
    plain = [times[i, "once"] for i, c in enumerate(candidates) if c.is_dense and c.calls]
    dense = min(plain, key=lambda spent: spent.median, default=None)
    in_cpp = {i: times[i, CPP] for i, _ in enumerate(compiled)}
    dense_in_cpp = fastest_dense(compiled, in_cpp)
    return [
        _timed(c.row, {what: times[i, what] for what in c.calls}, dense)
        for i, c in enumerate(candidates)
    ] + [method.timed(in_cpp[i], dense_in_cpp) for i, method in enumerate(compiled)]


def _unconstrained(case: Case) -> _Candidate:
    """Return Pinocchio's ABA, without any constraint."""
    model, data = pin.Model(case.scene.robot.model), case.scene.robot.model.createData()
    row = BenchRow(scene=case.label, method="ABA, unconstrained", rows=0, rank=0)
    return _Candidate(row, {"bare": lambda q, v, tau: pin.aba(model, data, q, v, tau)}, False)


def _solver(case: Case, solver: Solver) -> _Candidate:
    """Return a solver with its answers at the states."""
    found = measure_errors(case, solver)
    is_dense = isinstance(solver, DenseKKT)
    row = BenchRow(
        scene=case.label,
        method=_named(solver.title, solver.mu if isinstance(solver, DenseKKT) else 0.0),
        rows=case.scene.rows,
        rank=case.scene.nominal.rank,
        error=found.error_worst,
        dynamics_error=found.dynamics_error,
        constraint_error=found.constraint_error,
        iterations=found.iterations,
        status=found.said,
    )
    has_answers = isfinite(found.error_worst)
    calls = case.measure.calls(Workspace(case.scene, solver)) if has_answers else {}
    return _Candidate(row, calls, is_dense)


def _equations(case: Case, method: str, call: Call) -> _Candidate:
    """Return equations by hand: they have a time and an error, and say nothing of either."""
    gravity = case.scene.nominal.estimator.gravity
    try:
        pairs = zip(case.states, case.truth, strict=True)
        error = max(relative(np.asarray(call(*s)), truth, gravity) for s, truth in pairs)
    except np.linalg.LinAlgError:  # singular
        error = inf
    rows, rank = case.scene.rows, case.scene.nominal.rank
    row = BenchRow(case.label, method, rows, rank, error=error, status=BY_HAND)
    return _Candidate(row, {"once": call} if isfinite(error) else {}, True)


def _timed(row: BenchRow, times: Mapping[str, Times], dense: Times | None) -> BenchRow:
    """Return a row with its times."""
    hot, full, bare = (times.get(what) for what in ("once", "solve", "bare"))
    if hot:
        to_dense = dense.ratio(hot) if dense else nan
        p95 = hot.p95
        row = replace(row, acceleration_us=hot.median, acceleration_p95_us=p95, to_dense=to_dense)
    if full:
        row = replace(row, solve_us=full.median)
    if bare:
        row = replace(row, bare_us=bare.median, bare_p95_us=bare.p95)
    if hot and full and bare:
        row = replace(row, to_bare=hot.ratio(bare), solve_to_bare=full.ratio(bare))
    return row


def _solvers(scene: Scene) -> list[Solver]:
    kinds: tuple[type[Solver], ...] = (LCABA, Proximal, DenseKKT)
    solvers = [kind() for kind in kinds if not kind.missing()]
    if damping := _damping(scene):
        solvers.append(DenseKKT(mu=damping))
    return solvers


def _damping(scene: Scene) -> float:
    """Return what a dense matrix needs where redundant rows make the exact one singular [1/kg]."""
    return float(f"{1e-11 * scene.nominal.delassus_norm:.1e}") if scene.nominal.dependent else 0.0


def _named(method: str, mu: float) -> str:
    return f"{method}, mu {mu:.1e}" if mu else method
