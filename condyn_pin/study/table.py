"""Table: the rows of a study, its Pareto front and its cheapest solver, and how tables print."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import inf
from pathlib import Path
from statistics import median
from typing import Any, ClassVar, Final

from rich.console import Console
from rich.table import Table as Grid

from condyn_pin._core.show import print_whole
from condyn_pin._core.tolerances import SOLVED
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import InvalidArgument, unknown_name
from condyn_pin.study.bench import BenchRow, BenchTable
from condyn_pin.study.fresh import Choice, check_error, choose
from condyn_pin.study.states import States
from condyn_pin.study.tables import ALONE, Columns, Measurements, Row, number, pareto_front


def print_columns(
    table: Measurements[Any],
    console: Console,
    *,
    title: str | None = None,
    left: Collection[str] = (),
    without: Collection[str] = (),
) -> None:
    """Print the columns of a table, those in `left` flushed left."""
    shown = Grid(title=title, title_justify="left")
    columns = [column for column in table.columns if column[0] not in without]
    for heading, _ in columns:
        shown.add_column(heading, justify="left" if heading in left else "right")
    for row in table.rows:
        shown.add_row(*(cell(row) for _, cell in columns))
    print_whole(shown, console)


def print_table(table: Table, console: Console) -> None:
    """Print the Pareto-optimal rows, and the solvers that failed at a state."""
    for scene, measure in dict.fromkeys((row.scene, row.measure) for row in table.rows):
        asked = table.of(scene=scene, measure=measure)
        best = asked.pareto()
        title = f"{scene}, {measure}: {len(best)} of {len(asked)} rows that no other beats"
        without = ("scene", "measure")  # in the title
        print_columns(best, console, title=title, left=("solver",), without=without)
        for text in failures(asked.rows):
            console.print(text, soft_wrap=True)
    if table.rows:
        console.print(
            "error: median and worst over the states, relative. Times: median and p95 of what the "
            f"measure calls. {timing_sentence(table)}\n{table.machine.get('processor')}, "
            f"Pinocchio {table.machine.get('pinocchio')}, one thread.",
            highlight=False,
            soft_wrap=True,
        )


def timing_sentence(table: Table) -> str:
    """Return the count of times taken on a core of its own, as a sentence."""
    rows = [row for row in table.rows if row.median_us is not None]
    alone = sum(row.timed == ALONE for row in rows)
    return f"{alone} of {len(rows)} times were taken on a core that nothing else used."


def failures(rows: tuple[Row, ...]) -> list[str]:
    """Return the solvers that failed at a state, with counts by status, a line each."""
    failed = [row for row in rows if not row.answered]
    return [f"{r.short}: {r.said}{f' ({r.note})' if r.note else ''}" for r in failed]


def print_bench(table: BenchTable, console: Console) -> None:
    """Print a table of every scene, and the meaning of its columns."""
    for title, part in table.by_scene().items():
        print_columns(part.of_origin("python"), console, title=title, left=("method",))
        if in_cpp := part.of_origin("C++").rows:
            _print_in_cpp(part, in_cpp, console)
    machine = table.machine
    console.print(
        "bare: Pinocchio's call; a: Workspace.acceleration, median and p95; solve: with its errors "
        "[us].\nx dense: times faster than the fastest of dense KKT and the solvers by hand.\n"
        "by hand: Pinocchio's terms and another's solver, without guard or proof.\n"
        "error of a: worst over the states, relative to the larger of |a| and gravity.\n"
        f"{machine['processor']}, Pinocchio {machine['pinocchio']}, one thread.",
        highlight=False,
        markup=False,
        soft_wrap=True,
    )
    if "C++ compiler" in machine:
        console.print(
            "C++: all states in a call, without Python in between, time of one.\n"
            "x dense: against the fastest that is dense in C++.\n"
            f"{machine['C++ compiler']}, headers of {machine['C++ headers']}.",
            highlight=False,
            markup=False,
            soft_wrap=True,
        )


def _print_in_cpp(table: BenchTable, in_cpp: Sequence[BenchRow], console: Console) -> None:
    """Print the times in C++, one row per method, beside those in Python where they exist."""
    shown = Grid(title="in C++, and the same in Python", title_justify="left")
    for heading in ("method", "C++", "x dense", "error of a", "Python", "x dense", "error of a"):
        shown.add_column(heading, justify="left" if heading == "method" else "right")
    python = {row.method: row for row in table.rows if row.origin == "python"}
    for row in in_cpp:
        twin = python.get(row.method)
        cells = [number(row.bare_us, ".1f"), number(row.to_dense, ".2f"), number(row.error, ".0e")]
        if twin:
            us = twin.acceleration_us if twin.rows else twin.bare_us
            cells += [number(us, ".1f"), number(twin.to_dense, ".2f"), number(twin.error, ".0e")]
        shown.add_row(row.method, *cells)
    print_whole(shown, console)


@dataclass(frozen=True)
class Table(Measurements[Row]):
    """The measurements of a study.

    Attributes
    ----------
    rows : tuple of Row
    machine : dict of str to str
        Processor, system, versions and date.
    floors : dict of str to float
        By label of a scene, the error that `Reference` itself may have: rounding of M.
    scenes : dict of str to Scene
        By label, where fresh states come from. Files do not keep them.
    """

    kind: ClassVar[type[Row]] = Row
    parts: ClassVar[tuple[str, ...]] = ("machine", "floors")
    columns: ClassVar[Columns[Row]] = (
        ("scene", lambda row: f"{row.scene} ({row.rows} rows)"),
        ("solver", lambda row: row.short),
        ("measure", lambda row: row.measure),
        ("median [us]", lambda row: number(row.median_us, ".1f")),
        ("p95 [us]", lambda row: number(row.p95_us, ".1f")),
        ("error", lambda row: number(row.error_median, ".1e")),
        ("worst error", lambda row: number(row.error_worst, ".1e")),
        ("status", lambda row: row.said),
    )

    floors: dict[str, float] = field(default_factory=dict)
    scenes: Mapping[str, Scene] = field(default_factory=dict, compare=False, repr=False)

    def of(self, *, scene: str | None = None, measure: str | None = None) -> Table:
        """Return the table of one scene, of one measure, or of both.

        Raises
        ------
        UnknownName
            If there is no such scene or measure in the table.
        """
        for what, name in (("scene", scene), ("measure", measure)):
            known = list(dict.fromkeys(getattr(row, what) for row in self.rows))
            if name is not None and name not in known:
                raise unknown_name(f"{what} in this table", name, known)
        kept = (r for r in self.rows if scene in (None, r.scene) and measure in (None, r.measure))
        return replace(self, rows=tuple(kept))

    def with_scenes(self, scenes: Mapping[str, Scene]) -> Table:
        """Return the table with scenes for its labels, which a table from a file lacks."""
        return replace(self, scenes={**self.scenes, **scenes})

    def pareto(self) -> Table:
        """Return the rows that no other beats in time and worst error, of each scene and measure.

        Fastest first. Rows without a time, and solvers that failed at a state, are not among them.
        """
        questions = dict.fromkeys((row.scene, row.measure) for row in self.rows)
        kept = [
            row
            for question in questions
            for row in pareto_front([r for r in self.rows if (r.scene, r.measure) == question])
        ]
        return replace(self, rows=tuple(kept))

    def cheapest(
        self,
        error: float = SOLVED,
        *,
        measure: str = "acceleration",
        scene: str | None = None,
        states: States | int = 200,
    ) -> Choice:
        """Return the fastest solver that meets an error, at fresh states too.

        Parameters
        ----------
        error : float
            The worst that is good enough, relative, as in `Row.error_worst`.
        measure : str
            A name of `MEASURES` that the study took.
        scene : str, optional
            A label; the only one by default.
        states : States or int
            The fresh states that have to meet the error; a number is that many sampled ones. What
            is expected over a hundred times as many has to meet it as well
            (`condyn_pin.study.fresh`).

        Returns
        -------
        Choice
            The solver, its row, what the fresh states gave, and what they rejected.

        Raises
        ------
        NotReached
            If nothing in the table meets the error; the text and `row` say what comes nearest.
        InvalidArgument
            If the scene is not in `scenes`, or there are several and none is named, or the states
            are those of the study, or some of them.
        """
        check_error(error)
        labels = list(dict.fromkeys(row.scene for row in self.rows))
        if scene is None and len(labels) != 1:
            raise InvalidArgument(f"scene: this table has {len(labels)}, name one: {labels}")
        label = labels[0] if scene is None else scene
        asked = self.of(scene=label).of(measure=measure)
        return choose(asked.rows, self.scenes.get(label), error, states)

    def compare(self, old: Table) -> Comparison:
        """Return the changes since an `old` table, row by row, with those for the worse.

        Raises
        ------
        InvalidArgument
            If `old` is no table.
        """
        if not isinstance(old, Table):
            raise InvalidArgument(f"old = {type(old).__name__}: a Table is needed, of from_json")
        return compare(self, old)

    def plot(self, scene: str | None = None, measure: str | None = None, ax: Any = None) -> Any:
        """Draw error against time, a line a method, on `ax` or new axes, and return them.

        `scene` is a label and `measure` a name, where the table has several;
        `condyn_pin.study.plots` says what is drawn.
        """
        from condyn_pin.study.plots import work_precision

        return work_precision(self, scene, measure, ax)

    @classmethod
    def from_json(cls, path: str | Path, scenes: Mapping[str, Scene] | None = None) -> Table:
        """Return the table that `to_json` wrote.

        `scenes` are those of the table by label, where it is to choose among solvers again.

        Raises
        ------
        InvalidArgument
            If the file is not one, or of another version of the format.
        """
        return super().from_json(path).with_scenes(scenes or {})


# Comparison: two tables of the same questions, row by row, and what became worse.
#
# Times of two runs are of two moods of a machine. What all rows have in common is taken out first:
#
#     slower_i = (new_i / old_i) / common,      common = median over rows of new / old
#
# and a row is worse only beyond what its own samples spread: p95 over median, of both runs.


# Errors are the same to the bit on one build; another Pinocchio rounds otherwise, and the worst of
# twenty states moves by half. Below the floor they are rounding, and nobody's fault.
_ERROR_RATIO: Final = 2.0
_ERROR_FLOOR: Final = 1e-13

# A row whose samples do not spread at all still moves by some per cent with the layout of memory.
_LEAST_SPREAD: Final = 1.1

# Fewer rows have no common share that is not their own.
_ROWS_FOR_COMMON: Final = 4


@dataclass(frozen=True)
class RowChange:
    """A row in two tables: the ratios of its times and errors."""

    old: Row
    new: Row
    # time over that of before, divided by `Comparison.common`; None without times
    slower: float | None
    spread: float  # factor within which `slower` is noise: p95 over median, the larger of both runs
    error: float  # worst error over that of before

    @property
    def worse(self) -> tuple[str, ...]:
        """Regressions in time, error or status, a phrase each; empty if there is none."""
        found = []
        if self.slower is not None and self.slower > self.spread:
            found.append(f"{self.slower:.2f} times slower (spread {self.spread:.2f})")
        if self.error > _ERROR_RATIO and self.new.error_worst > _ERROR_FLOOR:
            found.append(
                f"worst error {self.new.error_worst:.1e}, {self.error:.3g} times that of before"
            )
        if self.old.answered and not self.new.answered:
            found.append(f"statuses {self.new.statuses}, before {self.old.statuses}")
        elif (
            self.new.statuses.get("ok", 0) * self.old.n
            < self.old.statuses.get("ok", 0) * self.new.n
        ):
            found.append(f"fewer say ok: {self.new.statuses}, before {self.old.statuses}")
        return tuple(found)

    def __str__(self) -> str:
        time = "not timed" if self.slower is None else f"{self.slower:.2f} of the time"
        said = "; ".join(self.worse) or f"{time}, {self.error:.3g} of the error"
        return f"{self.new.scene}, {self.new.short}, {self.new.measure}: {said}"


@dataclass(frozen=True)
class Comparison:
    """Two tables compared row by row.

    Attributes
    ----------
    changes : tuple of RowChange
        Rows that both tables have.
    common : float
        Median ratio of the times, new over old: the load of the machine, or a change that slows
        all rows. 1 where fewer than four rows have times in both.
    missing, added : tuple of Row
        Rows of the old table only, and of the new one only.
    machines : tuple of str
        Differences between the machines, a phrase each.
    """

    changes: tuple[RowChange, ...]
    common: float
    missing: tuple[Row, ...]
    added: tuple[Row, ...]
    machines: tuple[str, ...]

    @property
    def worse(self) -> tuple[RowChange, ...]:
        """The rows that became worse."""
        return tuple(change for change in self.changes if change.worse)

    @property
    def ok(self) -> bool:
        """True if no row became worse and none is missing."""
        return not self.worse and not self.missing

    def __str__(self) -> str:
        lines = [
            f"{len(self.changes)} rows in both, {len(self.worse)} worse, {len(self.missing)} "
            f"missing, {len(self.added)} new; all together take {self.common:.2f} of the time"
        ]
        lines += [f"differs: {text}" for text in self.machines]
        lines += [f"worse: {change}" for change in self.worse]
        lines += [f"missing: {row.scene}, {row.short}, {row.measure}" for row in self.missing]
        return "\n".join(lines)


def compare(new: Table, old: Table) -> Comparison:
    """Return the changes between two tables; see `Table.compare`."""
    before = {row.key: row for row in old.rows}
    pairs = [(before[row.key], row) for row in new.rows if row.key in before]
    ratios = [
        now.median_us / then.median_us for then, now in pairs if then.median_us and now.median_us
    ]
    common = median(ratios) if len(ratios) >= _ROWS_FOR_COMMON else 1.0
    keys = {row.key for row in new.rows}
    return Comparison(
        changes=tuple(_change(then, now, common) for then, now in pairs),
        common=common,
        missing=tuple(row for row in old.rows if row.key not in keys),
        added=tuple(row for row in new.rows if row.key not in before),
        machines=tuple(
            f"{key}: {new.machine.get(key)}, before {old.machine.get(key)}"
            for key in dict.fromkeys((*new.machine, *old.machine))
            if key != "date" and new.machine.get(key) != old.machine.get(key)
        ),
    )


def _change(old: Row, new: Row, common: float) -> RowChange:
    slower = None
    if old.median_us and new.median_us:
        slower = new.median_us / old.median_us / common
    if new.error_worst == old.error_worst:  # infinite ones as well
        error = 1.0
    else:
        error = new.error_worst / old.error_worst if old.error_worst else inf
    return RowChange(old, new, slower, max(_spread(old), _spread(new)), error)


def _spread(row: Row) -> float:
    if not row.median_us or row.p95_us is None:
        return _LEAST_SPREAD
    return max(row.p95_us / row.median_us, _LEAST_SPREAD)
