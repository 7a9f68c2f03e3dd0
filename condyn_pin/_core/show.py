"""Tables and curves for notebooks and paper.

Values as a notebook shows them: tables in HTML.

Every text is escaped, for names come from files. Nothing is loaded, and no script runs. Text has
the colour of the page, light or dark, and lines are half clear; a status is in words, too.
"""

from __future__ import annotations

import importlib.util
import math
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from enum import Enum
from html import escape
from itertools import compress
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from condyn_pin._core.arrays import Array, text_of
from condyn_pin._core.files import atomic_write
from condyn_pin.errors import InvalidArgument, MissingExtra

if TYPE_CHECKING:  # a first solve has no need of it
    from rich.console import Console
    from rich.table import Table

_GOOD: Final = "#009e73"  # green and vermillion of Okabe and Ito: told apart by all eyes
_BAD: Final = "#d55e00"
_LINE: Final = "1px solid rgba(128,128,128,0.35)"
_FLAT: Final = 1e-9  # a change that is rounding beside the numbers is no curve
_CELL: Final = f"text-align:left;padding:2px 14px 2px 0;border:none;border-bottom:{_LINE}"
_NUMBER: Final = (
    _CELL.replace("left", "right", 1) + ";white-space:nowrap;font-variant-numeric:tabular-nums"
)
_TABLE: Final = "border-collapse:collapse;margin:4px 0 8px 0;background:transparent;color:inherit"
# Outcomes that are ok.
_USABLE: Final = ("OK", "CLOSED", "CONVERGED", "REACHED", "FINISHED", "ENDED")
_FOLD: Final = 12  # rows of a table that are seen at once


class Outcome(Enum):
    """How an answer ended: a name, and as its value what that means and what would help.

    Attributes
    ----------
    ok : bool
        True if the answer can be used as it is.
    """

    ok: bool

    def __init__(self, meaning: str) -> None:
        self.ok = self._name_ in _USABLE

    @property
    def word(self) -> str:
        """Name in small letters, as texts, tables and files have it."""
        return self._name_.lower()

    def text_of(self, *parts: str) -> str:
        """Name and the given causes and cures, without those that are empty."""
        return f"{self.word}: {'; '.join(filter(None, parts))}"

    def __str__(self) -> str:
        return self.text_of(str(self.value))


def page(title: str, *parts: str, ok: bool | None = None) -> str:
    """HTML of a title, with a dot for good or bad, and the content below it."""
    dot = "" if ok is None else f'<span style="color:{_GOOD if ok else _BAD}">&#9679;</span> '
    head = f'<div style="font-weight:600;margin-bottom:2px">{dot}{escape(title)}</div>'
    return f'<div style="max-width:60em;line-height:1.4">{head}{"".join(parts)}</div>'


def facts(pairs: Iterable[tuple[str, str]]) -> str:
    """HTML of labels and texts, one line each."""
    rows = "".join(
        f'<tr style="background:transparent"><th style="{_CELL};font-weight:normal;opacity:0.7;'
        f'vertical-align:top;white-space:nowrap">{escape(label)}</th>'
        f'<td style="{_CELL}">{escape(text)}</td></tr>'
        for label, text in pairs
    )
    return f'<table style="{_TABLE}">{rows}</table>' if rows else ""


def grid(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """HTML table without its empty columns; numbers are right-aligned."""
    if not rows:
        return ""
    used = [any(column) for column in zip(*rows, strict=True)]
    headings = list(compress(headings, used))
    rows = [list(compress(row, used)) for row in rows]
    styles = [
        _NUMBER if all(map(_is_number, column)) else _CELL for column in zip(*rows, strict=True)
    ]
    heads = "".join(
        f'<th style="{style};font-weight:600">{escape(heading)}</th>'
        for heading, style in zip(headings, styles, strict=True)
    )
    lines = [
        '<tr style="background:transparent">'
        + "".join(
            f'<td style="{style}">{escape(cell)}</td>'
            for cell, style in zip(row, styles, strict=True)
        )
        + "</tr>"
        for row in rows
    ]
    head = f'<tr style="background:transparent">{heads}</tr>'
    return f'<table style="{_TABLE}"><thead>{head}</thead><tbody>{"".join(lines)}</tbody></table>'


def folded_html(title: str, content: str, *, count: int = _FOLD + 1) -> str:
    """HTML of content below a line that unfolds it; a few rows are shown at once."""
    if not content:
        return ""
    opened = " open" if count <= _FOLD else ""
    return (
        f'<details{opened}><summary style="cursor:pointer">{escape(title)}</summary>'
        f"{content}</details>"
    )


def notes(texts: Iterable[str]) -> str:
    """HTML of warnings, one line each."""
    return "".join(
        f'<div style="border-left:3px solid {_BAD};padding-left:8px;margin:3px 0">'
        f"{escape(text)}</div>"
        for text in texts
    )


def curve(title: str, x: Array, y: Array, unit: str) -> str:
    """HTML of a small curve, with its extremes and its end as text."""
    known = np.isfinite(x) & np.isfinite(y)
    if np.count_nonzero(known) < 2:
        return ""
    x, y = x[known], y[known]
    low, high = float(y.min()), float(y.max())
    if high - low <= _FLAT * max(abs(low), abs(high)):
        return f"<div>{escape(f'{title}: {low:.3g} {unit}')}</div>"
    chosen = np.unique(np.linspace(0, len(x) - 1, min(len(x), 200)).astype(int))
    width, height = 240.0, 40.0
    across = (x - x[0]) / max(float(x[-1] - x[0]), 1e-300) * width
    up = height - (y - low) / (high - low) * height
    points = " ".join(f"{across[i]:.1f},{up[i]:.1f}" for i in chosen)
    said = f"{title}: {low:.3g} to {high:.3g} {unit}, at the end {y[-1]:.3g}"
    return (
        f'<div style="display:inline-block;margin:4px 18px 4px 0"><div>{escape(said)}</div>'
        f'<svg width="{width:g}" height="{height + 4:g}" viewBox="0 -2 {width:g} {height + 4:g}" '
        f'role="img" aria-label="{escape(said)}"><polyline points="{points}" fill="none" '
        'stroke="currentColor" stroke-width="1.2"/></svg></div>'
    )


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return not text
    return True


# On a terminal.

_ALL_COLUMNS: Final = 10_000  # columns: more than any table has
_COLUMNS: Final = 100  # of a line in a file
_TEXT: Final = 20  # a cell that is longer is a text, and may be folded


def print_whole(table: Table, console: Console) -> None:
    """Print a table without cut cells; beyond the terminal, or 100 columns, without its frame."""
    # On a terminal that is too narrow texts are folded too; elsewhere, in a file, lines stay whole.
    # Numbers are never broken.
    options = console.options.update(max_width=_ALL_COLUMNS)
    least, most = console.measure(table, options=options)
    room = console.width if console.is_terminal else _COLUMNS
    if most > room:
        table.box, table.padding, table.pad_edge = None, (0, 1, 0, 0), False
        for column in table.columns:
            column.overflow = "fold"
            words = str(column.header).split()
            longest = max(len(str(cell)) for cell in column.cells)
            if longest <= _TEXT:
                longest = max(longest, *map(len, words))
                column.header, column.width = fill(" ".join(words), longest), longest
        least, most = console.measure(table, options=options)
        if console.is_terminal:
            most = min(max(room, least), most)
    table.width = most
    console.print(table, crop=False)


# pandas, where it is installed.


def require_pandas() -> Any:
    """Module pandas, or MissingExtra."""
    try:
        import pandas
    except ImportError as error:
        raise MissingExtra(
            "a data frame needs pandas: python -m pip install 'condyn_pin[pandas]'"
        ) from error
    return pandas


# What pictures are drawn on: axes of the caller or of a new figure, and figures for a file.


PICTURES: Final = (".png", ".svg", ".pdf")


STYLES: Final[dict[str, Any]] = {
    "screen": {
        "font.size": 10.0, "axes.titlesize": "medium", "legend.fontsize": "small",
        "lines.linewidth": 1.4, "figure.figsize": (6.4, 4.0),
    },
    "paper": {
        "font.size": 8.0, "axes.titlesize": 8.0, "axes.labelsize": 8.0, "legend.fontsize": 6.5,
        "xtick.labelsize": 7.0, "ytick.labelsize": 7.0, "axes.linewidth": 0.6,
        "lines.linewidth": 1.1, "lines.markersize": 4.0, "figure.figsize": (3.5, 2.4),
        "pdf.fonttype": 42, "svg.fonttype": "none", "savefig.dpi": 300.0,
    },
}  # fmt: skip
COLUMN, PAGE = 3.5, 7.1  # [inch] width of a column of a paper, and of two


@contextmanager
def style(name: str = "paper") -> Iterator[None]:
    """Draw figures in one look: as wide as a column of a paper, font 8, or for a screen.

    Parameters
    ----------
    name : str
        "paper" or "screen". Write what is drawn to a .pdf or .svg: lines stay lines.

    Raises
    ------
    InvalidArgument
        If there is no such style.
    MissingExtra
        If matplotlib is not installed.
    """
    if name not in STYLES:
        raise InvalidArgument(f"style = {text_of(name)}: one of {', '.join(STYLES)} is needed")
    require_matplotlib()
    from matplotlib import rc_context

    with rc_context(STYLES[name]):
        yield


def axes(ax: Any) -> Any:
    """Return the axes of the caller, or those of a new figure."""
    require_matplotlib()
    if ax is not None:
        from matplotlib.axes import Axes

        if not isinstance(ax, Axes):
            raise InvalidArgument(
                f"ax = {text_of(ax)}: axes of matplotlib are needed, one of figure.subplots(); "
                "without any a new figure is made"
            )
        return ax
    from matplotlib import pyplot

    return pyplot.subplots(layout="constrained")[1]  # long names of contacts are not cut off


def panels(
    count: int, *, width: float, height: float, columns: int, above: float = 0.0
) -> tuple[Any, list[Any]]:
    """Return a figure for a file, and the axes of its panels, those that are left over blank."""
    # `width` and `height` are those of one panel, `above` is room for a legend [inch].
    require_matplotlib()
    from matplotlib.figure import Figure  # a figure of its own leaves the user's backend alone

    columns = min(columns, count)
    lines = math.ceil(count / columns)
    figure = Figure(figsize=(width * columns, above + height * lines), layout="constrained")
    places = list(figure.subplots(lines, columns, squeeze=False).flat)
    for ax in places[count:]:
        ax.set_axis_off()
    return figure, places


def require_matplotlib() -> None:
    """Raise MissingExtra if matplotlib is not installed."""
    if importlib.util.find_spec("matplotlib") is None:
        raise MissingExtra('pictures need matplotlib: python -m pip install "condyn_pin[plot]"')


# Style of plots: lines that colour-blind eyes tell apart, and those who read on paper.
#
# Colours are those of Okabe and Ito, without their yellow, which paper loses; dashes tell lines
# apart where there is no colour.


COLOURS: Final = (
    "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#7F7F7F",
)  # fmt: skip
# Methods of studies: no two are alike to colour-blind eyes either (`tests/test_plots.py`).
METHOD_COLOURS: Final = (
    "#0072B2", "#D55E00", "#009E73", "#40004B", "#B2DF8A", "#E69F00", "#9E0142", "#662506",
    "#B0B0B0", "#56B4E9", "#3B3B98", "#8000E0", "#000000",
)  # fmt: skip
DASHES: Final = ("-", "--", "-.", ":")

# Colour and marker of the main methods by their titles, and of any other.
METHODS: Final = {
    "ABA": ("#000000", "|"),
    "LCABA": ("#D55E00", "o"),
    "Proximal": ("#0072B2", "s"),
    "Dense KKT": ("#009E73", "^"),
    "numpy": ("#E69F00", "v"),
    "LAPACK": ("#56B4E9", "<"),
    "Contact Cholesky": ("#7F7F7F", "D"),
}
OTHER: Final = ("#CC79A7", "d")


def line(i: int) -> dict[str, Any]:
    """Colour and dashes of line i; the first 32 lines all differ."""
    dashes = DASHES[(i + i // len(COLOURS)) % len(DASHES)]
    return {"color": COLOURS[i % len(COLOURS)], "ls": dashes}


def labelled_axes(ax: Any, *, title: str, x: str, y: str) -> Any:
    """Return axes with their words, a pale grid, and a legend if anything has a label."""
    # Of axes above one another that share x, the first has the title, the last the words of x, and
    # a legend stands only once.
    place = ax.get_subplotspec()
    beside = [each for each in ax.get_shared_x_axes().get_siblings(ax) if each is not ax]
    if place is not None and beside:
        title, x = title if place.is_first_row() else "", x if place.is_last_row() else ""
    ax.set(title=title, xlabel=x, ylabel=y)
    ax.grid(visible=True, which="major", color="0.92")
    ax.set_axisbelow(True)
    labels = ax.get_legend_handles_labels()[1]
    told = [each.get_legend_handles_labels()[1] for each in beside if each.get_legend()]
    if labels and labels not in told:
        ax.legend(fontsize="small", frameon=False)
    return ax


def write_figure(figure: Any, path: str | Path, *, dpi: int = 150) -> None:
    """Write a figure of matplotlib; the suffix of `path` is its format, PNG without one."""
    path = Path(path)
    with atomic_write(path if path.suffix else path.with_name(f"{path.name}.png")) as new:
        figure.savefig(new, dpi=dpi)
