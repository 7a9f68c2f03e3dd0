"""Table: the rows of a study, its Pareto front and its cheapest solver."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import inf
from pathlib import Path
from statistics import median
from typing import Any, ClassVar, Final

from condyn_pin._core.tolerances import SOLVED
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import InvalidArgument, unknown_name
from condyn_pin.study.fresh import Choice, check_error, choose
from condyn_pin.study.states import States
from condyn_pin.study.tables import Columns, Measurements, Row, number, pareto_front


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
