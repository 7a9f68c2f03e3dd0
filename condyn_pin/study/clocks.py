"""Times of the rows of a scene, all candidates interleaved, in the process that owns the core."""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from math import isfinite
from time import perf_counter, process_time
from typing import Any

import numpy as np

from condyn_pin._core.arguments import check_count
from condyn_pin._core.timing import Call, Times, interleaved
from condyn_pin.study.case import Case
from condyn_pin.study.method import Method
from condyn_pin.study.row import ALONE, Row

# Of the time that passed, what this process was given, to have owned its core.
_OWNED = 0.95

_BUILDS = 3

# A sample is long beside a clock read; the methods that take tenths of a millisecond need no mean.
_SAMPLE = 1e-4  # [s]

Candidate = tuple[Case, Method]


@dataclass(frozen=True)
class TimingEffort:
    """How long to measure.

    Parameters
    ----------
    rounds, repeats : int
        As in `condyn_pin._core.timing.interleaved`; what takes long is repeated less.
    overhead : bool
        Time the bare call and the solve with its proof too.
    alone : bool
        Where a study goes on from a file, take the times again that were taken on a shared core.

    Raises
    ------
    InvalidArgument
        If a count is not positive.
    """

    rounds: int = 50
    repeats: int = 5
    overhead: bool = True
    alone: bool = False

    def __post_init__(self) -> None:
        check_count("rounds", self.rounds)
        check_count("repeats", self.repeats)

    def suffices(self, row: Row) -> bool:
        """Whether the times of a row are good enough, or there are none to take."""
        taken = row.median_us is not None and (row.timed == ALONE or not self.alone)
        return taken or not isfinite(row.error_worst)


def measure_times(
    rows: Mapping[Candidate, Row],
    effort: TimingEffort,
    tick: Callable[[], None],
) -> dict[Candidate, Row]:
    """Return the rows of some candidates with their times.

    Everything that has a finite answer at every state is timed, in one interleaved run; solve and
    bare call only where every status is ok, since doubtful answers are looked at twice.
    The cases of `rows` have the same scene and the same states; `tick` is called after each round.
    """
    timed = {candidate: row for candidate, row in rows.items() if isfinite(row.error_worst)}
    found = {candidate: replace(row, timed=_why_not(row)) for candidate, row in rows.items()}
    if not timed:
        return found
    began, worked = perf_counter(), process_time()
    builds, workspaces = _built(timed)
    calls: dict[tuple[Candidate, str], Call] = {}
    for candidate, row in timed.items():
        for what, call in candidate[0].measure.calls(workspaces[candidate]).items():
            if what == "once" or (row.ok and effort.overhead):
                calls[candidate, what] = call
    states = next(iter(timed))[0].states
    times = interleaved(
        calls, states, rounds=effort.rounds, repeats=effort.repeats, enough=_SAMPLE, tick=tick
    )
    said = _said(perf_counter() - began, process_time() - worked)
    for candidate, row in timed.items():
        once = times[candidate, "once"]
        found[candidate] = replace(
            row,
            build_us=builds[candidate],
            median_us=once.median,
            p95_us=once.p95,
            bare_us=_median(times.get((candidate, "bare"))),
            solve_us=_median(times.get((candidate, "solve"))),
            timed=said,
        )
    return found


def _built(
    candidates: Iterable[Candidate],
) -> tuple[dict[Candidate, float], dict[Candidate, Any]]:
    """Return the median time to build a workspace [us], and a workspace, by candidate."""
    samples: dict[Candidate, list[float]] = {candidate: [] for candidate in candidates}
    workspaces: dict[Candidate, Any] = {}
    for _ in range(_BUILDS):
        workspaces.clear()
        gc.collect()  # workspaces refer to themselves, and a hundred of a large robot fill memory
        for case, solver in samples:
            start = perf_counter()
            workspaces[case, solver] = case.measure.open(case.scene, solver)
            samples[case, solver].append(1e6 * (perf_counter() - start))
    return {each: float(np.median(spent)) for each, spent in samples.items()}, workspaces


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
