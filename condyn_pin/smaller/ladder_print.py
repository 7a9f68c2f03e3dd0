"""A ladder on the console."""

from __future__ import annotations

from pathlib import Path

from rich.console import Console
from rich.table import Table

from condyn_pin.smaller.climbing import ladder
from condyn_pin.smaller.ladder_plot import save_ladders
from condyn_pin.smaller.ladder_table import COLUMNS


def show_ladder(name: str, plot: Path | None, console: Console) -> None:
    """Measure a ladder, print it, and draw it if a file is named."""
    table = ladder(name)
    shown = Table(*COLUMNS)
    for cells in table.cells():
        shown.add_row(*cells)
    console.print(shown)
    for row in table.rows:
        console.print(f"{row.label}: {row.why}")
    console.print(
        f"worst of {table.states} motions on both feet, against the first rung / the rung above"
    )
    if plot:
        save_ladders([table], plot)
