"""Stress: every method on every hard question, in a process that may die."""

from __future__ import annotations

import gc
import multiprocessing
import signal
import warnings
from collections.abc import Callable, Iterator, Sequence
from functools import cache, partial
from importlib import import_module
from itertools import chain
from multiprocessing.connection import Connection
from time import monotonic
from typing import Any

import numpy as np

from condyn_pin._core.arguments import check_called
from condyn_pin._core.arrays import Array
from condyn_pin.contact.problem import ContactProblem
from condyn_pin.contact.solvers import CONTACT_SOLVERS
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.solvers import SOLVERS
from condyn_pin.errors import CondynError, Interrupted, WorkersLost, unknown_name
from condyn_pin.io.load import load_robot
from lab.extremes.base import EXTREMES, Case
from lab.extremes.base import families as all_families
from lab.extremes.contacts import CONTACT_EXTREMES
from lab.extremes.verdicts import (
    Outcome,
    Task,
    Verdict,
    judge,
    judge_contact,
    judge_flight,
    judge_run,
    right_answers,
    turned,
)

# The robots that families of any scene are put on: a planar loop, two spatial ones, legs.
ROBOTS = ("four_bar", "delta", "cassie", "talos")

# [s] for one method on one case: a hundred times what the slowest takes.
PATIENCE = 60.0

# How often a process may be killed from outside before its method is blamed.
_KILLS = 3

_NOT_BEGUN = (
    "the process that runs the cases ended with exit code {} before its first one; it printed why. "
    'It imports the main script: a script that calls stress needs `if __name__ == "__main__":`'
)

Progress = Callable[[int, int], None]


def tasks(
    families: Sequence[str] = (),
    robots: Sequence[str] = ROBOTS,
    seeds: int = 1,
    *,
    heavy: bool = True,
) -> list[Task]:
    """Return the cases of some families of `EXTREMES` and `CONTACT_EXTREMES`, seed after seed.

    All of `EXTREMES` by default. Families of any scene are put on every robot; `heavy` cases take
    gigabytes.
    """
    known = all_families()
    for name in families:
        if name not in known:
            raise unknown_name("extreme", name, known)
    chosen = [known[name] for name in (families or EXTREMES)]
    return [
        Task(family.name, severity, seed, robot)
        for seed in range(seeds)
        for family in chosen
        for robot in (robots if family.any_scene else ("",))
        for severity in family.severities
        if heavy or severity not in family.heavy
    ]


def mixed(todo: Sequence[Task]) -> list[Task]:
    """Return the cases in an order that brings some of every family early, always the same."""
    order = np.random.default_rng(0).permutation(len(todo))
    return [todo[i] for i in order]


def methods(names: Sequence[str] = ()) -> list[str]:
    """Return the solvers that are installed, or those named, by their names.

    Contact solvers have to be named.
    """
    for name in names:
        if name not in SOLVERS and name not in CONTACT_SOLVERS:
            raise unknown_name("solver", name, {**SOLVERS, **CONTACT_SOLVERS})
    return list(names) or [name for name, kind in SOLVERS.items() if not kind.missing()]


def asked(task: Task, names: Sequence[str]) -> list[str]:
    """Return those of some solvers that a task is put to; a contact problem that none fits, to all.

    Contact problems are for contact solvers, and for no others.
    """
    fitting = [name for name in names if name in CONTACT_SOLVERS]
    if task.family in CONTACT_EXTREMES:
        return fitting or list(CONTACT_SOLVERS)
    return [name for name in names if name not in fitting]


def stress(
    todo: Sequence[Task],
    solvers: Sequence[str] = (),
    *,
    seconds: float = np.inf,
    patience: float = PATIENCE,
    imports: Sequence[str] = (),
    progress: Progress | None = None,
) -> list[Outcome]:
    """Return what every method makes of every case.

    No case is begun after some seconds, and a method that takes longer than `patience` hangs [s].
    `imports` names modules that register more solvers or extremes; progress is called with the
    number of cases done and of all. The cases run in another process, which imports the main script
    again: guard it with ``if __name__ == "__main__"``.

    Raises
    ------
    UnknownName
        If there is no such solver or robot.
    Interrupted
        With the outcomes before Ctrl-C.
    WorkersLost
        If the process that runs the cases cannot import the main script or `imports`; its ``done``
        has the outcomes before.
    """
    if progress is not None:
        check_called("progress", progress, "done, total")
    names, start = list(solvers) if imports else methods(solvers), monotonic()
    for robot in {task.robot for task in todo} - {""}:
        load_robot(robot)  # a name that is none is no refusal of a method
    found: list[Outcome] = []
    try:
        with _Process(imports) as process:
            for k, task in enumerate(todo):
                if monotonic() - start >= seconds:
                    break
                found += process.answers(task, asked(task, names), patience)
                if progress:
                    progress(k + 1, len(todo))
    except KeyboardInterrupt as stop:
        raise Interrupted(found) from stop
    except WorkersLost as lost:
        lost.done = found
        raise
    return found


class _Process:
    """A worker that is started again when it dies."""

    def __init__(self, imports: Sequence[str]) -> None:
        self._imports = tuple(imports)
        self._context = multiprocessing.get_context("spawn")
        self._worker: Any = None
        self._pipe: Any = None

    def __enter__(self) -> _Process:
        return self

    def __exit__(self, *_: object) -> None:
        self._stop()

    def answers(self, task: Task, methods: Sequence[str], patience: float) -> Iterator[Outcome]:
        """Yield the outcome of every method, also of those that take the process down."""
        left, kills = list(methods), 0
        while left:
            ending = Verdict.CRASHED
            self._start()
            self._pipe.send((task, left))
            now = ""
            while (answer := self._receive(patience)) is not None:
                if isinstance(answer, Verdict):
                    ending = answer
                    break
                if isinstance(answer, str):
                    now = answer
                else:
                    left.remove(answer.method)
                    yield answer
            if answer is None:
                return
            code = self._stop()
            if code == -signal.SIGKILL and ending is Verdict.CRASHED and kills < _KILLS:
                kills += 1  # from outside, such as for lack of memory: no fault of the method
                continue
            blamed = [now] if now in left else list(left)
            for method in blamed:
                left.remove(method)
                yield Outcome(task, method, ending, np.nan, f"exit code {code} in {now}")

    def _receive(self, patience: float) -> Any:
        """Return the next message, or how the process ended."""
        try:
            return self._pipe.recv() if self._pipe.poll(patience) else Verdict.HUNG
        except (EOFError, OSError):
            return Verdict.CRASHED

    def _start(self) -> None:
        if self._worker is not None:
            return
        self._pipe, other = self._context.Pipe()
        worker = self._context.Process(target=work, args=(other, self._imports), daemon=True)
        worker.start()
        self._worker = worker
        other.close()
        # until it has imported everything, which no method is blamed for
        if self._receive(PATIENCE) is Verdict.CRASHED:
            raise WorkersLost(_NOT_BEGUN.format(self._stop()))

    def _stop(self) -> int:
        """End the process, if there is one; return its exit code, negative for a signal."""
        if self._worker is None:
            return 0
        self._pipe.close()
        self._worker.join(1.0)  # it may be dying by itself, of something that has a name
        self._worker.kill()
        self._worker.join()
        code, self._worker = int(self._worker.exitcode), None
        return code


# A process of its own for what may crash or hang: it takes tasks and sends back outcomes.


Judged = tuple[Verdict, float, str]

# Pinocchio's Data has 4 nv^3 numbers. Workspaces are in cycles, and from so many degrees of freedom
# on they are not left to the collector, which counts objects.
_LONG = 100


class Memory:
    """The scenes that families are put through, made once a process."""

    def __init__(self) -> None:
        self._scenes: dict[str, Scene] = {}

    def scene(self, robot: str) -> Scene | None:
        """Return the scene of a robot with its loops and contacts; None for no name."""
        if robot and robot not in self._scenes:
            found = load_robot(robot)
            self._scenes[robot] = Scene(found, [*found.loops, *found.contacts])
        return self._scenes.get(robot)


def work(pipe: Connection, imports: Sequence[str]) -> None:
    """Serve tasks until the pipe closes.

    For each task and each of its methods first the method's name goes out, and then its outcome:
    who dies in between is known by name.
    """
    for module in imports:
        import_module(module)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the process that asks
    memory = Memory()
    pipe.send("ready")
    while True:
        try:
            task, methods = pipe.recv()
        except (EOFError, OSError):
            return
        try:
            for answer in chain(answers(task, methods, memory), [None]):
                pipe.send(answer)
        except BrokenPipeError:  # nobody asks any more
            return


def answers(task: Task, methods: list[str], memory: Memory) -> Iterator[str | Outcome]:
    """Yield the name of each method of a task, and then its outcome."""
    if task.family in CONTACT_EXTREMES:
        yield from _contact_answers(task, methods)
        return
    yield "making the case"
    case, said = make(task, memory)
    right = right_answers(case) if case else ()
    for method in methods:
        yield method
        if case is None:
            verdict = Verdict.REFUSED if said.startswith("CondynError") else Verdict.CRASHED
            yield Outcome(task, method, verdict, float("nan"), said)
            continue
        if case.scene.robot.nv >= _LONG:
            gc.collect()
        yield Outcome(task, method, *_judged(partial(_judge, case, method, right)))


def _judge(case: Case, method: str, right: tuple[Array, ...]) -> Judged:
    solver = turned(SOLVERS[method], case.parameters)
    if case.motion:
        return judge_run(case, case.motion, solver)
    if case.flight:
        return judge_flight(case, case.flight, solver)
    return judge(case, solver, right)


def _contact_answers(task: Task, methods: list[str]) -> Iterator[str | Outcome]:
    """Yield the same of a contact problem, and of contact solvers."""
    yield "making the case"
    # one for all of them; what refuses it is said of each
    problem = cache(partial(CONTACT_EXTREMES[task.family].problem, task.severity, task.seed))
    for method in methods:
        yield method
        yield Outcome(task, method, *_judged(partial(_judge_contact, problem, method)))


def _judge_contact(problem: Callable[[], ContactProblem], method: str) -> Judged:
    return judge_contact(problem(), CONTACT_SOLVERS[method]())


def _judged(verdict: Callable[[], Judged]) -> Judged:
    """Return a verdict, the error and what was said, also where there is no answer."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # a library that warns has not thought of it
        try:
            return verdict()
        except CondynError as refusal:
            return Verdict.REFUSED, float("nan"), _sentence(refusal)
        except Exception as failure:
            return Verdict.CRASHED, float("nan"), _sentence(failure)


def make(task: Task, memory: Memory) -> tuple[Case | None, str]:
    """Return the case of a task, or None and why there is none."""
    try:
        scene = memory.scene(task.robot)
        return EXTREMES[task.family].case(task.severity, task.seed, scene), ""
    except CondynError as error:
        return None, f"CondynError {_sentence(error)}"
    except Exception as error:
        return None, _sentence(error)


def _sentence(error: Exception) -> str:
    return f"{type(error).__name__}: {error}".split("\n", 1)[0]
