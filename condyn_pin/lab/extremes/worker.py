"""A process of its own for what may crash or hang: it takes tasks and sends back outcomes."""

from __future__ import annotations

import gc
import signal
import warnings
from collections.abc import Callable, Iterator, Sequence
from functools import cache, partial
from importlib import import_module
from itertools import chain
from multiprocessing.connection import Connection

from condyn_pin._core.arrays import Array
from condyn_pin.contact.problem import ContactProblem
from condyn_pin.contact.solvers import CONTACT_SOLVERS
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.solvers import SOLVERS
from condyn_pin.errors import CondynError
from condyn_pin.io.load import load_robot
from condyn_pin.lab.contact_extremes import CONTACT_EXTREMES
from condyn_pin.lab.extremes.base import EXTREMES, Case
from condyn_pin.lab.extremes.contact_verdict import judge_contact
from condyn_pin.lab.extremes.motion_verdict import judge_flight, judge_run
from condyn_pin.lab.extremes.verdict import Outcome, Task, Verdict, judge, right_answers, turned

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
