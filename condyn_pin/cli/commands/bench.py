"""condyn bench: times and errors of the main methods."""

from __future__ import annotations

from typing import Annotated

import typer

from condyn_pin.cli import arguments as arg
from condyn_pin.cli.output import (
    check_picture,
    check_written,
    exit_with_status,
    for_people,
    until_stopped,
    write_table,
)

PANEL = "Measure"

SolversToBench = Annotated[
    str,
    typer.Option(
        help="Comma-separated names of `condyn solvers`, or all; the main ones by default.",
        autocompletion=arg.solver_names,
    ),
]


def bench(
    robots: arg.RobotNames = None,
    quick: arg.Quick = False,
    csv: arg.Csv = None,
    as_json: arg.TableJson = None,
    plot: arg.Plot = None,
    native: Annotated[
        bool, typer.Option("--native", help="Also time C++, if it is compiled.")
    ] = False,
    solvers: SolversToBench = "",
) -> None:
    """Time ABA, LCABA, proximal and dense KKT, with their errors, on the same states.

    Ctrl-C keeps the scenes that were measured.
    """
    from condyn_pin.cli.words import solvers_of
    from condyn_pin.study.bench import FULL, QUICK, ROBOTS
    from condyn_pin.study.bench import bench as run
    from condyn_pin.study.printing import print_bench

    chosen, effort = solvers_of(solvers), QUICK if quick else FULL
    check_written(csv, as_json)
    check_picture(plot)
    table, stopped = until_stopped(
        lambda progress: run(
            robots or ROBOTS, solvers=chosen, effort=effort, native=native, progress=progress
        )
    )
    print_bench(table, for_people(as_json))
    write_table(table, csv=csv, as_json=as_json)
    if plot and table.rows:
        from condyn_pin.study.plots import save_bench

        save_bench(table, plot)
    exit_with_status(stopped=stopped)
