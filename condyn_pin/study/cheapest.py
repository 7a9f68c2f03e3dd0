"""cheapest: the fastest solver of a table that meets an error, where it was not chosen too."""

from __future__ import annotations

import ast
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import lru_cache
from typing import Any, Final

from condyn_pin._core.arguments import read_call
from condyn_pin._core.arrays import finite
from condyn_pin._core.tolerances import SOLVED
from condyn_pin.dynamics.scene import Scene
from condyn_pin.dynamics.solvers import SOLVERS
from condyn_pin.errors import CondynError, InvalidArgument, NotReached, unknown_name
from condyn_pin.study.fresh import Fresh, FreshErrors, as_fresh
from condyn_pin.study.measures import MEASURES, Measure
from condyn_pin.study.measures.trajectory import SCHEMES
from condyn_pin.study.method import Method, method_named, with_accuracy
from condyn_pin.study.row import Parameter, Row
from condyn_pin.study.states import States

# Several errors are asked of one table after the other: the states and the truth stay the same.
_fresh_errors = lru_cache(maxsize=1)(FreshErrors)

_LONGEST: Final = 1000  # characters of a tuple as text


@dataclass(frozen=True)
class Choice:
    """A solver chosen by measurement.

    Attributes
    ----------
    solver : Solver, or what the measure asks
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
    """Return a solver that says ok to an error that it was chosen for."""
    return with_accuracy(solver, max(error, SOLVED))


def solver_of(row: Row) -> Method:
    """Return the solver of a row, with its parameters."""
    solver = made(row.solver.split("(")[0], row.parameters)
    if repr(solver) != row.solver:
        raise InvalidArgument(
            f"{row.solver}: with its parameters it is {solver!r}; run the study again"
        )
    return solver


def made(name: str, parameters: Mapping[str, Parameter]) -> Method:
    """Return the solver of a class with parameters as rows keep them: a tuple as text."""
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
    """Return the measure that tables call so: a name, with the parameters that are not as usual."""
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
