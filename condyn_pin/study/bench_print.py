"""A BenchTable on a terminal."""

from __future__ import annotations

from rich.console import Console
from rich.table import Table

from condyn_pin._core.printing import print_whole
from condyn_pin.study.bench_table import BenchRow, BenchTable


def print_bench(table: BenchTable, console: Console) -> None:
    """Print a table of every scene, and what its columns mean."""
    for scene in dict.fromkeys(row.scene for row in table.rows):
        rows = [row for row in table.rows if row.scene == scene]
        counted = next((row for row in rows if row.rows), None)
        title = f"{scene}: {counted.rows} rows, rank {counted.rank}" if counted else scene
        shown = Table(title=title, title_justify="left")
        shown.add_column("method")
        for heading in ("bare", "a", "p95", "solve", "a / bare", "solve / bare", "x dense"):
            shown.add_column(heading, justify="right")
        for heading in ("error of a", "it.", "status"):
            shown.add_column(heading, justify="right")
        for row in rows:
            shown.add_row(*_cells(row))
        print_whole(shown, console)
    machine = table.machine
    console.print(
        "bare: Pinocchio's call; a: Workspace.acceleration, median and p95; solve: with its errors "
        "[us].\nx dense: times faster than the fastest of dense KKT and what is by hand; by hand: "
        "Pinocchio and another's solver, without guard or proof. error of a: worst over the "
        "states, against Reference, relative to the larger of |a| and gravity.\n"
        f"{machine['processor']}, Pinocchio {machine['pinocchio']}, one thread.",
        highlight=False,
        markup=False,
        soft_wrap=True,
    )


def _cells(row: BenchRow) -> list[str]:
    def number(value: float, form: str) -> str:
        return format(value, form) if value == value else ""

    method = row.method if row.origin == "python" else f"{row.method} ({row.origin})"
    return [
        method,
        number(row.bare_us, ".1f"),
        number(row.acceleration_us, ".1f"),
        number(row.acceleration_p95_us, ".1f"),
        number(row.solve_us, ".1f"),
        number(row.to_bare, ".2f"),
        number(row.solve_to_bare, ".2f"),
        number(row.to_dense, ".2f"),
        number(row.error, ".0e"),
        str(row.iterations or ""),
        row.status,
    ]
