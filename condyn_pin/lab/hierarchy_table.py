"""HierarchyTable: the models of a hierarchy with their speed and their price; printed and drawn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from math import isfinite, log10
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Final

from condyn_pin._core import tolerances
from condyn_pin.study.tables import Columns, Measurements, Record, markdown

if TYPE_CHECKING:
    from rich.console import Console

_FLOOR: Final = 1e-6  # where exact models are drawn


@dataclass(frozen=True)
class HierarchyRow(Record):
    """One model; NaN where no solver said ok at every state.

    Attributes
    ----------
    label, why : str
    nv, rows, rank, mobility : int
    solver : str
        The fastest that says ok at every state.
    us : float
        `Workspace.acceleration` with it, median [us].
    speedup : float
        Times faster than the first model, median of ratios within a round.
    a_worst, a_median : float
        Error of the accelerations of floating base and motors against the first model, relative to
        the larger of |a| and gravity.
    force_worst, force_median : float
        Error of the wrench of all contacts, relative to the larger of it and the weight.
    a_step, force_step : float
        The worst errors against the model above: the price of this step alone.
    slower_as : str
        Why it is slower than a model above, if the solver of that one cannot take it; empty if not.
    """

    label: str
    why: str
    nv: int
    rows: int
    rank: int
    mobility: int
    solver: str
    us: float
    speedup: float
    a_worst: float
    a_median: float
    force_worst: float
    force_median: float
    a_step: float
    force_step: float
    slower_as: str = ""


@dataclass(frozen=True)
class HierarchyTable(Measurements[HierarchyRow]):
    """The models of one hierarchy, the states that they were compared at, and the machine.

    Attributes
    ----------
    rows : tuple of HierarchyRow
        The first model, and those below it.
    machine : dict of str to str
    name : str
        Of the hierarchy.
    states : int
        How many motions they were compared at.
    """

    kind: ClassVar[type[HierarchyRow]] = HierarchyRow
    parts: ClassVar[tuple[str, ...]] = ("name", "states", "machine")
    columns: ClassVar[Columns[HierarchyRow]] = (
        ("model", lambda row: row.label),
        ("nv", lambda row: str(row.nv)),
        ("rows", lambda row: f"{row.rows}, rank {row.rank}"),
        ("solver", lambda row: row.solver + (f"; {row.slower_as}" if row.slower_as else "")),
        ("a [us]", lambda row: f"{row.us:.1f}"),
        ("x faster", lambda row: f"{row.speedup:.2f}"),
        ("error of a: all / this step", lambda row: _share(row.a_worst, row.a_step)),
        (
            "of contact wrench: all / this step",
            lambda row: _share(row.force_worst, row.force_step),
        ),
    )

    name: str = ""
    states: int = 0

    def fastest(self, error: float) -> HierarchyRow:
        """Return the fastest model whose errors all stay below `error`."""
        good = [r for r in self.rows if max(r.a_worst, r.force_worst) <= error]
        return max(good, key=lambda row: row.speedup if isfinite(row.speedup) else 0.0)

    def to_markdown(self) -> str:
        """Return the rows as a table in Markdown, under the name of the hierarchy."""
        headings = [heading for heading, _ in self.columns]
        return markdown((self.name, *headings[1:]), self.cells())


def _share(*errors: float) -> str:
    return " / ".join(f"{100 * e:.2g} %" if e >= tolerances.EXACT else "0" for e in errors)


def print_hierarchy(table: HierarchyTable, console: Console) -> None:
    """Print what every model costs and saves, and why it is there."""
    from condyn_pin.study.printing import print_columns

    print_columns(table, console, left=[heading for heading, _ in table.columns])
    for row in table.rows:
        console.print(f"{row.label}: {row.why}", soft_wrap=True)
    console.print(
        f"worst of {table.states} motions on both feet, against the first model / the model above",
        soft_wrap=True,
    )


def draw_hierarchy(table: HierarchyTable, ax: Any = None) -> Any:
    """Draw the worst error of a against the speed of every model: down and to the right is better.

    On `ax` or new axes, which are returned.
    """
    from condyn_pin._core.show import METHODS, OTHER, axes, finished

    ax = axes(ax)
    rows = [row for row in table.rows if isfinite(row.speedup)]
    points = [(row.speedup, max(row.a_worst, _FLOOR)) for row in rows]
    end = 1.15 * max(speed for speed, _ in points)
    ax.plot(*zip(*points, strict=True), color="0.8", lw=0.8, zorder=0)
    drawn: set[str] = set()
    upwards = sorted(points, key=lambda point: (round(log10(point[1]), 1), point[0]))
    for row, point in zip(rows, points, strict=True):
        colour, marker = METHODS.get(row.solver, OTHER)
        label = "" if row.solver in drawn else row.solver
        drawn.add(row.solver)
        ax.plot(*point, marker, color=colour, ms=7, label=label)
        # below and above in turn, and towards the middle: neighbours do not overlap
        above, left = upwards.index(point) % 2 == 1, point[0] > end / 2
        ax.annotate(
            f"{row.label}\nnv {row.nv}, {row.rows} rows", point, textcoords="offset points",
            xytext=(-8 if left else 8, 5 if above else -5), fontsize=7,
            ha="right" if left else "left", va="bottom" if above else "top",
        )  # fmt: skip
    ax.set(xlim=(0.0, end), yscale="log", ylim=(_FLOOR / 10, 10.0))
    error = "worst error of a, 0 drawn at 1e-6"
    return finished(ax, title=table.name, x="times faster than the first model", y=error)


def save_hierarchies(tables: Sequence[HierarchyTable], path: str | Path) -> None:
    """Draw hierarchies side by side into a file; the ending of `path` says which format."""
    from condyn_pin.study.plots import save_panels

    draw = [partial(draw_hierarchy, table) for table in tables]
    note, machine = "{processor}, Pinocchio {pinocchio}", tables[0].machine
    save_panels(
        draw, path, size=(4.8, 4.0), columns=len(draw), note=note, machine=machine, one_legend=True
    )
