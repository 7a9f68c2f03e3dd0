"""Case: a scene at some states with the truth there, and errors and times of solvers."""

from __future__ import annotations

import gc
import hashlib
import json
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from math import inf, isfinite
from pathlib import Path
from time import perf_counter, process_time
from typing import Any

import numpy as np

from condyn_pin._core.arguments import check_count
from condyn_pin._core.arrays import Array
from condyn_pin._core.files import parse_json
from condyn_pin._core.threads import one_blas_thread
from condyn_pin._core.timing import Call, State, interleaved, machine
from condyn_pin._core.tolerances import DOUBT, SOLVED
from condyn_pin.constraints.contacts.candidates import Candidates
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import CondynError, InvalidArgument
from condyn_pin.study.measures.measure import WRONG, ComparedAnswer, Measure
from condyn_pin.study.states import States
from condyn_pin.study.tables import ALONE, Key, Method, Parameter, Row, key, usual_parameters

# Statuses of a state that no solution was returned for.
REFUSED, RAISED = "refused", "raised"


@dataclass(frozen=True, eq=False)
class Case:
    """A scene at some states, and the truth there."""

    label: str
    scene: Scene
    measure: Measure
    accuracy: float  # what statuses are judged by
    set_name: str  # of the states
    states: tuple[State, ...]
    truth: tuple[Array, ...]  # one a state
    floor: float  # error that rounding of M alone can make: what `Reference` may be off by
    promised: float = SOLVED  # error that makes an answer wrong which says ok

    @cached_property
    def fingerprint(self) -> str:
        """Hash of all that errors and times depend on, except the solver."""
        here = {name: value for name, value in machine().items() if name != "date"}
        digest = hashlib.sha256(f"{here} {self.accuracy!r}".encode())
        for array in (*(x for state in self.states for x in state), *self.truth):
            digest.update(np.ascontiguousarray(array).tobytes())
        return digest.hexdigest()[:16]

    def key(self, solver: Method) -> Key:
        """Return the key of the row of a solver."""
        measure = self.measure
        return key(self.label, repr(solver), measure.label, measure.how, self.set_name)


@one_blas_thread
def prepare(label: str, scene: Scene, measure: Measure, states: States, accuracy: float) -> Case:
    """Return the case of a scene: its states, and the truth at each."""
    chosen = states.of(scene)
    truth = tuple(measure.truth(scene, states.judged_at(scene, state)) for state in chosen)
    floor = scene.nominal.estimator.rounding
    promised = accuracy if states.exact else max(accuracy, DOUBT)
    return Case(
        label=label,
        scene=scene,
        measure=measure,
        accuracy=accuracy,
        set_name=states.name,
        states=chosen,
        truth=truth,
        floor=floor,
        promised=promised,
    )


@one_blas_thread  # the same bits each time, however many cores there are
def measure_errors(case: Case, solver: Method) -> Row:
    """Return the row of a solver, without times."""
    # A refusal and an exception are statuses like others, and their text is kept: one bad solver
    # does not end a study.
    answers, statuses, notes = _answers(case, solver)
    missing = len(case.states) - len(answers)
    errors = [found.error for found in answers] + [inf] * missing
    return Row(
        scene=case.label,
        rows=case.scene.rows + Candidates(case.scene.robot.model, case.scene.contact_bounds).rows,
        nv=case.scene.robot.nv,
        method=solver.title,
        solver=repr(solver),
        parameters=parameters_of(solver),
        measure=case.measure.label,
        states=case.set_name,
        n=len(case.states),
        # the larger of the middle two: a mean of them may be no error at all
        error_median=sorted(errors)[len(errors) // 2],
        error_worst=max(errors),
        dynamics_error=max((found.dynamics_error for found in answers), default=inf),
        constraint_error=max((found.constraint_error for found in answers), default=inf),
        iterations=max((found.iterations for found in answers), default=0),
        statuses=dict(sorted(statuses.items())),
        note="; ".join(notes),
        how=dict(case.measure.how),
    )


def _answers(case: Case, solver: Method) -> tuple[list[ComparedAnswer], Counter[str], list[str]]:
    """Answers of a solver, counts of states by status, and notes on failures."""
    answers: list[ComparedAnswer] = []
    statuses: Counter[str] = Counter()
    notes: dict[str, None] = {}

    def failed(error: Exception, states: int) -> None:
        known = isinstance(error, CondynError)
        statuses[REFUSED if known else RAISED] += states
        notes[str(error) if known else f"{type(error).__name__}: {error}"] = None

    try:
        workspace = case.measure.open(case.scene, solver)
    except Exception as error:
        failed(error, len(case.states))
        return answers, statuses, list(notes)
    for state, truth in zip(case.states, case.truth, strict=True):
        try:
            found = case.measure.answer(workspace, state, truth, case.accuracy)
        except Exception as error:
            failed(error, 1)
        else:
            if found.status == WRONG and found.error <= case.promised:
                found = replace(found, status="ok")
            answers.append(found)
            statuses[found.status] += 1
    return answers, statuses, list(notes)


def parameters_of(solver: Method) -> dict[str, Parameter]:
    """Return the parameters of a solver by name; one that is no plain value as text."""
    # Its accuracy is among them where it is not the usual one.
    names = list(usual_parameters(type(solver)))
    names += ["accuracy"] if getattr(solver, "accuracy", SOLVED) != SOLVED else []
    return {name: _plain(getattr(solver, name)) for name in names}


def _plain(value: Any) -> Parameter:
    if isinstance(value, np.generic):
        value = value.item()
    return value if isinstance(value, float | int | str | bool | None) else repr(value)


# Times of the rows of a scene, all candidates interleaved, in the process that owns the core.


# Of the time that passed, what this process was given, to have owned its core.
_OWNED = 0.95

_BUILDS = 3

# A sample is long beside a clock read; the methods that take tenths of a millisecond need no mean.
_SAMPLE = 1e-4  # [s]

Candidate = tuple[Case, Method]


@dataclass(frozen=True)
class TimingEffort:
    """Timing effort: rounds and repeats of a measurement, and which calls are timed.

    Parameters
    ----------
    rounds, repeats : int
        As in `condyn_pin._core.threads.interleaved`; slow calls are repeated less.
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
        """True if the times of a row need no measurement: taken well enough, or impossible."""
        taken = row.median_us is not None and (row.timed == ALONE or not self.alone)
        return taken or not isfinite(row.error_worst)


def measure_times(
    rows: Mapping[Candidate, Row],
    effort: TimingEffort,
    tick: Callable[[], None],
) -> dict[Candidate, Row]:
    """Return the rows of some candidates with their times."""
    # Everything that has a finite answer at every state is timed, in one interleaved run; solve and
    # bare call only where every status is ok, since doubtful answers are looked at twice. The cases
    # of `rows` have the same scene and the same states; `tick` is called after each round.
    timed = {candidate: row for candidate, row in rows.items() if isfinite(row.error_worst)}
    found: dict[Candidate, Row] = {}
    for candidate, row in rows.items():
        failures = ", ".join(f"{count} {status}" for status, count in row.statuses.items())
        why = f"not timed: no finite answer at every state ({failures})"
        found[candidate] = replace(row, timed=why)
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
    said = _timing_remark(perf_counter() - began, process_time() - worked)
    for candidate, row in timed.items():
        once = times[candidate, "once"]
        bare, solve = (times.get((candidate, what)) for what in ("bare", "solve"))
        found[candidate] = replace(
            row,
            build_us=builds[candidate],
            median_us=once.median,
            p95_us=once.p95,
            bare_us=bare.median if bare else None,
            solve_us=solve.median if solve else None,
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


def _timing_remark(passed: float, worked: float) -> str:
    """Timing remark of a row: on a core of its own, or the share of the core it had."""
    share = worked / passed if passed else 1.0
    if share >= _OWNED:
        return ALONE
    return f"timed on a shared core: had it {share:.0%} of the time"


# Results: a file of rows that grows while a study runs, so that it can be stopped and resumed.
#
# One json object a line: the fingerprint of the case, and the row. A line that a killed process
# left unfinished is cut off; of several lines of the same case and solver the last one counts. Rows
# of other states, other versions or another machine stay in the file, and are not used.


_START = b'{"fingerprint": '


class Results:
    """Rows that were measured, in memory and in a file, which is read and appended to."""

    def __init__(self, path: str | Path | None) -> None:
        self._path = None if path is None else Path(path)
        self._rows: dict[tuple[str, Key], Row] = {}
        if self._path is not None:
            self._read(self._path)

    def find(self, fingerprint: str, key: Key) -> Row | None:
        """Return the row of a case and a solver; None if it was not measured."""
        return self._rows.get((fingerprint, key))

    def keep(self, fingerprint: str, row: Row) -> None:
        """Append a row to the results and, before returning, to the file."""
        self._rows[fingerprint, row.key] = row
        if self._path is not None:
            line = json.dumps({"fingerprint": fingerprint, "row": row.as_dict()}, allow_nan=False)
            try:
                with self._path.open("a", encoding="utf-8") as file:
                    file.write(line + "\n")
            except OSError as error:
                raise InvalidArgument(
                    f"results = {str(self._path)!r}: {error.strerror}; what is in it stays, and "
                    "the next run goes on from there"
                ) from error

    def _read(self, path: Path) -> None:
        if path.exists() and not path.is_file():  # a pipe, or a device without an end
            raise InvalidArgument(f"results = {str(path)!r}: it is not a file")
        try:
            path.open("ab").close()  # what cannot be written to is refused now
            text = path.read_bytes()
        except OSError as error:
            raise InvalidArgument(f"results = {str(path)!r}: {error.strerror}") from error
        whole = text[: text.rfind(b"\n") + 1]
        for number, line in enumerate(whole.splitlines(), 1):
            try:
                entry = parse_json(line)
                row = Row.from_dict(entry["row"])
                self._rows[str(entry["fingerprint"]), row.key] = row
            except (ValueError, KeyError, TypeError) as error:
                raise _no_results(path, number, error) from error
        unfinished = text[len(whole) :]
        if unfinished and not unfinished.startswith(_START[: len(unfinished)]):
            raise _no_results(path, whole.count(b"\n") + 1, "it starts otherwise")
        if unfinished:
            with path.open("r+b") as file:
                file.truncate(len(whole))


def _no_results(path: Path, line: int, why: object) -> InvalidArgument:
    return InvalidArgument(
        f"results = {str(path)!r}, line {line}: not a row of a study ({why}); choose another file"
    )
