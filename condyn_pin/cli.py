"""The command line: condyn robots, show, assemble, solvers, solve, export, bench, doctor."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from typing import Annotated, Any

# Before numpy is imported: two threads of a BLAS on a 50 x 50 matrix only make it slower, and
# times are compared on one core.
os.environ.setdefault("OMP_NUM_THREADS", "1")

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Column, Table

from condyn_pin import __version__
from condyn_pin.errors import CondynError, InvalidArgument
from condyn_pin.tolerances import SOLVED

app = typer.Typer(
    help="Constrained rigid-body dynamics on Pinocchio: solve it, prove it, time it.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
# Tables keep their columns: a narrow terminal, or a file, gets long lines rather than cut numbers.
console = Console(width=max(Console().width, 118), markup=False)

RobotName = Annotated[str, typer.Argument(help="A name of `condyn robots`, or a path.")]
Contacts = Annotated[
    str,
    typer.Option(
        help="Comma-separated: names of ready-made contacts, or FRAME:KIND with the kind "
        "point, surface, line or planar."
    ),
]
Loops = Annotated[bool, typer.Option(help="Include the loops of the robot.")]
Posture = Annotated[str | None, typer.Option(help="Posture; the first one by default.")]


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"condyn_pin {__version__}")
        raise typer.Exit


@app.callback()
def options(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Say which.")
    ] = False,
) -> None:
    """Constrained rigid-body dynamics on Pinocchio: solve it, prove it, time it."""


@app.command()
def robots() -> None:
    """List what can be loaded; `condyn show` has source and licence in full."""
    from condyn_pin.load import available_robots

    table = Table("robot", "nq", "nv", "mass [kg]", "loops", "postures", "file", "licence")
    for column in table.columns[1:5]:
        column.justify = "right"
    table.columns[6].overflow = "fold"  # a name that is cut helps nobody
    for load in available_robots().values():
        robot = load()
        table.add_row(
            robot.name,
            str(robot.nq),
            str(robot.nv),
            f"{robot.mass:.4f}",
            str(len(robot.loops)),
            ", ".join(robot.postures),
            Path(robot.source).name,
            robot.licence.split(" (")[0],
        )
    console.print(table)


@app.command()
def show(
    robot: RobotName,
    contacts: Contacts = "",
    loops: Loops = True,
    posture: Posture = None,
    frames: Annotated[bool, typer.Option(help="List the frames that constraints can use.")] = False,
    ladder: Annotated[
        bool, typer.Option("--ladder", help="Show smaller scenes instead, with their price.")
    ] = False,
    plot: Annotated[Path | None, typer.Option(help="Draw the ladder (png, svg, pdf).")] = None,
) -> None:
    """Show what a scene contains, what is redundant, and what is not used."""
    if ladder:
        from condyn_pin.smaller.ladder_print import show_ladder

        _check_before_the_run(None, None, plot, None)
        show_ladder(robot, plot, console)
        return
    if plot:
        raise InvalidArgument("--plot draws a ladder; add --ladder")
    from condyn_pin.cli_words import scene_of

    scene = scene_of(robot, contacts, loops)
    summary = scene.summary(scene.state(posture)[0] if posture else None)
    table = Table("", summary.robot, show_header=True)
    for label, text in summary.facts().items():
        table.add_row(label, text)
    for name, kind, rows in summary.constraints:
        table.add_row("constraint", f"{name}: {kind}, {rows} rows")
    for text in summary.unused:
        table.add_row("not used", text)
    for text in summary.notes:
        table.add_row("note", text)
    table.add_row("postures", ", ".join(scene.robot.postures) or "none")
    table.add_row("ready contacts", ", ".join(c.name for c in scene.robot.contacts) or "none")
    if frames:
        table.add_row("frames", ", ".join(scene.robot.frames))
    console.print(table)


@app.command()
def assemble(
    robot: RobotName,
    loops: Loops = True,
    posture: Posture = None,
    fixed: Annotated[str, typer.Option(help="Comma-separated: joints that keep their value.")] = "",
    limits: Annotated[bool, typer.Option(help="Keep the joints within their limits.")] = True,
) -> None:
    """Close the loops from a posture as it is described; exits with 1 if that cannot be."""
    from condyn_pin.cli_words import scene_of

    scene = scene_of(robot, "", loops)
    held = [name.strip() for name in fixed.split(",") if name.strip()]
    assembly = scene.assemble(scene.guess(posture), fixed=held, within_limits=limits, throw=False)
    console.print(str(assembly))
    for name in scene.robot.joints:
        joint = scene.robot.model.joints[scene.robot.model.getJointId(name)]
        values = assembly.q[joint.idx_q : joint.idx_q + joint.nq]
        console.print(f"{name:<28} {' '.join(f'{value:.9g}' for value in values)}")
    if not assembly.status.ok:
        raise typer.Exit(1)


@app.command()
def solvers() -> None:
    """List the solvers: what each takes, what it costs, when to use it, its knobs."""
    from condyn_pin.solver_table import solver_rows

    table = Table(
        "solver", "takes", "cost", "when to use it", Column("knobs", width=24), show_lines=True
    )
    for row in solver_rows():
        takes = f"{row.kinds}\nredundant rows, singular states: {row.redundant}"
        table.add_row(row.name, takes, row.cost, row.use, row.knobs)
    console.print(table)


@app.command()
def solve(
    robot: RobotName,
    contacts: Contacts = "",
    loops: Loops = True,
    posture: Posture = None,
    solver: Annotated[str, typer.Option(help="A name of `condyn solvers`.")] = "proximal",
    mu: Annotated[float | None, typer.Option(help="Weight or damping [1/kg].")] = None,
    max_iterations: Annotated[int | None, typer.Option(help="Limit of iterations.")] = None,
    accuracy: Annotated[float, typer.Option(help="Error of a that is good enough.")] = SOLVED,
    as_json: Annotated[bool, typer.Option("--json", help="Print json.")] = False,
) -> None:
    """Solve a posture at rest, with zero torque; exits with 1 if the status is not ok."""
    from condyn_pin.cli_words import scene_of, solver_of
    from condyn_pin.verbs import solve as solve_scene

    scene = scene_of(robot, contacts, loops)
    q, v = scene.state(posture)
    chosen = solver_of(solver, {"mu": mu, "max_iterations": max_iterations})
    solution = solve_scene(scene, q, v, 0 * v, solver=chosen, accuracy=accuracy, throw=False)
    if as_json:
        from condyn_pin.machine import machine

        answer = {
            "robot": scene.robot.name,
            "solver": repr(chosen),
            "status": solution.status.name.lower(),
            "q": q.tolist(),
            "a": _finite(solution.a.tolist()),
            "lam": _finite(solution.lam.tolist()),
            "world_forces": {n: _finite(f.tolist()) for n, f in solution.world_forces.items()},
            "forces": {name: _finite(f.tolist()) for name, f in solution.forces.items()},
            "dynamics_error": _finite(solution.dynamics_error),
            "constraint_error": _finite(solution.constraint_error),
            "state_error": _finite(list(solution.state_error)),
            "error_bound": _finite(solution.error_bound),
            "iterations": solution.iterations,
            "solve_time": solution.solve_time,
            "machine": machine(),
        }
        typer.echo(json.dumps(answer, indent=1))
    else:
        console.print(f"{scene.robot.name}, {chosen!r}")
        console.print(str(solution))
        for note in scene.rank(q).notes:
            console.print(f"note: {note}")
    if not solution.status.ok:
        typer.echo(str(solution.status), err=True)
        raise typer.Exit(1)


@app.command()
def export(
    robot: RobotName,
    mjcf: Annotated[Path, typer.Option(help="Write the robot with its loops here, for MuJoCo.")],
    without: Annotated[str, typer.Option(help="Comma-separated: loops to leave out.")] = "",
) -> None:
    """Write a robot in another format."""
    from condyn_pin.load import load_robot

    text = load_robot(robot).to_mjcf(without=[name for name in without.split(",") if name])
    try:
        mjcf.write_text(text, encoding="utf-8")
    except OSError as error:
        raise InvalidArgument(f"{mjcf}: cannot be written: {error.strerror}") from error


@app.command()
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
    from condyn_pin.cli_words import solvers_of

    chosen = solvers_of(solvers)
    _check_before_the_run(csv, as_json, plot, native)
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


def _check_before_the_run(
    csv: Path | None, as_json: Path | None, plot: Path | None, native: Path | None
) -> None:
    """Refuse what would only fail when everything has been measured."""
    from condyn_pin.bench_table import BenchTable
    from condyn_pin.plots import PICTURES, require_matplotlib

    for path in (csv, as_json, plot):
        if path and not path.absolute().parent.is_dir():
            raise InvalidArgument(f"{path}: there is no folder {path.parent}; make it first")
    if plot:
        require_matplotlib()
        if plot.suffix not in PICTURES:
            raise InvalidArgument(f"{plot}: the ending says the format: {', '.join(PICTURES)}")
    if native:
        BenchTable((), {}).with_native(native)


@app.command()
def doctor() -> None:
    """Say what is installed, whether it fits together, and the line that mends it."""
    from condyn_pin.doctor import diagnose

    found = diagnose()
    table = Table("", found.platform)
    for name, version in found.versions.items():
        table.add_row(name, version)
    for name, text in found.features.items():
        table.add_row(name, text)
    console.print(table)
    for finding in found.findings:
        console.print(f"wrong: {finding}", style="bold red")
    if found.remedy:
        typer.echo("This mends it:")
        typer.echo(f"  {found.remedy}")
        raise typer.Exit(1)
    console.print("Everything fits together.")


def _finite(value: Any) -> Any:
    """Return the value with None in place of what json has no word for."""
    if isinstance(value, list):
        return [_finite(entry) for entry in value]
    return value if -float("inf") < value < float("inf") else None


def main() -> None:
    """Run the command line; an error of this library is a sentence, not a traceback."""
    try:
        app()
    except CondynError as error:
        typer.echo(f"condyn: {error}", err=True)
        sys.exit(2)
