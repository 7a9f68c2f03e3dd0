"""A ladder on the console."""

from __future__ import annotations

from rich.console import Console
from rich.table import Table

from condyn_pin._core.printing import print_whole
from condyn_pin.lab.hierarchy_table import COLUMNS, HierarchyTable


def print_ladder(table: HierarchyTable, console: Console) -> None:
    """Print what every model costs and saves, and why it is there."""
    shown = Table(*COLUMNS)
    for cells in table.cells():
        shown.add_row(*cells)
    print_whole(shown, console)
    for row in table.rows:
        console.print(f"{row.label}: {row.why}", soft_wrap=True)
    console.print(
        f"worst of {table.states} motions on both feet, against the first model / the model above",
        soft_wrap=True,
    )
