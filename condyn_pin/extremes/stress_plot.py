"""Maps of severity by method in colour: the error of a, and what was said of it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from condyn_pin.extremes.stress_table import Map
from condyn_pin.extremes.verdict import Verdict
from condyn_pin.plots import axes, require_matplotlib

_MARKS = {Verdict.OK: "", Verdict.SAID_SO: "s", Verdict.REFUSED: "r"}
_BEST, _WORST = -16.0, 0.0  # of the colours, in digits


def severity_map(found: Map, ax: Any = None) -> Any:
    """Draw one family: a column a severity, a line a method, dark where digits are lost.

    A letter says what the answer said of itself: s inaccurate, r refused, X a defect.

    Parameters
    ----------
    found : Map
    ax : matplotlib axes, optional
        A new figure by default.

    Returns
    -------
    matplotlib axes
    """
    ax = axes(ax)
    grid = np.full((len(found.methods), len(found.severities)), np.nan)
    for i, method in enumerate(found.methods):
        for j, severity in enumerate(found.severities):
            cell = found.cells.get((severity, method))
            if cell is None:
                continue
            if not math.isnan(cell.error):
                grid[i, j] = math.log10(min(max(cell.error, 1e-16), 1.0))
            mark = _MARKS.get(cell.worst, "X")
            dark = grid[i, j] > -6
            ax.text(j, i, mark, ha="center", va="center", fontsize=6, color="w" if dark else "k")
    ax.imshow(grid, aspect="auto", cmap="cividis_r", vmin=_BEST, vmax=_WORST)
    ax.set_xticks(range(len(found.severities)), [f"{s:.0e}" for s in found.severities])
    ax.tick_params(axis="x", rotation=90, labelsize=6)
    ax.set_yticks(range(len(found.methods)), found.methods)
    ax.tick_params(axis="y", labelsize=6)
    ax.set_title(found.label, fontsize=8)
    return ax


def save_maps(found: Sequence[Map], path: str | Path, note: str = "") -> None:
    """Draw every map into one picture; the ending of `path` says which format."""
    require_matplotlib()
    from matplotlib.figure import Figure

    columns = min(4, len(found))
    lines = math.ceil(len(found) / columns)
    figure = Figure(figsize=(4.0 * columns, 2.5 * lines), layout="constrained")
    places = figure.subplots(lines, columns, squeeze=False)
    for ax, each in zip(places.flat, found, strict=False):
        severity_map(each, ax)
    for ax in places.flat[len(found) :]:
        ax.set_axis_off()
    colours = figure.colorbar(places.flat[0].images[0], ax=places, shrink=0.5, aspect=40)
    colours.set_label("digits lost: log10 of the error of a")
    figure.suptitle(
        f"{note}no letter: said ok, and right to 1e-8; s: said inaccurate; r: refused; "
        "X: a defect; white: nothing to compare with",
        fontsize=9,
    )
    figure.savefig(path, dpi=110)
