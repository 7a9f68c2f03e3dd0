"""A Table on a terminal: the front of every scene, and who failed."""

from __future__ import annotations

from rich.console import Console
from rich.table import Table as Grid

from condyn_pin._core.printing import print_whole
from condyn_pin.study.exports import COLUMNS, cells, short, status_words
from condyn_pin.study.pareto_front import answered
from condyn_pin.study.row import ALONE, Row
from condyn_pin.study.table import Table

_SHOWN = tuple(column for column in COLUMNS if column not in ("scene", "measure"))  # in the title


def print_table(table: Table, console: Console) -> None:
    """Print the rows that no other beats, and which solvers do not answer every state."""
    for scene, measure in dict.fromkeys((row.scene, row.measure) for row in table.rows):
        asked = table.of(scene=scene, measure=measure)
        best = asked.pareto().rows
        title = f"{scene}, {measure}: {len(best)} of {len(asked.rows)} rows that no other beats"
        shown = Grid(title=title, title_justify="left")
        for column in _SHOWN:
            side = "left" if column == "solver" else "right"
            shown.add_column(column, justify=side)  # type: ignore[arg-type]
        for row in best:
            shown.add_row(*(dict(zip(COLUMNS, cells(row), strict=True))[c] for c in _SHOWN))
        print_whole(shown, console)
        for text in failures(asked.rows):
            console.print(text, soft_wrap=True)
    if table.rows:
        console.print(
            "error: median and worst over the states, relative. Times: median and p95 of what the "
            f"measure calls. {timed(table)}\n{table.machine.get('processor')}, "
            f"Pinocchio {table.machine.get('pinocchio')}, one thread.",
            highlight=False,
            soft_wrap=True,
        )


def timed(table: Table) -> str:
    """Return how many of the times were taken while this process had a core for itself."""
    rows = [row for row in table.rows if row.median_us is not None]
    alone = sum(row.timed == ALONE for row in rows)
    return f"{alone} of {len(rows)} times were taken on a core that nothing else used."


def failures(rows: tuple[Row, ...]) -> list[str]:
    """Return which solvers did not answer every state, a line each."""
    failed = [row for row in rows if not answered(row)]
    return [f"{short(row)}: {status_words(row)}{_why(row)}" for row in failed]


def _why(row: Row) -> str:
    return f" ({row.note})" if row.note else ""
