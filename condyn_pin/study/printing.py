"""Tables of studies and of the bench on a terminal."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any

from rich.console import Console
from rich.table import Table as Grid

from condyn_pin._core.show import print_whole
from condyn_pin.study.bench import BenchRow, BenchTable
from condyn_pin.study.table import Table
from condyn_pin.study.tables import ALONE, Measurements, Row, number


def print_columns(
    table: Measurements[Any],
    console: Console,
    *,
    title: str | None = None,
    left: Collection[str] = (),
    without: Collection[str] = (),
) -> None:
    """Print the columns of a table, those in `left` flushed left."""
    shown = Grid(title=title, title_justify="left")
    columns = [column for column in table.columns if column[0] not in without]
    for heading, _ in columns:
        shown.add_column(heading, justify="left" if heading in left else "right")
    for row in table.rows:
        shown.add_row(*(cell(row) for _, cell in columns))
    print_whole(shown, console)


def print_table(table: Table, console: Console) -> None:
    """Print the Pareto-optimal rows, and the solvers that failed at a state."""
    for scene, measure in dict.fromkeys((row.scene, row.measure) for row in table.rows):
        asked = table.of(scene=scene, measure=measure)
        best = asked.pareto()
        title = f"{scene}, {measure}: {len(best)} of {len(asked)} rows that no other beats"
        without = ("scene", "measure")  # in the title
        print_columns(best, console, title=title, left=("solver",), without=without)
        for text in failures(asked.rows):
            console.print(text, soft_wrap=True)
    if table.rows:
        console.print(
            "error: median and worst over the states, relative. Times: median and p95 of what the "
            f"measure calls. {timing_sentence(table)}\n{table.machine.get('processor')}, "
            f"Pinocchio {table.machine.get('pinocchio')}, one thread.",
            highlight=False,
            soft_wrap=True,
        )


def timing_sentence(table: Table) -> str:
    """Return the count of times taken on a core of its own, as a sentence."""
    rows = [row for row in table.rows if row.median_us is not None]
    alone = sum(row.timed == ALONE for row in rows)
    return f"{alone} of {len(rows)} times were taken on a core that nothing else used."


def failures(rows: tuple[Row, ...]) -> list[str]:
    """Return the solvers that failed at a state, with counts by status, a line each."""
    failed = [row for row in rows if not row.answered]
    return [f"{r.short}: {r.said}{f' ({r.note})' if r.note else ''}" for r in failed]


def print_bench(table: BenchTable, console: Console) -> None:
    """Print a table of every scene, and the meaning of its columns."""
    for title, part in table.by_scene().items():
        print_columns(part.of_origin("python"), console, title=title, left=("method",))
        if in_cpp := part.of_origin("C++").rows:
            _print_in_cpp(part, in_cpp, console)
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
    if "C++ compiler" in machine:
        console.print(
            "C++: all states in a call, without Python in between, time of one; the settings are "
            "those of Python. x dense: against the fastest that is dense in C++.\n"
            f"{machine['C++ compiler']}, headers of {machine['C++ headers']}.",
            highlight=False,
            markup=False,
            soft_wrap=True,
        )


def _print_in_cpp(table: BenchTable, in_cpp: Sequence[BenchRow], console: Console) -> None:
    """Print the times in C++, one row per method, beside those in Python where they exist."""
    shown = Grid(title="in C++, and the same in Python", title_justify="left")
    for heading in ("method", "C++", "x dense", "error of a", "Python", "x dense", "error of a"):
        shown.add_column(heading, justify="left" if heading == "method" else "right")
    python = {row.method: row for row in table.rows if row.origin == "python"}
    for row in in_cpp:
        twin = python.get(row.method)
        cells = [number(row.bare_us, ".1f"), number(row.to_dense, ".2f"), number(row.error, ".0e")]
        if twin:
            us = twin.acceleration_us if twin.rows else twin.bare_us
            cells += [number(us, ".1f"), number(twin.to_dense, ".2f"), number(twin.error, ".0e")]
        shown.add_row(row.method, *cells)
    print_whole(shown, console)
