"""Tables of numbers on a terminal."""

from __future__ import annotations

from typing import Final

from rich.console import Console
from rich.measure import Measurement
from rich.table import Table

_ROOM: Final = 10_000  # columns: more than any table has


def print_whole(table: Table, console: Console) -> None:
    """Print a table as wide as it is: a narrow terminal, or a file, gets long lines, uncut."""
    room = console.options.update(max_width=_ROOM)
    table.width = Measurement.get(console, room, table).maximum
    console.print(table, crop=False)
