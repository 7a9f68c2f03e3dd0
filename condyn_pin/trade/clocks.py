"""Times of the rows of a case, all solvers interleaved, in the process that owns the core."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from math import isfinite
from time import perf_counter, process_time

import numpy as np

from condyn_pin.knobs import check_count
from condyn_pin.solvers.base import Solver
from condyn_pin.timing import Call, Times, interleaved
from condyn_pin.trade.case import Case
from condyn_pin.trade.row import ALONE, Row
from condyn_pin.workspace import Workspace

# Of the time that passed, what this process was given, to have owned its core.
_OWNED = 0.95

_BUILDS = 3

_Key = tuple[Solver, str]


@dataclass(frozen=True)
class TimingEffort:
    """How long to look.

    Parameters
    ----------
    rounds, repeats : int
        As in `condyn_pin.timing.interleaved`.
    overhead : bool
        Time the bare call and the solve with its proof too.
    """

    rounds: int = 50
    repeats: int = 5
    overhead: bool = True

    def __post_init__(self) -> None:
        check_count("rounds", self.rounds)
        check_count("repeats", self.repeats)


def measure_times(
    case: Case,
    rows: Mapping[Solver, Row],
    effort: TimingEffort,
    tick: Callable[[], None] = lambda: None,
) -> dict[Solver, Row]:
    """Return the rows of a case with their times.

    Every solver that has a finite answer at every state is timed, in one interleaved run; solve and
    bare call only where every status is ok, since doubtful answers are looked at twice.

    Parameters
    ----------
    case : Case
    rows : mapping of Solver to Row
        What `measure_errors` returned.
    effort : TimingEffort
    tick : callable
        Called after each round.
    """
    timed = {solver: row for solver, row in rows.items() if isfinite(row.error_worst)}
    began, worked = perf_counter(), process_time()
    builds, workspaces = _built(case, timed)
    calls: dict[_Key, Call] = {}
    for solver, row in timed.items():
        for what, call in case.measure.calls(workspaces[solver]).items():
            if what == "once" or (row.ok and effort.overhead):
                calls[solver, what] = call
    times = interleaved(calls, case.states, rounds=effort.rounds, repeats=effort.repeats, tick=tick)
    said = _said(perf_counter() - began, process_time() - worked)
    found = {solver: replace(row, timed=_why_not(row)) for solver, row in rows.items()}
    for solver, row in timed.items():
        once = times[solver, "once"]
        found[solver] = replace(
            row,
            build_us=builds[solver],
            median_us=once.median,
            p95_us=once.p95,
            bare_us=_median(times.get((solver, "bare"))),
            solve_us=_median(times.get((solver, "solve"))),
            timed=said,
        )
    return found


def _built(
    case: Case, rows: Mapping[Solver, Row]
) -> tuple[dict[Solver, float], dict[Solver, Workspace]]:
    """Return the median time to build a workspace [us], and a workspace, by solver."""
    samples: dict[Solver, list[float]] = {solver: [] for solver in rows}
    workspaces: dict[Solver, Workspace] = {}
    for _ in range(_BUILDS):
        for solver in rows:
            start = perf_counter()
            workspaces[solver] = Workspace(case.scene, solver)
            samples[solver].append(1e6 * (perf_counter() - start))
    return {solver: float(np.median(each)) for solver, each in samples.items()}, workspaces


def _median(times: Times | None) -> float | None:
    return None if times is None else times.median


def _said(passed: float, worked: float) -> str:
    """Return how the times were taken, by the share of the core that this process had."""
    share = worked / passed if passed else 1.0
    if share >= _OWNED:
        return ALONE
    return f"timed on a shared core: had it {share:.0%} of the time"


def _why_not(row: Row) -> str:
    failures = ", ".join(f"{count} {status}" for status, count in row.statuses.items())
    return f"not timed: no finite answer at every state ({failures})"
