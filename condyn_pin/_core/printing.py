"""Tables of numbers on a terminal."""

from __future__ import annotations

from textwrap import fill
from typing import Final

from rich.console import Console
from rich.measure import Measurement
from rich.table import Table

_ROOM: Final = 10_000  # columns: more than any table has
_LONG: Final = 20  # a cell that is longer is a text, and may be folded


def print_whole(table: Table, console: Console) -> None:
    """Print a table without cut cells; wide tables have long lines.

    On a terminal that is too narrow, the frame is left out, and headings and texts are folded.
    """
    if console.is_terminal and _width(table, console).maximum > console.width:
        _fold(table)
        least, most = _width(table, console)
        table.width = min(max(console.width, least), most)
    else:
        table.width = _width(table, console).maximum
    console.print(table, crop=False)


def _width(table: Table, console: Console) -> Measurement:
    return Measurement.get(console, console.options.update(max_width=_ROOM), table)


def _fold(table: Table) -> None:
    """Wrap the text columns of a table; numbers are never broken."""
    table.box, table.padding, table.pad_edge = None, (0, 1, 0, 0), False
    for column in table.columns:
        column.overflow = "fold"
        words = str(column.header).split()
        longest = max(len(str(cell)) for cell in column.cells)
        if longest <= _LONG:
            longest = max(longest, *map(len, words))
            column.header, column.width = fill(" ".join(words), longest), longest
