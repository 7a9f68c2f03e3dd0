"""Error against time: down and to the left is better. Of the bench, and of studies."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from math import isfinite
from pathlib import Path
from typing import Any, Final

import numpy as np

from condyn_pin._core.show import (
    COLUMN,
    METHOD_COLOURS,
    METHODS,
    OTHER,
    PAGE,
    axes,
    labelled_axes,
    panels,
    write_figure,
)
from condyn_pin._core.show import style as look
from condyn_pin._core.tolerances import SOLVED
from condyn_pin.dynamics.solvers import SOLVERS
from condyn_pin.errors import InvalidArgument
from condyn_pin.study.bench import BenchTable
from condyn_pin.study.table import Table
from condyn_pin.study.tables import ANSWERED, Row, pareto_front

# As many markers as may be, and another number of lines, tell the methods apart without colour.
_MARKERS = ("s", "o", "^", "d", "v", "P", "X", "<", ">", "p", "h", "*", "D")
_LINES = ("-", "--", "-.")
_FIRST = ("proximal", "lcaba", "densekkt")  # the colours that `condyn bench` gives them
_LAST = ("minimumresidual", "reference")  # to compare with, and to judge: seldom drawn

_EPS: Final = float(np.finfo(float).eps)
_TICKS: Final = (1, 3, 10, 30, 100, 300, 1e3, 3e3, 1e4, 1e5, 1e6)  # [us]
_FLOOR: Final = 1e-16  # where the bench draws an error of zero
_LOWEST: Final = 1e-17  # and a study
_HIGHEST: Final = 10.0  # where what diverges is drawn
_ROOM: Final = 1e3  # below what is drawn, for what a panel says in its corner


def save_panels(
    draw: Sequence[Callable[[Any], object]],
    path: str | Path,
    *,
    size: tuple[float, float],
    columns: int,
    note: str = "",
    machine: Mapping[str, str] | None = None,
) -> None:
    """Draw into the panels of one picture, each of a size [inch]; a note has the machine's words.

    A legend below them has the lines of all. The ending of `path` is the format: a PDF has the
    look and the width of a paper.
    """
    paper = Path(path).suffix == ".pdf"
    columns = min(columns, len(draw), 2 if paper else len(draw))
    width, height = size
    if paper:
        width = COLUMN if columns == 1 else PAGE / columns
        height *= width / size[0]
    with look("paper" if paper else "screen"):
        figure, places = panels(len(draw), width=width, height=height, columns=columns)
        for one, ax in zip(draw, places, strict=False):
            one(ax)
        _share_legend(figure, places, 2 * columns)
        if note:
            words = {"processor": "", "pinocchio": ""} | dict(machine or {})
            figure.suptitle(note.format_map(words), fontsize="small")
        write_figure(figure, path)


def _share_legend(figure: Any, places: Sequence[Any], columns: int) -> None:
    """Replace the legends of all panels by one below them, its lines equally long."""
    entries: dict[str, Any] = {}
    for ax in places:
        handles, labels = ax.get_legend_handles_labels()
        entries |= dict(zip(labels, handles, strict=True))
        if legend := ax.get_legend():
            legend.remove()
    lines = math.ceil(len(entries) / columns)
    figure.legend(
        entries.values(), entries, loc="outside lower center",
        ncols=math.ceil(len(entries) / max(lines, 1)), fontsize="small", frameon=False,
    )  # fmt: skip


def _ticks(low: float, high: float) -> list[float]:
    """Round tick values on an axis of time [us]; finer ones if it spans less than a decade."""
    ticks = [float(tick) for tick in _TICKS if low <= tick <= high]
    if len(ticks) > 1:
        return ticks
    step = 10.0 ** np.floor(np.log10((high - low) / 2.0))
    for step_ in (5.0 * step, 2.0 * step, step):
        found = step_ * np.arange(np.ceil(low / step_), np.floor(high / step_) + 1)
        if len(found) > 1:
            break
    return [float(f"{tick:.6g}") for tick in found]


def _in_microseconds(ax: Any, x: str, y: str, title: str) -> Any:
    """Return axes of time against error, both in decades."""
    ax.set(xscale="log", yscale="log")
    ticks = _ticks(*ax.get_xlim())
    ax.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    ax.minorticks_off()
    return labelled_axes(ax, title=title, x=x, y=y)


# The bench


def draw_bench(table: BenchTable, scene: str, ax: Any = None) -> Any:
    """Draw error against time of every method on one scene, on `ax` or new axes; return them."""
    ax = axes(ax)
    rows = [row for row in table.rows if row.scene == scene and row.origin == "python"]
    weights: dict[str, None] = {}
    for row in rows:
        looks = (look for key, look in METHODS.items() if row.method.startswith(key))
        colour, marker = next(looks, OTHER)
        time = row.acceleration_us if isfinite(row.acceleration_us) else row.bare_us
        if row.rows == 0:
            ax.axvline(time, color=colour, lw=0.8, ls=":", label=row.method)
        elif isfinite(row.error):
            hollow = "none" if "inaccurate" in row.status else colour
            error = max(row.error, _FLOOR)
            method, _, damped = row.method.partition(", mu")
            ax.plot(time, error, marker, color=colour, mfc=hollow, ms=7, label=method)
            weights |= {f"by hand and dense: mu{damped}": None} if damped else {}
    ax.axhline(SOLVED, color="0.6", lw=0.8, ls="--")
    for row in rows:
        if row.rows and not isfinite(row.error):
            _remark(ax, f"{row.method}: {row.status.split(' ', 1)[1]}")
    for weight in weights:
        _remark(ax, weight)
    ax.set(xlim=(1.0, 300.0), ylim=(_FLOOR / _ROOM, 1.0))
    (title,) = BenchTable(tuple(rows), {}).by_scene()
    return _in_microseconds(ax, "time of a [us]", "relative error of a", title)


def save_bench(table: BenchTable, path: str | Path) -> None:
    """Draw every scene of a table into one picture, in the format of the ending of `path`."""
    scenes = dict.fromkeys(row.scene for row in table.rows if row.origin == "python")
    note = "{processor}, Pinocchio {pinocchio}; dashed: limit of status ok"
    draw = [partial(draw_bench, table, scene) for scene in scenes]
    save_panels(draw, path, size=(4.0, 3.2), columns=3, note=note, machine=table.machine)


# Studies


def style(name: str) -> dict[str, str]:
    """Return colour, marker and line of a solver, the same in every picture."""
    others = sorted(SOLVERS.keys() - {*_FIRST, *_LAST})
    known = [*_FIRST, *others, *_LAST]
    i = known.index(name.lower()) if name.lower() in known else len(known)
    return {
        "color": METHOD_COLOURS[i % len(METHOD_COLOURS)],
        "marker": _MARKERS[i % len(_MARKERS)],
        "ls": _LINES[i % len(_LINES)],
    }


def work_precision(
    table: Table, scene: str | None = None, measure: str | None = None, ax: Any = None
) -> Any:
    """Draw worst error against median time of every solver with all its parameters."""
    # Every mark is a solver with its parameters; a line is the front of one method, the grey
    # staircase that of all. Hollow marks had the status inaccurate at some state. Dotted is the
    # rounding of one number, dash-dotted the error that `Reference` itself may have: nothing below
    # it is known. What diverges is drawn at 10. Solvers that failed at a state are counted behind
    # the name of their method. See `Table.plot`.
    rows = _one_question(table.of(scene=scene, measure=measure).rows)
    ax = axes(ax)
    if best := _points(pareto_front(rows)):
        grey: dict[str, Any] = {"color": "0.85", "lw": 6, "zorder": 0}
        ax.step(*zip(*best, strict=True), where="post", label="Pareto front", **grey)
    for name in dict.fromkeys(row.solver.split("(")[0] for row in rows):
        _draw_method(ax, name, [row for row in rows if row.solver.split("(")[0] == name])
    ax.axhline(SOLVED, color="0.6", lw=0.8, ls="--", label="limit of status ok")
    ax.axhline(_EPS, color="0.4", lw=0.8, ls=":", label="rounding")
    if floor := table.floors.get(rows[0].scene):
        ax.axhline(max(floor, _LOWEST), color="0.4", lw=0.8, ls="-.", label="error of Reference")
    title, time = f"{rows[0].scene}: {rows[0].rows} rows", f"time of {rows[0].measure} [us]"
    _in_microseconds(ax, time, "worst relative error", title)
    remarks = any(each.get_gid() == "remarks" for each in ax.texts)
    ax.set_ylim(_LOWEST / (_ROOM if remarks else 3), 3 * _HIGHEST)
    ax.legend(fontsize="x-small", frameon=False, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return ax


def _one_question(rows: Sequence[Row]) -> Sequence[Row]:
    if not rows:
        raise InvalidArgument("the table has no rows: nothing to draw")
    for what in ("scene", "measure"):
        known = list(dict.fromkeys(getattr(row, what) for row in rows))
        if len(known) > 1:
            raise InvalidArgument(f"{what}: this table has {len(known)}, name one: {known}")
    return rows


def _points(rows: Sequence[Row]) -> list[tuple[float, float]]:
    """Time [us] and worst error of rows, errors clipped to the axis."""
    return [(row.us, min(max(row.error_worst, _LOWEST), _HIGHEST)) for row in rows]


def _draw_method(ax: Any, name: str, rows: Sequence[Row]) -> None:
    look = style(name)
    mark = look | {"ls": "", "ms": 4, "lw": 1}
    for hollow in (False, True):
        if points := _points([row for row in rows if row.comparable and row.ok is not hollow]):
            fill = "white" if hollow else look["color"]
            ax.plot(*zip(*points, strict=True), **mark, mfc=fill, alpha=0.5)
    failed = _failed(rows)
    if line := _points(pareto_front(rows)):
        label = rows[0].method
        ax.plot(*zip(*line, strict=True), **look, lw=1.2, ms=5, mfc="none", label=label)
        _remark(ax, f"{label}{failed}" if failed else "")
    else:
        ax.plot([], [], " ", label=rows[0].method + failed)


def _remark(ax: Any, text: str) -> None:
    """Add a line to the remarks in the corner of a panel."""
    said = [each for each in ax.texts if each.get_gid() == "remarks"]
    if text and said:
        said[0].set_text(f"{said[0].get_text()}\n{text}")
    elif text:
        ax.text(
            0.02, 0.02, text, transform=ax.transAxes, fontsize="x-small", ha="left", va="bottom",
            gid="remarks",
        )  # fmt: skip


def _failed(rows: Sequence[Row]) -> str:
    """Remark behind a method's name in the legend: failure statuses and counts, or no times."""
    failures = [row for row in rows if not row.answered]
    if not failures:
        return "" if any(row.comparable for row in rows) else f": {rows[0].timed}"
    how = ", ".join(dict.fromkeys(s for r in failures for s in r.statuses if s not in ANSWERED))
    return f": {how}" if len(failures) == len(rows) else f" ({len(failures)} of {len(rows)}: {how})"


def save_trade(table: Table, path: str | Path) -> None:
    """Draw every scene and measure of a table into one picture, in the format of its ending."""
    questions = list(dict.fromkeys((row.scene, row.measure) for row in table.rows))
    if not questions:
        raise InvalidArgument("the table has no rows: nothing to draw")
    note = "{processor}, Pinocchio {pinocchio}; hollow: status inaccurate"
    draw = [partial(work_precision, table, *question) for question in questions]
    save_panels(draw, path, size=(4.0, 3.4), columns=3, note=note, machine=table.machine)
