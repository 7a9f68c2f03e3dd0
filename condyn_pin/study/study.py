"""Study: time and error of solvers over their parameters."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, fields, is_dataclass, replace
from functools import lru_cache, partial
from itertools import product
from pathlib import Path
from typing import Any, Final, TypeVar, cast

from condyn_pin._core.arguments import check_accuracy_of_a, check_called, check_type
from condyn_pin._core.timing import machine
from condyn_pin._core.tolerances import SOLVED
from condyn_pin._core.work import map_chunks
from condyn_pin.dynamics.scene import Scene, check_scene
from condyn_pin.dynamics.solvers.reference import Reference
from condyn_pin.dynamics.solvers.solver import Solver
from condyn_pin.dynamics.workspace import unsupported_constraints
from condyn_pin.errors import (
    CondynError,
    Interrupted,
    InvalidArgument,
    NotReached,
    NotTuned,
    WorkersLost,
    unknown_name,
)
from condyn_pin.study import fresh as plans
from condyn_pin.study.bench import Progress, silent
from condyn_pin.study.case import (
    Candidate,
    Case,
    Results,
    TimingEffort,
    measure_errors,
    measure_times,
    prepare,
)
from condyn_pin.study.fresh import (
    Choice,
    Plan,
    check_error,
    fingerprint,
    promising,
    solver_of,
    solver_of_row,
)
from condyn_pin.study.measures.answers import AccelerationMeasure
from condyn_pin.study.measures.measure import Measure, as_measure
from condyn_pin.study.states import NoisyStates, Scenes, States, as_states, labelled
from condyn_pin.study.table import Table
from condyn_pin.study.tables import Method, Row


@dataclass(frozen=True, eq=False)
class Study:
    """Solvers on scenes, measured: time and error in the same run.

    Parameters
    ----------
    scenes : Scene, name of a robot, mapping of labels to Scene, or several of the first two
        The name of a robot stands for its standard scenes, of which the first measure says what
        they are; `modellings` gives other ways to model
        the same machine, and ``HIERARCHIES[name].scenes()`` smaller ones.
    solvers : sequence of Solver, or of other methods of the measure, optional
        By default all but `Reference`, each with the parameters that it declares worth a look;
        `sweep` makes others.
    states : States or int
        The states; a number is that many of `SampledStates`.
    measure : name of `MEASURES`, Measure, or several
        What the error is one of.
    accuracy : float
        Error of a that a status of ok promises.
    effort : TimingEffort
        How long to time.
    noise : float or (float, float)
        What sensors are off by: q [rad, m] and v [rad/s, m/s]; one number is both. The truth is
        that of the closed machine beside each state, so that errors are of the order of the noise;
        an answer that is ok is wrong from a tenth on.

    Raises
    ------
    InvalidArgument
        If the accuracy is finer than doubles can have, or there is no measure, no scene, or no such
        solver, or the noise is negative.

    Examples
    --------
    ::

        table = Study("cassie", sweep(Proximal(), mu=[1e-8, 1e-6, 1e-4])).run()
    """

    scenes: Scenes
    solvers: Sequence[Method] | None = None
    states: States | int = 20
    measure: Measure | str | Sequence[Measure | str] = "acceleration"
    accuracy: float = SOLVED
    effort: TimingEffort = field(default_factory=TimingEffort)
    noise: float | tuple[float, float] = 0.0  # [rad, m; rad/s, m/s]

    def __post_init__(self) -> None:
        check_accuracy_of_a(self.accuracy)
        if not self.measures:
            raise InvalidArgument("measure = []: at least one is needed")
        if self.solvers is not None:
            object.__setattr__(self, "solvers", _methods(self.solvers, self.measures))
        check_type("effort", self.effort, TimingEffort, "TimingEffort(rounds=...) is needed")
        object.__setattr__(self, "scenes", labelled(self.scenes, self.measures[0].scenes_of))
        states = as_states(self.states)
        noisy = NoisyStates(states, self.noise)
        object.__setattr__(self, "states", states if noisy.exact else noisy)

    @property
    def measures(self) -> tuple[Measure, ...]:
        """The measures, each once."""
        several = [self.measure] if isinstance(self.measure, Measure | str) else self.measure
        return tuple(dict.fromkeys(as_measure(one) for one in several))

    def solvers_on(self, scene: Scene, measure: Measure) -> tuple[Method, ...]:
        """Return the methods that are measured on a scene.

        Parameters
        ----------
        scene : Scene
        measure : Measure
            Its `methods` are the defaults: solvers, contact solvers or routes.
        """
        return default_sweep(scene, measure) if self.solvers is None else tuple(self.solvers)

    def run(
        self,
        *,
        executor: Executor | None = None,
        progress: Progress = silent,
        timed: bool = True,
        results: str | Path | None = None,
    ) -> Table:
        """Measure.

        Errors first, then times, all solvers of a scene interleaved. The same study gives the same
        errors to the bit, with an executor or without.

        Parameters
        ----------
        executor : concurrent.futures.Executor, optional
            Where errors are computed: `Processes`, Dask's ``Client.get_executor()``. Threads bring
            nothing, Pinocchio holds the lock of the interpreter. Times are always taken here, after
            the last error, and say whether this process had a core for itself.
        progress : callable
            Called with (what, done, total).
        timed : bool
            Take times too.
        results : str or Path, optional
            A file that rows are appended to as they are measured. Those that are in it already are
            not measured again: a study that was stopped goes on.

        Returns
        -------
        Table
            A row a scene, measure and solver, in this order.

        Raises
        ------
        NotAssembled
            If the loops of a scene cannot be closed; before anything is measured.
        Interrupted
            On Ctrl-C; its `table` has what was measured.
        WorkersLost
            If the executor cannot go on after the loss of a worker, as a ``ProcessPoolExecutor``
            cannot; its `done` is a table of what was measured.
        InvalidArgument
            If `results` is not such a file.
        """
        return StudyRun(self, executor, progress, timed, results).table()


def _methods(given: Sequence[Method], measures: Sequence[Measure]) -> tuple[Method, ...]:
    several = list(given) if isinstance(given, Iterable) else [given]
    for method in several:
        for measure in measures:
            if not isinstance(method, measure.asks):
                raise InvalidArgument(
                    f"solvers: {method!r} is no {measure.asks.__name__}, and {measure.name} "
                    f"measures {', '.join(kind.__name__ for kind in measure.methods.values())}"
                )
    if not several:
        raise InvalidArgument("solvers = []: at least one is needed")
    return tuple(dict.fromkeys(several))


# A study at work: cases are prepared, then errors are measured, then times.


_T = TypeVar("_T")

# Solvers in a task for a worker: a few milliseconds to some tenths of a second of work.
_CHUNK = 4


class StudyRun:
    """One run of a study; see `Study.run` for its arguments."""

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
        """Measure the missing rows, and return the table of all."""
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
        """Time the scenes with an untimed row, all comparable rows of a scene together."""
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
        """Run the calls, here or on the executor; yield (index, result) as they finish."""
        try:
            yield from map_chunks(_call, calls, executor=self._executor)
        except WorkersLost as lost:
            raise WorkersLost(
                f"{lost}. Its `done` has what was measured, and with results=PATH the next run "
                "goes on from there",
                self._found(),
            ) from lost


def _call(call: Callable[[], _T]) -> _T:
    return call()


def _rows(case: Case, solvers: Sequence[Method]) -> list[Row]:
    return [measure_errors(case, solver) for solver in solvers]


def _rows_of(packed: bytes, solvers: Sequence[Method]) -> list[Row]:
    """Rows of solvers on a pickled case; a worker caches the cases it has unpacked."""
    return _rows(_unpacked(packed), solvers)


@lru_cache(maxsize=4)
def _unpacked(packed: bytes) -> Case:
    return pickle.loads(packed)  # type: ignore[no-any-return]


# Sweeps: a solver, or a measure, with its parameters turned.


_Knobbed = TypeVar("_Knobbed", bound=Method | Measure)

_ACCELERATION: Final = AccelerationMeasure()


def sweep(one: _Knobbed, **parameters: Sequence[Any]) -> tuple[_Knobbed, ...]:
    """Return a solver, or a measure, with every combination of some parameters.

    Parameters
    ----------
    one : Solver, ContactSolver or Measure
        Parameters that are not named keep the values that they have here.
    **parameters : sequence
        Values by name: ``sweep(Proximal(), mu=[1e-8, 1e-4], max_iterations=[1, 20])``.
        Without any, `one` itself and the values that its class declares in `sweeps`.

    Returns
    -------
    tuple of what `one` is
        Each once; the first parameter varies slowest.

    Raises
    ------
    InvalidArgument
        If a value cannot be used, or is no sequence.
    UnknownName
        If there is no such parameter.
    """
    if not is_dataclass(one) or not hasattr(one, "sweeps"):
        raise InvalidArgument(f"{one!r}: a solver such as Proximal(), or a measure, is needed")
    grids = ({}, *one.sweeps) if not parameters else (parameters,)
    known = [field.name for field in fields(one)]
    for name, values in parameters.items():
        if name not in known:
            raise unknown_name(f"parameter of {type(one).__name__}", name, known)
        if isinstance(values, str) or not hasattr(values, "__iter__"):
            raise InvalidArgument(f"{name} = {values!r}: a list of values is needed")
    made = [
        replace(one, **dict(zip(grid, values, strict=True)))
        for grid in grids
        for values in product(*grid.values())
    ]
    return tuple(dict.fromkeys(made))


def default_sweep(scene: Scene, measure: Measure = _ACCELERATION) -> tuple[Method, ...]:
    """Return the methods of a measure over their parameters; those that refuse the scene once."""
    # `Reference`, with which the others are compared, is not among them.
    chosen: list[Method] = []
    for kind in measure.methods.values():
        method = kind()
        if isinstance(method, Reference):
            continue
        refuses = isinstance(method, Solver) and (
            method.missing() or unsupported_constraints(scene, method)
        )
        chosen += [method] if refuses else sweep(method)
    return tuple(chosen)


# tune and tuned: a solver chosen by a short study, and the choice looked up again.


# All that meet the error are timed at a glance, those near the fastest are looked at.
_GLANCE: Final = TimingEffort(rounds=10, repeats=2, overhead=False)
_LOOK: Final = TimingEffort(rounds=100, overhead=False)
_NEAR: Final = 1.5


def tune(
    scene: Scene,
    error: float = SOLVED,
    *,
    measure: str = "acceleration",
    solvers: Sequence[Method] | None = None,
    progress: Progress = silent,
    save: bool = True,
) -> Solver:
    """Return the fastest solver that meets an error on a scene, by a short study.

    Parameters
    ----------
    scene : Scene
    error : float
        The worst that is good enough, relative, as in `Row.error_worst`.
    measure : str
        A name of `MEASURES`: what is timed, and what the error is one of.
    solvers : sequence of Solver, optional
        What to choose from; as in `Study` by default: all, with the parameters that are worth a
        look.
    progress : callable
        Called with (what, done, total).
    save : bool
        Keep the choice on this machine, where `tuned` finds it.

    Returns
    -------
    Solver, or ContactSolver for the measure ``contact``
        Its `accuracy` is the error that was asked for, so that `solve` says ok to it; 1e-8 where
        that was less.

    Raises
    ------
    NotReached
        If no solver meets the error; nothing is kept.
    NotAssembled
        If the loops of the scene cannot be closed.

    Notes
    -----
    Takes from seconds to half a minute. On a machine that is busy with other work, another solver
    may seem the fastest.
    """
    if save:
        plans.check_folder()
    choice = choose(scene, error, measure=measure, solvers=solvers, progress=progress)
    if save:
        write_plan_of(scene, choice)
    return cast(Solver, choice.solver)  # or a contact solver, where the measure is of those


def choose(
    scene: Scene,
    error: float,
    *,
    measure: str,
    solvers: Sequence[Method] | None,
    progress: Progress,
) -> Choice:
    """Return the solver that `tune` chooses, with its row and fresh errors; no plan is kept."""
    check_scene(scene)
    check_error(error)
    check_called("progress", progress, "what, done, total")
    seen = Study(scene, solvers, measure=measure).run(timed=False, progress=progress)
    label, asked = seen.rows[0].scene, seen.rows[0].measure
    meeting = [row for row in seen.rows if row.answered and row.error_worst <= error]
    if not meeting:
        return seen.cheapest(error, measure=asked)  # raises, with the best that was found
    glance = _time_rows(seen.scenes[label], meeting, _GLANCE, measure, progress)
    rows = [row for row in glance.rows if row.comparable]
    near = [row for row in rows if row.us <= _NEAR * min(r.us for r in rows)]
    looked = _time_rows(seen.scenes[label], near, _LOOK, measure, progress)
    try:
        return looked.cheapest(error, measure=asked)
    except NotReached:  # all that are near the fastest fail at fresh states: slower ones may not
        return glance.cheapest(error, measure=asked)


def _time_rows(
    scene: Scene, rows: Sequence[Row], effort: TimingEffort, measure: str, progress: Progress
) -> Table:
    solvers = [solver_of(row) for row in rows]
    return Study(scene, solvers, measure=measure, effort=effort).run(progress=progress)


def tuned(scene: Scene, error: float = SOLVED, *, measure: str = "acceleration") -> Solver:
    """Return the solver that `tune` chose for this scene, on this machine, with these versions.

    Parameters
    ----------
    scene : Scene
        One with the same content; it need not be the same object.
    error : float
        The same that `tune` was asked for.
    measure : str

    Returns
    -------
    Solver

    Raises
    ------
    NotTuned
        If there is no such plan; the text says what there is, and the line that makes one.

    Notes
    -----
    Reads a file, and writes the model as text to recognise it, which takes milliseconds: call it
    once, not in a loop.
    """
    check_scene(scene)
    check_error(error)
    found = fingerprint(scene)
    path = plans.path_of(found, measure, error)
    more = "" if measure == "acceleration" else f", measure={measure!r}"
    call = f"condyn_pin.study.tune(scene, {error:g}{more})"
    if not path.exists():
        raise NotTuned(
            f"no plan for this scene to {error:g}{_other_plans(found)}; {call} makes one"
        )
    try:
        plan = plans.read_plan(path)
        return cast(Solver, promising(solver_of_row(plan.solver, plan.parameters), error))
    except CondynError as reason:
        raise NotTuned(f"{reason}; {call} makes a new one") from reason


def _other_plans(found: str) -> str:
    """Existing plans of the scene, and why they do not hold on this machine, as text."""
    here, said = plans.this_machine(), []
    for plan in plans.plans_of(found):
        differs = [
            f"{key} {plan.where.get(key)}" for key in here if plan.where.get(key) != here[key]
        ]
        said.append(
            f"{plan.measure} to {plan.error:g}" + (f" with {differs[0]}" if differs else "")
        )
    return f" (there is one for {', '.join(said)})" if said else ""


def write_plan_of(scene: Scene, choice: Choice) -> Plan:
    """Write the plan of a choice for a scene, where `tuned` finds it."""
    plan = plan_for(scene, choice)
    plans.write_plan(plan)
    return plan


def plan_for(scene: Scene, choice: Choice) -> Plan:
    """Return the plan of a choice for a scene."""
    return Plan(
        fingerprint=fingerprint(scene),
        measure=choice.row.measure,
        error=choice.error,
        solver=type(choice.solver).__name__,
        parameters=dict(choice.row.parameters),
        median_us=choice.row.us,
        found=choice.fresh.error,
        expected=choice.fresh.expected,
        states=choice.fresh.states,
        where=plans.this_machine(),
        date=machine()["date"],
    )
