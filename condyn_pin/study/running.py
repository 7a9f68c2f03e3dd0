"""A study at work: cases are prepared, then errors are measured, then times."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from functools import lru_cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from condyn_pin._core.arguments import check_called
from condyn_pin._core.timing import machine
from condyn_pin._core.work import map_chunks
from condyn_pin.errors import Interrupted, WorkersLost
from condyn_pin.study.bench import Progress
from condyn_pin.study.case import Case, measure_errors, prepare
from condyn_pin.study.clocks import Candidate, measure_times
from condyn_pin.study.method import Method
from condyn_pin.study.results import Results
from condyn_pin.study.row import Row
from condyn_pin.study.scenes import labelled
from condyn_pin.study.states import as_states
from condyn_pin.study.table import Table

if TYPE_CHECKING:
    from condyn_pin.study.study import Study

_T = TypeVar("_T")

# Solvers in a task for a worker: a few milliseconds to some tenths of a second of work.
_CHUNK = 4


class Run:
    """One run of a study; `Study.run` says what its arguments are."""

    def __init__(
        self,
        study: Study,
        executor: Executor | None,
        progress: Progress,
        timed: bool,
        results: str | Path | None,
    ) -> None:
        check_called("progress", progress, "what, done, total")
        self._study, self._executor = study, executor
        self._progress, self._timed = progress, timed
        self._results = Results(results)
        self._cases: list[tuple[Case, tuple[Method, ...]]] = []
        self._done, self._total = 0.0, 0

    def table(self) -> Table:
        """Measure what is missing, and return all rows."""
        try:
            self._prepare()
            self._errors()
            if self._timed:
                self._times()
        except KeyboardInterrupt as stop:
            raise Interrupted(self._found()) from stop
        return self._found()

    def _found(self) -> Table:
        rows = [self._row(case, solver) for case, solvers in self._cases for solver in solvers]
        floors = {case.label: case.floor for case, _ in self._cases}
        scenes = {case.label: case.scene for case, _ in self._cases}
        return Table(tuple(row for row in rows if row is not None), machine(), floors, scenes)

    def _row(self, case: Case, solver: Method) -> Row | None:
        return self._results.find(case.fingerprint, case.key(solver))

    def _prepare(self) -> None:
        """Find the states of every scene, and the truth there."""
        study, scenes = self._study, labelled(self._study.scenes)
        states, measures = as_states(study.states), study.measures
        calls = [
            partial(prepare, label, scene, measure, states, study.accuracy)
            for label, scene in scenes.items()
            for measure in measures
        ]
        lists = [
            study.solvers_on(scene, measure) for scene in scenes.values() for measure in measures
        ]
        self._total = len(calls) + (1 + self._timed) * sum(map(len, lists))
        made: dict[int, Case] = {}
        for number, case in self._each(calls):
            made[number] = case
            self._tick("states", 1)
        self._cases = [(made[k], its) for k, its in enumerate(lists)]

    def _errors(self) -> None:
        """Measure the errors of the rows that are not known."""
        calls: list[Callable[[], list[Row]]] = []
        of: list[Case] = []
        for case, solvers in self._cases:
            missing = [solver for solver in solvers if self._row(case, solver) is None]
            self._tick(f"{case.label}: errors", len(solvers) - len(missing))
            if self._executor is None:
                size, measure = 1, partial(_rows, case)
            else:
                size, measure = _CHUNK, partial(_rows_of, pickle.dumps(case))
            for k in range(0, len(missing), size):
                calls.append(partial(measure, missing[k : k + size]))
                of.append(case)
        for number, rows in self._each(calls):
            for row in rows:
                self._results.keep(of[number].fingerprint, row)
            self._tick(f"{of[number].label}: errors", len(rows))

    def _times(self) -> None:
        """Time the scenes of which a row lacks a time, each with all that compares there."""
        groups: dict[tuple[str, str], dict[Candidate, Row]] = {}
        for case, solvers in self._cases:
            group = groups.setdefault((case.label, case.measure.label), {})
            for solver in solvers:
                row = self._row(case, solver)
                if row is not None:
                    group[case, solver] = row
        for (label, _), rows in groups.items():
            if all(map(self._study.effort.suffices, rows.values())):
                self._tick(f"{label}: times", len(rows))
                continue
            tick = partial(self._tick, f"{label}: times", len(rows) / self._study.effort.rounds)
            for (case, _), row in measure_times(rows, self._study.effort, tick).items():
                self._results.keep(case.fingerprint, row)

    def _tick(self, what: str, done: float) -> None:
        self._done += done
        self._progress(what, round(self._done), self._total)

    def _each(self, calls: Sequence[Callable[[], _T]]) -> Iterator[tuple[int, _T]]:
        """Call everything, here or on the executor; give (number, result) as they come."""
        try:
            yield from map_chunks(_called, calls, executor=self._executor)
        except WorkersLost as lost:
            raise WorkersLost(
                f"{lost}. Its `done` has what was measured, and with results=PATH the next run "
                "goes on from there",
                self._found(),
            ) from lost


def _called(call: Callable[[], _T]) -> _T:
    return call()


def _rows(case: Case, solvers: Sequence[Method]) -> list[Row]:
    return [measure_errors(case, solver) for solver in solvers]


def _rows_of(packed: bytes, solvers: Sequence[Method]) -> list[Row]:
    """Measure in a worker, which keeps the cases that it has unpacked."""
    return _rows(_unpacked(packed), solvers)


@lru_cache(maxsize=4)
def _unpacked(packed: bytes) -> Case:
    return pickle.loads(packed)  # type: ignore[no-any-return]
