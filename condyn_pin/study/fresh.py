"""Fresh states: a solver judged where it was not chosen.

The worst of n states says little of the next n. If the tail of the errors goes on as it is, like a
power of how rare they are, every ten times as many states make the worst larger by the same factor.
The tenth largest of n is where the largest of n / 10 is to be looked for, so that over a hundred
times as many it is

    worst * (worst / tenth)^2.

Ten errors say the exponent of the tail to 1 / sqrt(10) of it (Hill), so two of these are added,

    expected = worst * (worst / tenth)^(2 (1 + 2 / sqrt(10))),

and a solver meets an error only if `expected` does: it is used more often than it is tried. A tenth
that is zero says nothing of the worst: it counts as rounding.

References
----------
Hill. A simple general approach to inference about the tail of a distribution. Annals of
Statistics 3, 1975.
"""

from __future__ import annotations

import ast
import hashlib
import json
import os
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from math import inf, isfinite, sqrt
from pathlib import Path
from typing import Any, ClassVar, Final

import numpy as np

from condyn_pin._core.arguments import read_call
from condyn_pin._core.arrays import Array, finite
from condyn_pin._core.files import check_writable, parse_json, read_text, write_text
from condyn_pin._core.timing import State, machine
from condyn_pin._core.tolerances import SOLVED
from condyn_pin.dynamics.nominal import described_posture
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.solvers import SOLVERS
from condyn_pin.errors import CondynError, InvalidArgument, NotReached, unknown_name
from condyn_pin.study.measures import MEASURES
from condyn_pin.study.measures.measure import Measure
from condyn_pin.study.measures.motions import SCHEMES
from condyn_pin.study.states import SampledStates, States, as_states
from condyn_pin.study.tables import (
    ANSWERED,
    FORMAT,
    Method,
    Parameter,
    Record,
    Row,
    method_named,
)

_TENTH: Final = 10
_DECADES: Final = 2 * (1 + 2 / sqrt(_TENTH))  # two, and what ten errors leave open
_LEAST: Final = 20  # states, for a tenth largest that is not the smallest

# No error is known better than that.
_ROUNDING: Final = 2.2e-16

# Seeds of studies are small numbers.
_SEED: Final = 2**32


@dataclass(frozen=True)
class Fresh:
    """Errors of a solver at fresh states: worst, and expected over a hundred times as many."""

    states: int  # how many
    error: float  # the worst, relative; infinite where there was no answer
    expected: float  # what the worst is expected to stay below over a hundred times as many states

    @classmethod
    def of(cls, errors: Sequence[float]) -> Fresh:
        """Return the worst and the expected error of the errors at some states."""
        ranked = sorted((error if isfinite(error) else inf for error in errors), reverse=True)
        worst = ranked[0]
        tenth = ranked[min(_TENTH, len(ranked)) - 1]
        factor = max(worst / max(tenth, _ROUNDING), 1.0) if isfinite(worst) else 1.0
        return cls(len(ranked), worst, worst * factor**_DECADES)

    def __str__(self) -> str:
        return (
            f"worst {self.error:.1e} at {self.states} fresh states, "
            f"{self.expected:.1e} expected over {_TENTH**2 * self.states}"
        )


def as_fresh(states: States | int) -> States:
    """Return a set of states; a number is that many sampled ones, of a seed that no study has."""
    chosen = states if isinstance(states, States) else as_states(states)
    if isinstance(chosen, SampledStates) and chosen is not states:
        chosen = replace(chosen, seed=_SEED)
    _check_count(states, getattr(chosen, "count", _LEAST))
    return chosen


def _check_count(states: States | int, count: int) -> None:
    if count < _LEAST:
        raise InvalidArgument(f"states = {states!r}: {count}, and at least {_LEAST} are needed")


class FreshErrors:
    """The errors of solvers at the same fresh states, at least 20."""

    def __init__(self, scene: Scene, measure: Measure, states: States | int) -> None:
        self._scene, self._measure = scene, measure
        self._states = as_fresh(states).of(scene)
        _check_count(states, len(self._states))
        self._truth = [measure.truth(scene, state) for state in self._states]

    def __call__(self, solver: Method, measure: Measure | None = None) -> Fresh:
        """Return the errors of a solver at the states, by a measure with the same truth."""
        asked = self._measure if measure is None else measure
        try:
            workspace = asked.open(self._scene, solver)
        except Exception:  # a solver of somebody's own may raise anything; it is rejected
            return Fresh.of([inf] * len(self._states))
        pairs = zip(self._states, self._truth, strict=True)
        return Fresh.of([_error(asked, workspace, *pair) for pair in pairs])


def _error(measure: Measure, workspace: Any, state: State, truth: Array) -> float:
    """Error at a state; infinite if there is no answer, or its status is ok and its error not."""
    try:
        answer = measure.answer(workspace, state, truth, SOLVED)
    except Exception:  # a solver of somebody's own may raise anything; it is rejected
        return inf
    return answer.error if answer.status in ANSWERED else inf


# cheapest: the fastest solver of a table that meets an error, where it was not chosen too.


# For several errors of one table, one after the other, the states and the truth stay the same.
_fresh_errors = lru_cache(maxsize=1)(FreshErrors)

_LONGEST: Final = 1000  # characters of a tuple as text


@dataclass(frozen=True)
class Choice:
    """A solver chosen by measurement.

    Attributes
    ----------
    solver : Solver, or another method of the measure
        Its `accuracy` is what was asked for, or 1e-8 where that was less.
    error : float
        What was asked for, relative.
    row : Row
        What the study found of it.
    fresh : Fresh
        Its errors at states that had no part in the choice.
    rejected : tuple of (Row, Fresh)
        Faster ones that met the error in the study, but not at the fresh states.
    """

    solver: Method
    error: float
    row: Row
    fresh: Fresh
    rejected: tuple[tuple[Row, Fresh], ...]

    def __str__(self) -> str:
        lines = [
            f"{self.row.scene}, {self.row.measure} to {self.error:g}: {self.row.short}",
            f"{self.row.us:.1f} us; {self.fresh}",
        ]
        lines += [f"not {row.short}: {fresh}" for row, fresh in self.rejected]
        return "\n".join(lines)


def check_error(error: float) -> None:
    """Refuse an error that cannot be asked for."""
    if not finite("error", error, ()) > 0:
        raise InvalidArgument(f"error = {error!r}: a number > 0 is needed, relative")


def choose(rows: Sequence[Row], scene: Scene | None, error: float, states: States | int) -> Choice:
    """Return the fastest solver of one question that meets an error; see `Table.cheapest`."""
    rivals = sorted((row for row in rows if row.comparable), key=lambda row: row.us)
    meeting = [row for row in rivals if row.error_worst <= error]
    if not meeting:
        raise _not_reached(rows, error, [])
    if scene is None:
        label = meeting[0].scene
        raise InvalidArgument(
            f"this table has no scene {label!r} to make fresh states with; "
            f"hand it in: table.with_scenes({{{label!r}: scene}})"
        )
    fresh_states = as_fresh(states)
    for name in {row.states for row in meeting}:
        if fresh_states.overlaps(name):
            raise InvalidArgument(
                f"states: {fresh_states.name} are not fresh, the study looked at {name}; another "
                "seed gives other states"
            )
    judge = _fresh_errors(scene, measure_of(meeting[0].measure), fresh_states)
    rejected: list[tuple[Row, Fresh]] = []
    for row in meeting:
        solver = solver_of(row)
        fresh = judge(solver, measured_as(row))
        if fresh.expected <= error:
            return Choice(promising(solver, error), error, row, fresh, tuple(rejected))
        rejected.append((row, fresh))
    raise _not_reached(rows, error, rejected)


def promising(solver: Method, error: float) -> Method:
    """Return a solver with the accuracy that it was chosen for, at least 1e-8, if it has one."""
    if not hasattr(solver, "accuracy"):
        return solver
    return replace(solver, accuracy=max(error, SOLVED))  # type: ignore[type-var]


def solver_of(row: Row) -> Method:
    """Return the solver of a row, with its parameters."""
    solver = solver_of_row(row.solver.split("(")[0], row.parameters)
    if repr(solver) != row.solver:
        raise InvalidArgument(
            f"{row.solver}: with its parameters it is {solver!r}; run the study again"
        )
    return solver


def solver_of_row(name: str, parameters: Mapping[str, Parameter]) -> Method:
    """Return the solver of a class name, with parameters as in rows: a tuple as text."""
    kind = method_named(name)
    if kind is None:
        raise unknown_name("solver", name, [each.__name__ for each in SOLVERS.values()])
    usual = {f.name: f.default for f in fields(kind)}  # type: ignore[arg-type]
    try:
        return kind(**{key: _value(parameter, usual[key]) for key, parameter in parameters.items()})
    except (KeyError, TypeError, SyntaxError, ValueError) as error:
        if isinstance(error, CondynError):
            raise
        raise InvalidArgument(
            f"{dict(parameters)}: not the parameters of {kind.__name__}"
        ) from error


def _value(parameter: Parameter, usual: Any) -> Any:
    is_text = isinstance(parameter, str) and not isinstance(usual, str)
    if is_text and len(parameter) > _LONGEST:  # type: ignore[arg-type]
        raise ValueError("a text of this length")
    return ast.literal_eval(parameter) if is_text else parameter  # type: ignore[arg-type]


def measure_of(label: str) -> Measure:
    """Return the measure of a label: a name, with the parameters that differ from the defaults."""
    if label in MEASURES:  # a name may be more than one word
        return MEASURES[label]()
    try:
        name, _ = call = read_call(label)
        return MEASURES[name](**call.parameters_made(SCHEMES))
    except (ValueError, KeyError, TypeError) as error:
        raise unknown_name("measure", label, MEASURES) from error


def measured_as(row: Row) -> Measure:
    """Return the measure of a row, with the parameters that belong to its answer."""
    measure = measure_of(row.measure)
    if not row.how:
        return measure
    try:
        again = measure.with_how(row.how)
    except (ValueError, KeyError, TypeError) as error:
        if isinstance(error, CondynError):
            raise
        raise InvalidArgument(f"{row.measure}: it has no parameters {row.how}") from error
    if dict(again.how) != row.how:
        raise InvalidArgument(f"{row.measure}: {row.how} in a table do not make it again")
    return again


def _not_reached(
    asked: Sequence[Row], error: float, rejected: Sequence[tuple[Row, Fresh]]
) -> NotReached:
    row = min((r for r in asked if r.answered), key=lambda r: r.error_worst, default=None)
    text = f"nothing in this table meets {asked[0].measure} to {error:g} on {asked[0].scene!r}"
    if rejected:
        best, fresh = min(rejected, key=lambda pair: pair[1].expected)
        text += f" at fresh states too; the best there is {best.short}, {fresh}"
    elif row is None:
        text += ": no solver answers every state"
    elif row.error_worst <= error:
        text = f"{row.short} meets {row.measure} to {error:g} on {row.scene!r}, but has no time "
        return NotReached(f"{text}({row.timed}); run the study with timed=True", row)
    else:
        text += f"; the best is {row.short} with {row.error_worst:.1e}"
    return NotReached(f"{text}; ask for less, or try more parameters", row)


# Plan: a solver that was chosen by measurement, kept for the machine that it was measured on.
#
# A plan is a small json file. Its name says for what it holds: scene, measure and error, processor,
# and the versions of this library, of Pinocchio and of numpy. Whoever changes one of them finds no
# plan, and is told so; a plan of another machine is never used.


_FITS: Final = ("processor", "system", "pinocchio", "condyn_pin", "numpy")


@dataclass(frozen=True)
class Plan(Record):
    """A solver chosen by a study, kept for one machine.

    Attributes
    ----------
    fingerprint : str
        Of the scene.
    measure : str
    error : float
        Required error, relative.
    solver : str
        Class of the solver.
    parameters : dict
        Its parameters by name.
    median_us : float
        Median time [us].
    found, expected : float
        The worst error at the fresh states, and the expected one over a hundred times as many.
    states : int
        Number of fresh states.
    where : dict of str to str
        Processor, system and versions.
    date : str
    """

    unknown: ClassVar[float | None] = None  # every number is known

    fingerprint: str
    measure: str
    error: float
    solver: str
    parameters: dict[str, Any]
    median_us: float
    found: float
    expected: float
    states: int
    where: dict[str, str]
    date: str


def fingerprint(scene: Scene) -> str:
    """Return the hash of a scene's content, 64 hexadecimal digits, equal in every process.

    sha256 of the model as Pinocchio writes it, the constraints, the motors, the springs and the
    nominal posture: all on which accelerations, motions and drawn states depend. It costs 1 ms.
    """
    robot = scene.robot
    robot.check_unedited()
    nominal = np.ascontiguousarray(described_posture(scene), dtype="<f8")
    named: tuple[object, ...] = (scene.constraints, tuple(robot.actuated), robot.springs)
    if robot.spring_dampers:  # those of scenes without stay as they were
        named += (robot.spring_dampers,)
    if robot.coupled_motors:
        named += (robot.coupled_motors,)
    if scene.contacts:
        named += (scene.contacts,)
    parts = (robot.model.saveToString(), *map(repr, named))
    digest = hashlib.sha256()
    for part in (*(text.encode() for text in parts), nominal.tobytes()):
        digest.update(len(part).to_bytes(8, "little"))  # so that parts cannot run together
        digest.update(part)
    return digest.hexdigest()


def this_machine() -> dict[str, str]:
    """Return the processor, system and versions for which a plan of this machine is valid."""
    found = machine()
    return {key: found[key] for key in _FITS}


def folder() -> Path:
    """Return the folder of plans: in the user's cache, ``$XDG_CACHE_HOME`` where that is set."""
    home = Path.home()
    if os.environ.get("XDG_CACHE_HOME"):
        cache = Path(os.environ["XDG_CACHE_HOME"])
    elif sys.platform == "darwin":
        cache = home / "Library" / "Caches"
    elif sys.platform == "win32":
        cache = Path(os.environ.get("LOCALAPPDATA", home / "AppData" / "Local"))
    else:
        cache = home / ".cache"
    return cache / "condyn_pin" / "plans"


def path_of(fingerprint: str, measure: str, error: float) -> Path:
    """Return the path of a plan for this machine; the file need not exist."""
    key = json.dumps([measure, float(error), this_machine()])
    return folder() / fingerprint[:32] / f"{hashlib.sha256(key.encode()).hexdigest()[:32]}.json"


def write_plan(plan: Plan) -> None:
    """Write the file of a plan atomically: another process reads the old one or the new one."""
    path = path_of(plan.fingerprint, plan.measure, plan.error)
    text = json.dumps({"format": FORMAT} | plan.as_dict(), indent=1, allow_nan=False)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_text(path, text + "\n")
    except OSError as error:
        raise _no_place(f"{path.parent}: cannot be made: {error.strerror}") from error
    except InvalidArgument as error:
        raise _no_place(str(error)) from error


def check_folder() -> None:
    """Raise InvalidArgument if no plan could be written, before a study of half a minute."""
    there = next(path for path in (folder(), *folder().parents) if path.exists())
    try:
        check_writable(there / "plan.json")
    except InvalidArgument as error:
        raise _no_place(str(error)) from error


def _no_place(why: str) -> InvalidArgument:
    return InvalidArgument(
        f"the plan cannot be saved: {why}; set XDG_CACHE_HOME to a folder that can be written to, "
        "or pass save=False"
    )


def read_plan(path: Path) -> Plan:
    """Return the plan in a file; InvalidArgument if it is cut off, edited, or of another format."""
    try:
        saved = parse_json(read_text(path))
        if saved.pop("format") != FORMAT:
            raise ValueError("another format")
        return Plan.from_dict(saved)
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise InvalidArgument(f"{path}: not a plan ({error})") from error


def plans_of(fingerprint: str) -> tuple[Plan, ...]:
    """Return the plans that exist for a scene, of every machine; broken files are left out."""
    found = []
    for path in sorted((folder() / fingerprint[:32]).glob("*.json")):
        try:
            found.append(read_plan(path))
        except InvalidArgument:
            continue
    return tuple(found)
