"""Work-precision diagrams: error against time, a line a method, down and to the left is better."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from condyn_pin._core.plot_style import COLOURS, write_figure
from condyn_pin._core.plots import axes, panels
from condyn_pin._core.tolerances import SOLVED
from condyn_pin.dynamics.solvers import SOLVERS
from condyn_pin.errors import InvalidArgument
from condyn_pin.study.pareto_front import ANSWERED, answered, comparable, microseconds, pareto_front
from condyn_pin.study.row import Row

if TYPE_CHECKING:
    from condyn_pin.study.table import Table

# As many markers as may be, and another number of lines, tell the methods apart without colour.
_MARKERS = ("s", "o", "^", "d", "v", "P", "X", "<", ">", "p", "h")
_LINES = ("-", "--", "-.")
_FIRST = ("proximal", "lcaba", "densekkt")  # the colours that `condyn bench` gives them
_LAST = ("reference",)  # it judges, and is seldom drawn

_EPS: Final = float(np.finfo(float).eps)
_TICKS: Final = (1, 3, 10, 30, 100, 300, 1e3, 3e3, 1e4, 1e5, 1e6)  # [us]
_LOWEST: Final = 1e-17  # where an error of zero is drawn
_HIGHEST: Final = 10.0  # where what diverges is drawn


def style(name: str) -> dict[str, str]:
    """Return colour, marker and line of a solver, the same in every picture."""
    others = sorted(SOLVERS.keys() - {*_FIRST, *_LAST})
    known = [*_FIRST, *others, *_LAST]
    i = known.index(name.lower()) if name.lower() in known else len(known)
    return {
        "color": COLOURS[i % len(COLOURS)],
        "marker": _MARKERS[i % len(_MARKERS)],
        "ls": _LINES[i % len(_LINES)],
    }


def work_precision(
    table: Table, scene: str | None = None, measure: str | None = None, ax: Any = None
) -> Any:
    """Draw worst error against median time of every solver with all its parameters.

    Every mark is a solver with its parameters; a line is the front of one method, the grey
    staircase that of all. Hollow marks said at some state that they are inaccurate. Dotted is the
    rounding of one number, dash-dotted the error that `Reference` itself may have: nothing below it
    is known. What diverges is drawn at 10. Solvers that failed at a state are counted behind the
    name of their method.

    Parameters
    ----------
    table : Table
    scene, measure : str, optional
        What to draw; the only ones of the table by default.
    ax : matplotlib axes, optional
        A new figure by default.

    Returns
    -------
    matplotlib axes
    """
    rows = _one_question(table.of(scene=scene, measure=measure).rows)
    ax = axes(ax)
    best = [(microseconds(row), _height(row)) for row in pareto_front(rows)]
    if best:
        ax.step(
            *zip(*best, strict=True),
            where="post",
            color="0.85",
            lw=6,
            zorder=0,
            label="Pareto front",
        )
    for name in dict.fromkeys(row.solver.split("(")[0] for row in rows):
        _draw_method(ax, name, [row for row in rows if row.solver.split("(")[0] == name])
    _draw_floors(ax, table.floors.get(rows[0].scene))
    ax.set(title=f"{rows[0].scene}: {rows[0].rows} rows", xscale="log", yscale="log")
    ax.set_ylim(_LOWEST / 3, 3 * _HIGHEST)
    ax.set(xlabel=f"time of {rows[0].measure} [us]", ylabel="worst error, relative")
    ticks = [tick for tick in _TICKS if ax.get_xlim()[0] <= tick <= ax.get_xlim()[1]]
    ax.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    ax.minorticks_off()
    ax.grid(visible=True, which="major", color="0.92")
    ax.legend(fontsize=6, frameon=False, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return ax


def _one_question(rows: Sequence[Row]) -> Sequence[Row]:
    if not rows:
        raise InvalidArgument("the table has no rows: nothing to draw")
    for what in ("scene", "measure"):
        known = list(dict.fromkeys(getattr(row, what) for row in rows))
        if len(known) > 1:
            raise InvalidArgument(f"{what}: this table has {len(known)}, name one: {known}")
    return rows


def _draw_method(ax: Any, name: str, rows: Sequence[Row]) -> None:
    look = style(name)
    mark = look | {"ls": "", "ms": 4, "lw": 1}
    shown = [row for row in rows if comparable(row)]
    for hollow in (False, True):
        points = [(microseconds(row), _height(row)) for row in shown if row.ok is not hollow]
        if points:
            fill = "white" if hollow else look["color"]
            ax.plot(*zip(*points, strict=True), **mark, mfc=fill, alpha=0.5)
    line = [(microseconds(row), _height(row)) for row in pareto_front(rows)]
    label = rows[0].method + _failed(rows)
    if line:
        ax.plot(*zip(*line, strict=True), **look, lw=1.2, ms=5, mfc="none", label=label)
    else:
        ax.plot([], [], " ", label=label)


def _failed(rows: Sequence[Row]) -> str:
    """Return what is said behind the name of a method: who failed how, or was not timed."""
    failures = [row for row in rows if not answered(row)]
    if not failures:
        return "" if any(map(comparable, rows)) else f": {rows[0].timed}"
    how = ", ".join(dict.fromkeys(s for r in failures for s in r.statuses if s not in ANSWERED))
    return f": {how}" if len(failures) == len(rows) else f" ({len(failures)} of {len(rows)}: {how})"


def _draw_floors(ax: Any, floor: float | None) -> None:
    ax.axhline(SOLVED, color="0.6", lw=0.8, ls="--", label="status ok promises")
    ax.axhline(_EPS, color="0.4", lw=0.8, ls=":", label="rounding")
    if floor:
        ax.axhline(max(floor, _LOWEST), color="0.4", lw=0.8, ls="-.", label="floor of Reference")


def _height(row: Row) -> float:
    return min(max(row.error_worst, _LOWEST), _HIGHEST)


def save_trade(table: Table, path: str | Path) -> None:
    """Draw every scene and measure of a table into one picture; the ending says which format."""
    questions = list(dict.fromkeys((row.scene, row.measure) for row in table.rows))
    if not questions:
        raise InvalidArgument("the table has no rows: nothing to draw")
    figure, places = panels(len(questions), width=5.4, height=3.6, columns=3)
    for (scene, measure), ax in zip(questions, places, strict=False):
        work_precision(table, scene, measure, ax)
    note = "{processor}, Pinocchio {pinocchio}; hollow: said to be inaccurate"
    figure.suptitle(note.format_map({"processor": "", "pinocchio": ""} | table.machine), fontsize=8)
    write_figure(figure, path)
