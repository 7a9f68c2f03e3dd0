"""A picture of a ladder: speed against error, one labelled point a model."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from condyn_pin._core.plot_style import METHODS, OTHER, write_figure
from condyn_pin._core.plots import axes, panels
from condyn_pin.lab.hierarchy_table import HierarchyTable

_FLOOR = 1e-6  # where exact models are drawn


def draw_ladder(table: HierarchyTable, ax: Any = None) -> Any:
    """Draw the worst error of a against the speed of every model: down and to the right is better.

    Parameters
    ----------
    table : HierarchyTable
    ax : matplotlib axes, optional
        A new figure by default.

    Returns
    -------
    matplotlib axes
    """
    ax = axes(ax)
    rows = [row for row in table.rows if math.isfinite(row.speedup)]
    points = [(row.speedup, max(row.a_worst, _FLOOR)) for row in rows]
    ax.plot(*zip(*points, strict=True), color="0.8", lw=0.8, zorder=0)
    for number, (row, point) in enumerate(zip(rows, points, strict=True), start=1):
        colour, marker = METHODS.get(row.solver, OTHER)
        ax.plot(*point, marker, color=colour, ms=7)
        ax.annotate(str(number), point, textcoords="offset points", xytext=(5, 5), fontsize=8)
        label = f"{number}: {row.label} (nv {row.nv}, {row.rows} rows, {row.solver})"
        ax.plot([], [], marker, color=colour, label=label)
    ax.set(title=table.name, xlabel="times faster than the first model", yscale="log")
    ax.set(ylabel="worst error of a, 0 drawn at 1e-6", ylim=(_FLOOR / 3, 10.0))
    ax.set_xlim(0.0, 1.15 * max(speed for speed, _ in points))
    ax.grid(visible=True, which="major", color="0.9")
    ax.legend(fontsize=6, frameon=False, loc="best")
    return ax


def save_ladders(tables: list[HierarchyTable], path: str | Path) -> None:
    """Draw ladders side by side into a file; the ending of `path` says which format."""
    figure, places = panels(len(tables), width=4.8, height=4.0, columns=len(tables))
    for table, ax in zip(tables, places, strict=True):
        draw_ladder(table, ax)
    note = "{processor}, Pinocchio {pinocchio}"
    figure.suptitle(note.format(**tables[0].machine), fontsize=8)
    write_figure(figure, path)
