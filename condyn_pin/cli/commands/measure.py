"""Commands that measure: a timing of the main job, and time against error."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from condyn_pin.cli import arguments as arg
from condyn_pin.cli.output import (
    Report,
    check_picture,
    check_written,
    exit_with_status,
    for_people,
    progress_bar,
    until_stopped,
    warn,
    write_json,
    write_table,
)
from condyn_pin.errors import InvalidArgument, NotReached

if TYPE_CHECKING:
    from rich.console import Console

    from condyn_pin.dynamics.scene import Scene
    from condyn_pin.study.study import Study
    from condyn_pin.study.table import Table
    from condyn_pin.study.tables import Method

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
    from condyn_pin.study.table import print_bench

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


Measure = Annotated[
    str,
    typer.Option(
        help="The quantity whose error counts: acceleration, forces, derivatives, contact, "
        "trajectory or gradients.",
        autocompletion=arg.names_of("study", "MEASURES"),
    ),
]
Swept = Annotated[
    str,
    typer.Option(
        help="Comma-separated names of `condyn solvers`, of contact solvers or of routes, each "
        "with the parameters worth a look; all by default.",
        autocompletion=arg.solver_names,
    ),
]

Steps = Annotated[
    str | None,
    typer.Option(help="Steps of trajectory, contact or gradients, comma-separated [s]."),
]
Error = Annotated[
    float | None, typer.Option(help="Choose the fastest solver with no larger error.")
]
States = Annotated[int, typer.Option(help="Random closed states of each scene.", min=1)]
Noise = Annotated[
    float,
    typer.Option(help="What sensors are off by [rad, m; per second]; truth is closed.", min=0.0),
]
Jobs = Annotated[int, typer.Option(help="Processes that compute errors.", min=1)]
Results = Annotated[
    Path | None,
    typer.Option(help="Save rows here as they come; the next run resumes."),
]
Markdown = Annotated[Path | None, typer.Option(help="Write the table here.")]
Tune = Annotated[
    bool, typer.Option("--tune", help="Choose for one scene, and save it for `tuned`.")
]
Save = Annotated[bool, typer.Option(help="With --tune: save the choice.")]

# Options that say something only with --tune, and only without it.
_OF_TUNE = ("contacts", "loops", "variant", "save")
_OF_STUDY = (
    "dt", "integrator", "drift", "states", "noise", "quick", "jobs", "results", "csv", "markdown",
    "plot",
)  # fmt: skip


def trade(
    context: typer.Context,
    robots: arg.RobotNames = None,
    error: Error = None,
    measure: Measure = "acceleration",
    dt: Steps = None,
    integrator: arg.IntegratorName = None,
    drift: arg.DriftName = None,
    solvers: Swept = "",
    states: States = 20,
    noise: Noise = 0.0,
    quick: arg.Quick = False,
    jobs: Jobs = 1,
    results: Results = None,
    csv: arg.Csv = None,
    as_json: arg.TableJson = None,
    markdown: Markdown = None,
    plot: arg.Plot = None,
    tune: Tune = False,
    save: Save = True,
    contacts: arg.Contacts = "",
    loops: arg.Loops = True,
    variant: arg.Variant = None,
) -> None:
    """Measure time and error of every solver with every parameter; name the cheapest for an error.

    Ctrl-C keeps what was measured. Exits with 1 if no solver meets the error. With `--tune` a
    short study of one scene, with its `--contacts`, chooses for an error of 1e-8 or `--error`.
    """
    from condyn_pin.cli.words import measures_of, scene_of, swept_solvers_of
    from condyn_pin.study.bench import ROBOTS
    from condyn_pin.study.case import TimingEffort
    from condyn_pin.study.fresh import check_error
    from condyn_pin.study.study import Study

    _refuse(context, _OF_STUDY if tune else _OF_TUNE, "with" if tune else "without")
    if error is not None:
        check_error(error)
    check_written(csv, as_json, markdown)
    check_picture(plot)
    measures = measures_of(measure, dt, integrator, drift)
    chosen = swept_solvers_of(solvers, measures[0])
    if tune:
        if robots is None or len(robots) != 1:
            raise InvalidArgument("--tune chooses for one scene: name one robot")
        scene = scene_of(arg.Source(robots[0], variant), contacts, loops)
        _tune(scene, error, measure, chosen, save, as_json)
        return
    effort = TimingEffort(rounds=20) if quick else TimingEffort()
    study = Study(
        list(robots or ROBOTS), chosen, states=states, measure=measures, effort=effort, noise=noise
    )
    table, stopped = until_stopped(lambda progress: _run(study, jobs, results, progress))
    _print_table(table, csv, as_json, markdown, plot)
    if stopped:
        warn(f"stopped: {len(table.rows)} rows were measured")
    reached = stopped or error is None or _choose(table, error, for_people(as_json))
    exit_with_status(ok=reached, stopped=stopped)


def _refuse(context: typer.Context, options: tuple[str, ...], where: str) -> None:
    """Refuse options without effect with --tune, or without it."""
    for option in context.command.params:
        source = context.get_parameter_source(str(option.name))
        if option.name in options and source is not None and source.name != "DEFAULT":
            raise InvalidArgument(f"{option.opts[0]} has no effect {where} --tune: leave it out")


def _tune(
    scene: Scene,
    error: float | None,
    measure: str,
    solvers: tuple[Method, ...] | None,
    save: bool,
    as_json: Path | None,
) -> None:
    """Choose the fastest solver of one scene, and keep the choice."""
    from condyn_pin._core.tolerances import SOLVED
    from condyn_pin.study.fresh import check_folder, path_of
    from condyn_pin.study.study import choose, plan_for, write_plan_of

    if save:
        check_folder()
    error = SOLVED if error is None else error
    try:
        with progress_bar() as progress:
            choice = choose(scene, error, measure=measure, solvers=solvers, progress=progress)
    except NotReached as reason:
        if as_json:
            nothing = {"measure": measure, "error": error, "solver": None, "reason": str(reason)}
            write_json(nothing, as_json)
        warn(f"condyn: {reason}")
        raise typer.Exit(1) from reason
    plan = write_plan_of(scene, choice) if save else plan_for(scene, choice)
    if as_json:
        write_json(plan, as_json)
    console = for_people(as_json)
    console.print(str(choice), soft_wrap=True)
    if save:
        path = path_of(plan.fingerprint, plan.measure, plan.error)
        console.print(f"kept in {path}", soft_wrap=True)
        console.print(f"solve(scene, q, v, tau, solver=tuned(scene, {error:g}))", soft_wrap=True)


def _print_table(
    table: Table, csv: Path | None, as_json: Path | None, markdown: Path | None, plot: Path | None
) -> None:
    """Print a table, and write it to the files that are given."""
    from condyn_pin._core.files import write_text
    from condyn_pin.study.table import print_table

    print_table(table, for_people(as_json))
    write_table(table, csv=csv, as_json=as_json)
    if markdown:
        write_text(markdown, table.to_markdown() + "\n")
    if plot and table.rows:
        from condyn_pin.study.plots import save_trade

        save_trade(table, plot)


def _run(study: Study, jobs: int, results: Path | None, progress: Report) -> Table:
    """Table of a study, its errors computed here or in `jobs` processes."""
    from concurrent.futures import ProcessPoolExecutor

    if jobs == 1:
        return study.run(progress=progress, results=results)
    with ProcessPoolExecutor(jobs) as executor:
        return study.run(executor=executor, progress=progress, results=results)


def _choose(table: Table, error: float, console: Console) -> bool:
    """Print the cheapest solver of each scene; True if every scene has one."""
    reached = True
    for scene, measure in dict.fromkeys((row.scene, row.measure) for row in table.rows):
        try:
            said = str(table.cheapest(error, scene=scene, measure=measure))
        except NotReached as reason:
            said, reached = f"{scene}: {reason}", False
        console.print(said, soft_wrap=True)
    return reached


COMMANDS = (
    bench,
    trade,
)
