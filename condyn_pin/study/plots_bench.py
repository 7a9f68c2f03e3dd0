"""Error against time of the main methods: `bench` draws on axes, `save_bench` writes a file."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from condyn_pin._core.plot_style import METHODS, OTHER, write_figure
from condyn_pin._core.plots import axes, panels
from condyn_pin._core.tolerances import SOLVED
from condyn_pin.study.bench_table import BenchRow, BenchTable

_FLOOR = 1e-16


def bench(table: BenchTable, scene: str, ax: Any = None) -> Any:
    """Draw error against time of every method on one scene: down and to the left is better.

    Parameters
    ----------
    table : BenchTable
    scene : str
        Label of the scene.
    ax : matplotlib axes, optional
        A new figure by default.

    Returns
    -------
    matplotlib axes
    """
    ax = axes(ax)
    rows = [row for row in table.rows if row.scene == scene and row.origin == "python"]
    for row in rows:
        colour, marker = next(
            (s for key, s in METHODS.items() if row.method.startswith(key)), OTHER
        )
        time = row.acceleration_us if math.isfinite(row.acceleration_us) else row.bare_us
        if row.rows == 0:
            ax.axvline(time, color=colour, lw=0.8, ls=":", label=row.method)
        elif math.isfinite(row.error):
            hollow = "none" if "inaccurate" in row.status else colour
            error = max(row.error, _FLOOR)
            ax.plot(time, error, marker, color=colour, mfc=hollow, ms=7, label=row.method)
    ax.axhline(SOLVED, color="0.6", lw=0.8, ls="--")
    for row in rows:
        if row.rows and not math.isfinite(row.error):
            ax.plot([], [], " ", label=f"{row.method}: {row.status.split(' ', 1)[1]}")
    ax.set(title=_title(rows, scene), xlabel="time of a [us]", ylabel="error of a")
    ax.set(xscale="log", xlim=(1.0, 300.0), yscale="log", ylim=(_FLOOR / 3, 1.0))
    ax.set_xticks([1, 3, 10, 30, 100, 300], ["1", "3", "10", "30", "100", "300"])
    ax.minorticks_off()
    ax.grid(visible=True, which="major", color="0.9")
    ax.legend(fontsize=7, frameon=False)
    return ax


def save_bench(table: BenchTable, path: str | Path) -> None:
    """Draw every scene of a table into one picture; the ending of `path` says which format."""
    scenes = list(dict.fromkeys(row.scene for row in table.rows if row.origin == "python"))
    figure, places = panels(len(scenes), width=4.2, height=3.4, columns=3)
    for ax, scene in zip(places, scenes, strict=False):
        bench(table, scene, ax)
    note = "{processor}, Pinocchio {pinocchio}; dashed: what status ok promises"
    figure.suptitle(note.format(**table.machine), fontsize=8)
    write_figure(figure, path)


def _title(rows: list[BenchRow], scene: str) -> str:
    counted = next((row for row in rows if row.rows), None)
    return f"{scene}: {counted.rows} rows, rank {counted.rank}" if counted else scene
