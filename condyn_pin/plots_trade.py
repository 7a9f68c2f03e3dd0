"""Work-precision diagrams: error against time, a line a method, down and to the left is better."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from condyn_pin.errors import InvalidArgument
from condyn_pin.plots import axes, require_matplotlib
from condyn_pin.solvers import SOLVERS
from condyn_pin.tolerances import SOLVED
from condyn_pin.trade.exports import status_words
from condyn_pin.trade.front import answered, comparable, front, microseconds
from condyn_pin.trade.row import Row

if TYPE_CHECKING:
    from condyn_pin.trade.table import Table

# Okabe and Ito's colours, told apart by colour-blind eyes, without their yellow, which paper loses;
# as many markers, and another number of lines, tell the methods apart without colour.
_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
_MARKERS = ("s", "o", "^", "d", "v", "P", "X", "<", ">", "p", "h")
_LINES = ("-", "--", "-.")
_FIRST = ("proximal", "lcaba", "densekkt")  # the colours that `condyn bench` gives them

_EPS: Final = float(np.finfo(float).eps)
_LOWEST: Final = 1e-17  # where an error of zero is drawn


def style(name: str) -> dict[str, str]:
    """Return colour, marker and line of a solver, the same in every picture."""
    known = [*_FIRST, *(key for key in sorted(SOLVERS) if key not in _FIRST)]
    i = known.index(name.lower()) if name.lower() in known else len(known)
    return {
        "color": _COLOURS[i % len(_COLOURS)],
        "marker": _MARKERS[i % len(_MARKERS)],
        "ls": _LINES[i % len(_LINES)],
    }


def work_precision(
    table: Table, scene: str | None = None, measure: str | None = None, ax: Any = None
) -> Any:
    """Draw worst error against median time of every solver with all its knobs.

    The grey staircase is the Pareto front. Dotted is the rounding of one number, dash-dotted the
    error that `Reference` itself may have: nothing below it is known. Hollow marks said at some
    state that they are inaccurate. Solvers that failed at a state have their name only.

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
    best = [(microseconds(row), _height(row)) for row in front(rows)]
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
    ax.set(xlabel=f"time of {rows[0].measure} [us]", ylabel="worst error, relative")
    ax.grid(visible=True, which="major", color="0.92")
    ax.legend(fontsize=6, frameon=False, loc="best")
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
    look, title = style(name), rows[0].method
    shown = sorted(filter(comparable, rows), key=_dial)
    if shown:
        points = [(microseconds(row), _height(row)) for row in shown]
        ax.plot(*zip(*points, strict=True), lw=1, ms=5, label=title, **look)
        hollow = [p for p, row in zip(points, shown, strict=True) if not row.ok]
        if hollow:
            ax.plot(*zip(*hollow, strict=True), **look | {"ls": ""}, ms=5, mfc="white", zorder=3)
        return
    said = next((status_words(row) for row in rows if not answered(row)), rows[0].timed)
    ax.plot([], [], " ", label=f"{title}: {said}")


def _dial(row: Row) -> tuple[Any, ...]:
    """Order the rows of one method by their knobs, so that a line follows the knob."""
    return tuple((value is not None, str(type(value)), value or 0) for value in row.knobs.values())


def _draw_floors(ax: Any, floor: float | None) -> None:
    ax.axhline(SOLVED, color="0.6", lw=0.8, ls="--", label="status ok promises")
    ax.axhline(_EPS, color="0.4", lw=0.8, ls=":", label="rounding")
    if floor:
        ax.axhline(max(floor, _LOWEST), color="0.4", lw=0.8, ls="-.", label="floor of Reference")


def _height(row: Row) -> float:
    return max(row.error_worst, _LOWEST)


def save_trade(table: Table, path: str | Path) -> None:
    """Draw every scene and measure of a table into one picture; the ending says which format."""
    require_matplotlib()
    from matplotlib.figure import Figure  # a figure of its own leaves the user's backend alone

    questions = list(dict.fromkeys((row.scene, row.measure) for row in table.rows))
    if not questions:
        raise InvalidArgument("the table has no rows: nothing to draw")
    columns = min(3, len(questions))
    lines = math.ceil(len(questions) / columns)
    figure = Figure(figsize=(4.6 * columns, 3.8 * lines), layout="constrained")
    grid = figure.subplots(lines, columns, squeeze=False)
    for (scene, measure), ax in zip(questions, grid.flat, strict=False):
        work_precision(table, scene, measure, ax)
    for ax in grid.flat[len(questions) :]:
        ax.set_axis_off()
    note = "{processor}, Pinocchio {pinocchio}; hollow: said to be inaccurate"
    figure.suptitle(note.format_map({"processor": "", "pinocchio": ""} | table.machine), fontsize=8)
    figure.savefig(path, dpi=150)
