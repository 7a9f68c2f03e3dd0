"""Table: the rows of a study, and the answers that are in them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar

from condyn_pin._core.tolerances import SOLVED
from condyn_pin.dynamics.scene import Scene
from condyn_pin.errors import InvalidArgument, unknown_name
from condyn_pin.study.cheapest import Choice, check_error, choose
from condyn_pin.study.comparison import Comparison, compare
from condyn_pin.study.row import Row, pareto_front
from condyn_pin.study.states import States
from condyn_pin.study.tables import Columns, Measurements, number


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
        """Return the table with the scenes of its labels, for one that comes from a file."""
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
        """Return what changed since an `old` table, row by row, and what became worse.

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
