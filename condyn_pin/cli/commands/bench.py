"""condyn bench: times and errors of the main methods."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from condyn_pin.cli.commands.arguments import (
    Csv,
    Plot,
    Quick,
    RobotNames,
    SolversToBench,
    TableJson,
)
from condyn_pin.cli.commands.output import (
    INTERRUPTED,
    check_picture,
    check_written,
    for_people,
    progress_bar,
    write_json,
)

PANEL = "Measure"


def bench(
    robots: RobotNames = None,
    quick: Quick = False,
    csv: Csv = None,
    as_json: TableJson = None,
    plot: Plot = None,
    native: Annotated[Path | None, typer.Option(help="Merge a result of `make native`.")] = None,
    solvers: SolversToBench = "",
) -> None:
    """Time ABA, LCABA, proximal and dense KKT, with their errors, on the same states.

    Ctrl-C keeps the scenes that were measured.
    """
    from condyn_pin.cli.commands.words import solvers_of
    from condyn_pin.errors import Interrupted
    from condyn_pin.study.bench import FULL, QUICK, ROBOTS
    from condyn_pin.study.bench import bench as run
    from condyn_pin.study.bench_table import BenchTable
    from condyn_pin.study.printing import print_bench

    chosen, effort, stopped = solvers_of(solvers), QUICK if quick else FULL, False
    beside = BenchTable((), {}).with_native(native) if native else BenchTable((), {})
    check_written(csv, as_json)
    check_picture(plot)
    try:
        with progress_bar() as progress:
            table = run(robots or ROBOTS, solvers=chosen, effort=effort, progress=progress)
    except Interrupted as stop:
        table, stopped = stop.table, True
    table = BenchTable(table.rows + beside.rows, table.machine | beside.machine)
    print_bench(table, for_people(as_json))
    if csv:
        table.to_csv(csv)
    if as_json:
        write_json(table, as_json)
    if plot and table.rows:
        from condyn_pin.study.plots import save_bench

        save_bench(table, plot)
    if stopped:
        raise typer.Exit(INTERRUPTED)
