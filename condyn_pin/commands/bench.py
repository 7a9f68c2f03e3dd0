"""condyn bench: times and errors of the main methods."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from condyn_pin.commands.output import check_files, console

PANEL = "Measure"


def bench(
    robots: Annotated[
        list[str] | None, typer.Argument(help="Robots; the main ones if none.")
    ] = None,
    quick: Annotated[bool, typer.Option(help="Fewer states and rounds.")] = False,
    csv: Annotated[Path | None, typer.Option(help="Write the table here.")] = None,
    as_json: Annotated[Path | None, typer.Option("--json", help="Write the table here.")] = None,
    plot: Annotated[Path | None, typer.Option(help="Write a picture here (png, svg, pdf).")] = None,
    native: Annotated[Path | None, typer.Option(help="Merge a result of `make native`.")] = None,
    solvers: Annotated[
        str, typer.Option(help="Names of `condyn solvers`, or all; the main ones by default.")
    ] = "",
) -> None:
    """Time ABA, LCABA, proximal and dense KKT, with their errors, on the same states."""
    from condyn_pin.bench import FULL, QUICK, ROBOTS
    from condyn_pin.bench import bench as run
    from condyn_pin.bench_print import print_bench
    from condyn_pin.commands.words import solvers_of

    chosen = solvers_of(solvers)
    check_files(csv, as_json, plot, native)
    columns = (TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn())
    # drawn between rounds only: a thread that draws would take the interpreter from what is timed
    with Progress(
        *columns, console=Console(stderr=True), transient=True, auto_refresh=False
    ) as progress:
        tasks: dict[str, Any] = {}

        def advance(what: str, done: int, total: int) -> None:
            if what not in tasks:
                tasks[what] = progress.add_task(what, total=total)
            progress.update(tasks[what], completed=done, refresh=done % 20 == 0)

        effort = QUICK if quick else FULL
        table = run(robots or ROBOTS, solvers=chosen, effort=effort, progress=advance)
    if native:
        table = table.with_native(native)
    print_bench(table, console)
    if csv:
        table.to_csv(csv)
    if as_json:
        table.to_json(as_json)
    if plot:
        from condyn_pin.plots import save_bench

        save_bench(table, plot)
