"""Maps of severity by method in colour: the error of a, and what was said of it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from textwrap import fill
from typing import Any

import numpy as np

from condyn_pin._core.show import axes, panels, write_figure
from condyn_pin._core.tolerances import SOLVED
from condyn_pin.lab.extremes.families import families
from condyn_pin.lab.extremes.stress_table import Map, short
from condyn_pin.lab.extremes.verdict import Verdict

_MARKS = {Verdict.OK: "", Verdict.SAID_SO: "s", Verdict.REFUSED: "r"}
_BEST, _WORST = -16.0, 0.0  # of the colours, in digits
_SMALL = 7.5  # [points]
_LEGEND = (
    "no letter: said ok, and is right; s: said inaccurate; r: refused; X: a defect; "
    "white: nothing to compare with"
)


def severity_map(found: Map, ax: Any = None) -> Any:
    """Draw one family: a column a severity, a line a method, dark where digits are lost.

    A letter says what the answer said of itself: s inaccurate, r refused, X a defect. Drawn on `ax`
    or new axes, which are returned.
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
            ax.text(
                j, i, mark, ha="center", va="center", fontsize=_SMALL, color="w" if dark else "k"
            )
    ax.imshow(grid, aspect="auto", cmap="cividis_r", vmin=_BEST, vmax=_WORST)
    ax.set_xticks(range(len(found.severities)), [short(s, 4) for s in found.severities])
    ax.tick_params(axis="x", rotation=90)
    ax.set_yticks(range(len(found.methods)), found.methods)
    ax.tick_params(labelsize=_SMALL)
    known = families()
    if found.family in known:
        ax.set_xlabel(fill(known[found.family].title, 48), fontsize=_SMALL)
    ax.set_title(found.label, fontsize=9, fontweight="bold")
    return ax


def overview(found: Sequence[Map], ax: Any = None) -> Any:
    """Draw all families in one picture: how many severities each method answers rightly.

    A line a family, a column a method: severities that are ok, of all; dark where there are few. An
    X is a defect. Drawn on `ax` or new axes, which are returned.
    """
    ax = axes(ax)
    methods = list(dict.fromkeys(method for each in found for method in each.methods))
    shares = np.full((len(found), len(methods)), np.nan)
    for i, each in enumerate(found):
        for j, method in enumerate(methods):
            cells = [c for (_, name), c in each.cells.items() if name == method]
            if not cells:
                continue
            right = sum(cell.worst is Verdict.OK for cell in cells)
            shares[i, j] = right / len(cells)
            text = "X" if any(cell.worst.defect for cell in cells) else f"{right}/{len(cells)}"
            dark = shares[i, j] < 0.5
            ax.text(
                j, i, text, ha="center", va="center", fontsize=_SMALL, color="w" if dark else "k"
            )
    ax.imshow(shares, aspect="auto", cmap="cividis", vmin=0.0, vmax=1.0)
    ax.set_xticks(range(len(methods)), methods, rotation=35, ha="left")
    ax.set_yticks(range(len(found)), [each.label for each in found])
    ax.tick_params(
        labelsize=_SMALL, length=0, top=True, bottom=False, labeltop=True, labelbottom=False
    )
    return ax


def save_overview(found: Sequence[Map], path: str | Path, note: str) -> None:
    """Draw the overview into a picture; the ending of `path` says which format."""
    figure, (ax,) = panels(1, width=7.2, height=0.9 + 0.19 * len(found), columns=1)
    overview(found, ax)
    figure.supxlabel(
        f"{note}severities answered rightly, of all; the rest was refused or said to be inaccurate",
        fontsize=8,
    )
    write_figure(figure, path, dpi=130)


def save_maps(found: Sequence[Map], path: str | Path, note: str, *, columns: int = 2) -> None:
    """Draw every map into one picture, so many side by side; the ending says which format."""
    columns = min(columns, len(found))
    figure, places = panels(len(found), width=4.6, height=3.1, columns=columns, above=0.8)
    for ax, each in zip(places, found, strict=False):
        severity_map(each, ax)
    drawn, shrink, pad = places[0].images[0], min(1.0, 2 / columns), 0.05 * columns / len(places)
    colours = figure.colorbar(drawn, ax=places, location="top", shrink=shrink, aspect=40, pad=pad)
    digits = range(int(_BEST), int(_WORST) + 1, 4)
    colours.set_ticks(list(digits), labels=[f"1e{k}" if k else "1" for k in digits])
    colours.set_label("error of a, relative; ok promises 1e-8")
    colours.ax.axvline(math.log10(SOLVED), color="w")
    figure.suptitle(fill(f"{note}{_LEGEND}", int(13 * 4.6 * columns)), fontsize=10)
    write_figure(figure, path, dpi=120)
