"""Tables of measurements: rows of one kind, the machine they were taken on, and their files.

A table goes into csv, json and Markdown, and comes back from json. Tables of studies, of the bench
and of hierarchies are this one with rows of their own, and columns for people.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import MISSING, dataclass, field, fields
from math import inf, isfinite, nan
from pathlib import Path
from typing import Any, ClassVar, Final, Generic, Protocol, Self, TypeVar

from condyn_pin._core import show
from condyn_pin._core.arguments import Grid, renamed
from condyn_pin._core.files import atomic_write, parse_json, read_text, write_text
from condyn_pin._core.show import require_pandas
from condyn_pin._core.timing import machine
from condyn_pin.contact.solvers import CONTACT_SOLVERS
from condyn_pin.dynamics.solvers import SOLVERS
from condyn_pin.errors import InvalidArgument
from condyn_pin.gradients.routes import ROUTES

FORMAT: Final = 1  # of the json file; one more whenever a field changes its meaning

_PLAIN: Final = (float, int, str, bool, type(None))


class Record:
    """A frozen dataclass of plain values that goes into json, and is checked when it comes back.

    Numbers are not negative. Json has neither infinity nor NaN, and says null; `unknown` is what
    null stands for where a number is needed.
    """

    unknown: ClassVar[float | None] = nan

    def as_dict(self) -> dict[str, Any]:
        """Return the fields as plain values for json; numbers that are not finite are None."""
        values = ((f.name, getattr(self, f.name)) for f in fields(self))  # type: ignore[arg-type]
        return {n: None if isinstance(x, float) and not isfinite(x) else x for n, x in values}

    def in_words(self) -> dict[str, Any]:
        """Return the fields as values for csv."""
        return dict(vars(self))

    @classmethod
    def from_dict(cls, saved: Mapping[str, Any]) -> Self:
        """Return the record of fields `saved` by `as_dict`.

        Raises
        ------
        InvalidArgument
            If a field is missing or unknown, or a value has the wrong type.
        """
        known = {f.name: f for f in fields(cls)}  # type: ignore[arg-type]
        needed = {n for n, f in known.items() if f.default is f.default_factory is MISSING}
        if not isinstance(saved, Mapping) or not needed <= set(saved) <= set(known):
            odd = sorted(needed - set(saved) | set(saved) - set(known))
            raise InvalidArgument(f"missing, or not a field of a {cls.__name__}: {', '.join(odd)}")
        for name, value in saved.items():
            if wanted := _needed_type(str(known[name].type), value, cls.unknown is not None):
                raise InvalidArgument(f"{name} = {value!r}: {wanted} needed")
        nulls = {n for n, value in saved.items() if value is None and known[n].type == "float"}
        return cls(**{**saved, **dict.fromkeys(nulls, cls.unknown)})


def _needed_type(kind: str, value: Any, takes_null: bool) -> str:
    """Type that a field of a kind needs instead of a value, as text; empty if the value fits."""
    if kind in ("str", "int"):
        return "" if type(value).__name__ == kind else f"{kind} is"
    if kind.startswith("dict"):
        kinds = (int,) if kind == "dict[str, int]" else _PLAIN
        is_table = isinstance(value, Mapping) and all(isinstance(x, kinds) for x in value.values())
        return "" if is_table else "values by name are"
    if value is None and takes_null:
        return ""
    is_number = isinstance(value, int | float) and 0 <= value < inf
    return "" if is_number else "a number from 0, or null, is"


AnyRow = TypeVar("AnyRow", bound=Record)
Columns = tuple[tuple[str, Callable[[AnyRow], str]], ...]


@dataclass(frozen=True)
class Measurements(Generic[AnyRow]):
    """Rows, and the machine that they were measured on.

    A subclass sets the type of its rows (`kind`), the printed columns, each a heading and a
    function of a row to text, and the fields that go into files beside the rows (`parts`).

    Attributes
    ----------
    rows : tuple of Record
    machine : dict of str to str
        Processor, system, versions and date.
    """

    kind: ClassVar[type[Record]]
    columns: ClassVar[Columns[Any]]
    parts: ClassVar[tuple[str, ...]] = ("machine",)

    rows: tuple[AnyRow, ...]
    machine: dict[str, str] = field(default_factory=machine)

    def to_csv(self, path: str | Path) -> None:
        """Write the rows, after comment lines with the other `parts` and the machine."""
        columns = [f.name for f in fields(self.kind)]  # type: ignore[arg-type]
        parts = {name: getattr(self, name) for name in self.parts}
        about = {name: str(part) for name, part in parts.items() if not isinstance(part, Mapping)}
        write_csv(path, about | self.machine, columns, (row.in_words() for row in self.rows))

    def to_json(self, path: str | Path) -> None:
        """Write the rows, a line each, and the other `parts`; unmeasured values are null."""
        parts = self.as_dict()
        rows = ",\n".join(json.dumps(row, allow_nan=False) for row in parts.pop("rows"))
        head = json.dumps(parts, indent=1, allow_nan=False).removesuffix("\n}")
        write_text(path, f'{head},\n "rows": [\n{rows}\n]}}\n')

    def as_dict(self) -> dict[str, Any]:
        """Return the content of the file of `to_json`, as plain values."""
        parts = {name: getattr(self, name) for name in self.parts}
        return {"format": FORMAT, **parts, "rows": [row.as_dict() for row in self.rows]}

    @classmethod
    def from_json(cls, path: str | Path) -> Self:
        """Return the table that `to_json` wrote.

        Raises
        ------
        InvalidArgument
            If the file is not one, or of another version of the format.
        """
        try:
            return cls.from_dict(parse_json(read_text(path)))
        except (OSError, LookupError, TypeError, ValueError) as error:
            raise InvalidArgument(
                f"{path}: not a table that {cls.__name__}.to_json wrote ({error}); measure it again"
            ) from error

    @classmethod
    def from_dict(cls, saved: Mapping[str, Any]) -> Self:
        """Return the table of plain values `saved` by `as_dict`."""
        if saved["format"] != FORMAT:
            raise ValueError(f"its format is {saved['format']!r}, and {FORMAT} is known here")
        rows: Any = tuple(map(cls.kind.from_dict, saved["rows"]))
        return cls(rows=rows, **{name: saved[name] for name in cls.parts})

    def cells(self) -> list[tuple[str, ...]]:
        """Return the rows as text, the headings being those of `columns`."""
        return [tuple(cell(row) for _, cell in self.columns) for row in self.rows]

    def to_markdown(self) -> str:
        """Return the rows as a table in Markdown."""
        return markdown([heading for heading, _ in self.columns], self.cells())

    def to_pandas(self) -> Any:
        """Return the rows as a `pandas.DataFrame`, a column a field; `attrs` has the machine.

        Raises
        ------
        MissingExtra
            If pandas is not installed.
        """
        columns = [f.name for f in fields(self.kind)]  # type: ignore[arg-type]
        frame = require_pandas().DataFrame([row.in_words() for row in self.rows], columns=columns)
        frame.attrs["machine"] = dict(self.machine)
        return frame

    def _repr_html_(self) -> str:
        """HTML table of the rows for a notebook, with the machine folded."""
        return show.page(
            f"{type(self).__name__} of {len(self)} rows",
            show.grid([heading for heading, _ in self.columns], self.cells()),
            show.folded_html("measured on", show.facts(self.machine.items())),
        )

    def __len__(self) -> int:
        return len(self.rows)

    def __bool__(self) -> bool:
        return True

    def __str__(self) -> str:
        return self.to_markdown()


def number(value: float | None, form: str) -> str:
    """Return a number as text; empty for None and NaN."""
    return "" if value is None or value != value else format(value, form)


def write_csv(
    path: str | Path,
    machine: Mapping[str, str],
    columns: Sequence[str],
    rows: Iterable[Mapping[str, Any]],
) -> None:
    """Write rows, after comment lines with the machine."""
    with atomic_write(path) as new, new.open("w", newline="", encoding="utf-8") as file:
        for key, value in machine.items():
            file.write(f"# {key}: {value}\n")
        writer = csv.DictWriter(file, columns)
        writer.writeheader()
        writer.writerows(rows)


def markdown(columns: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return rows of text as a table in Markdown."""
    lines = ["| " + " | ".join(columns) + " |", "|" + "---|" * len(columns)]
    return "\n".join([*lines, *("| " + " | ".join(cells) + " |" for cells in rows)])


# Method: what a study measures, a frozen value whose fields are its parameters.
#
# Solvers of `SOLVERS`, contact solvers of `CONTACT_SOLVERS`, routes of `ROUTES`: each measure has
# one of these registries.


class Method(Protocol):
    """A solver, a contact solver, or a route to derivatives through contact."""

    title: ClassVar[str]  # what tables show
    sweeps: ClassVar[tuple[Grid, ...]]  # values of parameters that are worth a look


Methods = Mapping[str, type[Method]]  # a registry


def method_named(name: str) -> type[Method] | None:
    """Return the class of a name in any registry; None if there is none."""
    lower = name.lower()
    known: Methods = {**SOLVERS, **CONTACT_SOLVERS, **ROUTES}
    return known.get(lower)


def usual_parameters(kind: type[Method]) -> dict[str, Any]:
    """Return the parameters of a class with their defaults, but for the accuracy."""
    return {f.name: f.default for f in fields(kind) if f.name != "accuracy"}  # type: ignore[arg-type]


# Row: one solver with its parameters on one set of states, its time beside its error.


Parameter = float | int | str | bool | None
Key = tuple[str, str, str, str, str]

# What a row with times says of them.
ALONE: Final = "timed alone on its core"

# Answers that are what they say: an inaccurate one says by how much it is.
ANSWERED: Final = {"ok", "inaccurate"}


@dataclass(frozen=True)
class Row(Record):
    """Time and error of one solver with its parameters on one set of states.

    Attributes
    ----------
    scene : str
        Label of the scene.
    rows, nv : int
        Rows of constraints and contacts, and columns.
    method : str
        Title of the solver.
    solver : str
        The solver as text, with every parameter.
    parameters : dict of str to float, int, str, bool or None
        Its parameters by name; None where the solver chooses by itself.
    measure : str
        Quantity of the error: a name of `MEASURES`, with the parameters that change the question.
        Rows of the same scene and measure can be compared.
    states : str
        Name of the set of states.
    n : int
        Number of states in it.
    error_median, error_worst : float
        Over the states, relative: of the accelerations, to the larger of |a|_inf and gravity.
        Infinite where there is no finite answer.
    dynamics_error, constraint_error : float
        Worst residuals [N, N m] and [m/s^2, rad/s^2]; infinite where there is no answer.
    iterations : int
        The most at any state.
    statuses : dict of str to int
        Counts of states by status; "refused" where the solver does not support the scene.
    build_us : float or None
        To build a workspace [us].
    median_us, p95_us : float or None
        What the measure calls, once [us]: for accelerations `Workspace.acceleration`.
    bare_us, solve_us : float or None
        Pinocchio's own call behind it, unguarded, and `Workspace.solve` with its proof [us].
    timed : str
        Remark on the timing, or the reason why there are no times.
    note : str
        Text of a refusal.
    how : dict of str to float, int, str, bool or None
        Parameters of the measure that belong to the answer, such as the step of an integrator.
    """

    unknown: ClassVar[float | None] = inf  # the larger an error, the worse, without end

    scene: str
    rows: int
    nv: int
    method: str
    solver: str
    parameters: dict[str, Parameter]
    measure: str
    states: str
    n: int
    error_median: float
    error_worst: float
    dynamics_error: float  # [N, N m]
    constraint_error: float  # [m/s^2, rad/s^2]
    iterations: int
    statuses: dict[str, int]
    build_us: float | None = None
    median_us: float | None = None
    p95_us: float | None = None
    bare_us: float | None = None
    solve_us: float | None = None
    timed: str = "not timed"
    note: str = ""
    how: dict[str, Parameter] = field(default_factory=dict)

    knobs = renamed("parameters")

    @property
    def key(self) -> Key:
        """Identity of the row: scene, solver, measure, how and states."""
        return key(self.scene, self.solver, self.measure, self.how, self.states)

    def in_words(self) -> dict[str, Any]:
        """Return the fields as values for csv: parameters as in a call, statuses as counts."""
        words = {"parameters": words_of(self.parameters), "how": words_of(self.how)}
        return super().in_words() | words | {"statuses": self.said}

    @property
    def ok(self) -> bool:
        """True if the status is ok at every state."""
        return set(self.statuses) == {"ok"}

    @property
    def answered(self) -> bool:
        """True if every state has an answer with a finite error."""
        return bool(self.statuses) and set(self.statuses) <= ANSWERED and isfinite(self.error_worst)

    @property
    def comparable(self) -> bool:
        """True if the row has a time, and a finite error at every state."""
        return self.median_us is not None and self.answered

    @property
    def us(self) -> float:
        """The median time of a row that was timed [us]."""
        assert self.median_us is not None
        return self.median_us

    @property
    def short(self) -> str:
        """The solver as a call with its non-default parameters, and those of `how`."""
        name = self.solver.split("(")[0]
        kind = method_named(name)
        usual = {} if kind is None else usual_parameters(kind)
        chosen = {k: value for k, value in self.parameters.items() if value != usual.get(k)}
        how = f", {words_of(self.how)}" if self.how else ""
        return f"{name}({words_of(chosen)}){how}"

    @property
    def said(self) -> str:
        """Counts of states by status, as text: ``18 ok, 2 singular``."""
        return ", ".join(f"{count} {status}" for status, count in sorted(self.statuses.items()))


def key(scene: str, solver: str, measure: str, how: Mapping[str, Parameter], states: str) -> Key:
    """Return the identity of a row: scene, solver, measure, how as in a call, and states."""
    return scene, solver, measure, words_of(how), states


def words_of(parameters: Mapping[str, Any]) -> str:
    """Return parameters as they stand in a call."""
    return ", ".join(f"{name}={value!r}" for name, value in parameters.items())


def pareto_front(rows: Sequence[Row]) -> tuple[Row, ...]:
    """Return the rows that no other is faster than with at most the same error, fastest first."""
    # Rows of different scenes or measures do not compare: hand in those of one.
    kept: list[Row] = []
    timed = (row for row in rows if row.comparable)
    for row in sorted(timed, key=lambda r: (r.us, r.error_worst)):
        if not kept or row.error_worst < kept[-1].error_worst:
            kept.append(row)
    return tuple(kept)
