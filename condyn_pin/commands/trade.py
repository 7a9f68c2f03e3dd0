"""condyn trade: what accuracy costs, and the cheapest solver that meets an error."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from condyn_pin.commands.output import check_files, console, progress_bar

if TYPE_CHECKING:
    from condyn_pin.trade.study import Study
    from condyn_pin.trade.table import Table

PANEL = "Measure"

_INTERRUPTED = 130  # as shells say it


def trade(
    robots: Annotated[
        list[str] | None, typer.Argument(help="Robots; the main ones if none.")
    ] = None,
    error: Annotated[
        float | None, typer.Option(help="Choose the fastest solver with no larger error.")
    ] = None,
    measure: Annotated[
        str, typer.Option(help="What the error is one of: acceleration, forces, derivatives, ...")
    ] = "acceleration",
    solvers: Annotated[
        str, typer.Option(help="Names of `condyn solvers`, all knobs turned; all by default.")
    ] = "",
    states: Annotated[int, typer.Option(help="Random closed states of each scene.")] = 20,
    quick: Annotated[bool, typer.Option(help="Fewer rounds.")] = False,
    jobs: Annotated[int, typer.Option(help="Processes that compute errors.", min=1)] = 1,
    results: Annotated[
        Path | None, typer.Option(help="Keep rows here as they come; a second run goes on.")
    ] = None,
    csv: Annotated[Path | None, typer.Option(help="Write the table here.")] = None,
    as_json: Annotated[Path | None, typer.Option("--json", help="Write the table here.")] = None,
    markdown: Annotated[Path | None, typer.Option(help="Write the table here.")] = None,
    plot: Annotated[Path | None, typer.Option(help="Write a picture here (png, svg, pdf).")] = None,
) -> None:
    """Measure time and error of every solver with every knob; name the cheapest for an error.

    Ctrl-C keeps what was measured.
    """
    from condyn_pin.bench import ROBOTS
    from condyn_pin.commands.words import swept_solvers_of
    from condyn_pin.errors import Interrupted
    from condyn_pin.trade.cheapest import check_error
    from condyn_pin.trade.clocks import TimingEffort
    from condyn_pin.trade.printing import print_table
    from condyn_pin.trade.study import Study

    if error is not None:
        check_error(error)
    check_files(csv, as_json, plot, None)
    check_files(markdown, None, None, None)
    study = Study(
        list(robots or ROBOTS),
        swept_solvers_of(solvers),
        states=states,
        measure=measure,
        effort=TimingEffort(rounds=20) if quick else TimingEffort(),
    )
    stopped = False
    try:
        table = _run(study, jobs, results)
    except Interrupted as stop:
        table, stopped = stop.table, True
    print_table(table, console)
    for path, write in ((csv, table.to_csv), (as_json, table.to_json)):
        if path:
            write(path)
    if markdown:
        markdown.write_text(table.to_markdown() + "\n", encoding="utf-8")
    if plot and table.rows:
        from condyn_pin.plots_trade import save_trade

        save_trade(table, plot)
    if stopped:
        typer.echo(f"stopped: {len(table.rows)} rows were measured", err=True)
        raise typer.Exit(_INTERRUPTED)
    if error is not None and not _choose(table, error):
        raise typer.Exit(1)


def _run(study: Study, jobs: int, results: Path | None) -> Table:
    """Run a study here, or its errors in some processes."""
    from concurrent.futures import ProcessPoolExecutor

    with progress_bar() as progress:
        if jobs == 1:
            return study.run(progress=progress, results=results)
        with ProcessPoolExecutor(jobs) as executor:
            return study.run(executor=executor, progress=progress, results=results)


def _choose(table: Table, error: float) -> bool:
    """Print the cheapest solver of each scene; return whether there is one for all."""
    from condyn_pin.errors import NotReached

    reached = True
    for scene, measure in dict.fromkeys((row.scene, row.measure) for row in table.rows):
        try:
            console.print(str(table.cheapest(error, scene=scene, measure=measure)))
        except NotReached as reason:
            console.print(f"{scene}: {reason}")
            reached = False
    return reached
