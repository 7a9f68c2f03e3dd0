"""condyn trade: what accuracy costs, and the cheapest solver that meets an error."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from condyn_pin.cli.commands.arguments import (
    Csv,
    Measure,
    Plot,
    Quick,
    RobotNames,
    SolversToSweep,
    TableJson,
)
from condyn_pin.cli.commands.output import (
    INTERRUPTED,
    check_picture,
    check_written,
    for_people,
    progress_bar,
    warn,
    write_json,
)

if TYPE_CHECKING:
    from rich.console import Console

    from condyn_pin.study.study import Study
    from condyn_pin.study.table import Table

PANEL = "Measure"


def trade(
    robots: RobotNames = None,
    error: Annotated[
        float | None, typer.Option(help="Choose the fastest solver with no larger error.")
    ] = None,
    measure: Measure = "acceleration",
    solvers: SolversToSweep = "",
    states: Annotated[int, typer.Option(help="Random closed states of each scene.", min=1)] = 20,
    quick: Quick = False,
    jobs: Annotated[int, typer.Option(help="Processes that compute errors.", min=1)] = 1,
    results: Annotated[
        Path | None, typer.Option(help="Keep rows here as they come; a second run goes on.")
    ] = None,
    csv: Csv = None,
    as_json: TableJson = None,
    markdown: Annotated[Path | None, typer.Option(help="Write the table here.")] = None,
    plot: Plot = None,
) -> None:
    """Measure time and error of every solver with every parameter; name the cheapest for an error.

    Ctrl-C keeps what was measured. Exits with 1 if no solver meets the error.
    """
    from condyn_pin.cli.commands.words import swept_solvers_of
    from condyn_pin.errors import Interrupted
    from condyn_pin.study.bench import ROBOTS
    from condyn_pin.study.cheapest import check_error
    from condyn_pin.study.clocks import TimingEffort
    from condyn_pin.study.study import Study

    if error is not None:
        check_error(error)
    check_written(csv, as_json, markdown)
    check_picture(plot)
    effort = TimingEffort(rounds=20) if quick else TimingEffort()
    chosen = swept_solvers_of(solvers)
    study = Study(list(robots or ROBOTS), chosen, states=states, measure=measure, effort=effort)
    try:
        table = _run(study, jobs, results)
    except Interrupted as stop:
        _show(stop.table, csv, as_json, markdown, plot)
        warn(f"stopped: {len(stop.table.rows)} rows were measured")
        raise typer.Exit(INTERRUPTED) from stop
    _show(table, csv, as_json, markdown, plot)
    if error is not None and not _choose(table, error, for_people(as_json)):
        raise typer.Exit(1)


def _show(
    table: Table, csv: Path | None, as_json: Path | None, markdown: Path | None, plot: Path | None
) -> None:
    """Print a table, and write it to the files that are wanted."""
    from condyn_pin._core.files.beside import write_text
    from condyn_pin.study.printing import print_table

    print_table(table, for_people(as_json))
    if csv:
        table.to_csv(csv)
    if as_json:
        write_json(table, as_json)
    if markdown:
        write_text(markdown, table.to_markdown() + "\n")
    if plot and table.rows:
        from condyn_pin.study.plots import save_trade

        save_trade(table, plot)


def _run(study: Study, jobs: int, results: Path | None) -> Table:
    """Run a study here, or its errors in some processes."""
    from concurrent.futures import ProcessPoolExecutor

    with progress_bar() as progress:
        if jobs == 1:
            return study.run(progress=progress, results=results)
        with ProcessPoolExecutor(jobs) as executor:
            return study.run(executor=executor, progress=progress, results=results)


def _choose(table: Table, error: float, console: Console) -> bool:
    """Print the cheapest solver of each scene; return whether there is one for all."""
    from condyn_pin.errors import NotReached

    reached = True
    for scene, measure in dict.fromkeys((row.scene, row.measure) for row in table.rows):
        try:
            choice = table.cheapest(error, scene=scene, measure=measure)
            console.print(str(choice), soft_wrap=True)
        except NotReached as reason:
            console.print(f"{scene}: {reason}", soft_wrap=True)
            reached = False
    return reached
