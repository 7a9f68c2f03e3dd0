"""Case: a scene at some states with the truth there, and what solvers make of it."""

from __future__ import annotations

import hashlib
from collections import Counter
from dataclasses import dataclass, replace
from functools import cached_property
from math import inf
from typing import Any

import numpy as np

from condyn_pin._core.arrays import Array
from condyn_pin._core.blas_threads import one_blas_thread
from condyn_pin._core.timing import State, machine
from condyn_pin._core.tolerances import DOUBT, SOLVED
from condyn_pin.constraints.contacts.candidates import Candidates
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import CondynError
from condyn_pin.study.measures.base import WRONG, Answer, Measure
from condyn_pin.study.method import Method, usual_parameters
from condyn_pin.study.row import Key, Parameter, Row, key
from condyn_pin.study.states import States

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
        """A text that changes with all that errors and times depend on, but for the solver."""
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
    return Case(label, scene, measure, accuracy, states.name, chosen, truth, floor, promised)


@one_blas_thread  # the same bits each time, however many cores there are
def measure_errors(case: Case, solver: Method) -> Row:
    """Return the row of a solver, without times.

    A refusal and an exception are statuses like others, and their text is kept: one bad solver does
    not end a study.
    """
    answers, statuses, notes = _answers(case, solver)
    missing = len(case.states) - len(answers)
    errors = [found.error for found in answers] + [inf] * missing
    return Row(
        scene=case.label,
        rows=_rows(case.scene),
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


def _answers(case: Case, solver: Method) -> tuple[list[Answer], Counter[str], list[str]]:
    """Return a solver's answers, how many states have which status, and what was said of them."""
    answers: list[Answer] = []
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


def _rows(scene: Scene) -> int:
    """Return the rows of constraints and contacts."""
    return scene.rows + Candidates(scene.robot.model, scene.contact_bounds).rows


def parameters_of(solver: Method) -> dict[str, Parameter]:
    """Return the parameters of a solver by name; one that is no plain value as text.

    Its accuracy is among them where it is not the usual one.
    """
    names = list(usual_parameters(type(solver)))
    names += ["accuracy"] if getattr(solver, "accuracy", SOLVED) != SOLVED else []
    return {name: _plain(getattr(solver, name)) for name in names}


def _plain(value: Any) -> Parameter:
    if isinstance(value, np.generic):
        value = value.item()
    return value if isinstance(value, float | int | str | bool | None) else repr(value)
