"""Commands that measure the library: stress, problem, drift, ladder.

`condyn_pin.cli.commands` has the rules that they follow.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.table import Table

from condyn_pin._core.show import print_whole
from condyn_pin.cli import arguments as arg
from condyn_pin.cli.output import (
    check_picture,
    check_written,
    console,
    exit_with_status,
    print_json,
    print_text,
    progress_bar,
    text_table,
    until_stopped,
)

if TYPE_CHECKING:
    from lab.drift import Contest, Growth
    from lab.extremes.report import Map
    from lab.extremes.verdicts import Outcome, Task

app = typer.Typer(
    help="Hard questions, benchmark problems, drift of integrators, and what smaller models cost.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
    context_settings={"help_option_names": ["-h", "--help"]},
)

# Hard questions

RobotsToStress = Annotated[
    list[str] | None,
    typer.Argument(
        help="Robots to test; four of them, and mechanisms, if none.",
    ),
]
SolversToStress = Annotated[
    str,
    typer.Option(
        "--solver",
        "--solvers",
        help="Comma-separated names of `condyn solvers`, or all.",
    ),
]
Families = Annotated[
    str,
    typer.Option(
        help="Comma-separated families; by default all except those of contact.",
    ),
]


@app.command()
def stress(
    robots: RobotsToStress = None,
    solver: SolversToStress = "all",
    families: Families = "",
    seeds: Annotated[int, typer.Option(min=1, help="Number of cases of each severity.")] = 1,
    seconds: Annotated[
        float, typer.Option(help="Stop after this time [s]; cases then run in mixed order.")
    ] = math.inf,
    plot: arg.Plot = None,
    csv: arg.Csv = None,
    as_json: arg.AsJson = False,
) -> None:
    """Test every method on hard cases; exits with 1 if an answer is wrong but reported as ok.

    Ctrl-C keeps the finished cases.
    """
    from condyn_pin._core._pin import VERSION_TEXT
    from condyn_pin.cli.words import names_in
    from condyn_pin.errors import InvalidArgument
    from lab.extremes.report import maps, read_csv, write_csv
    from lab.extremes.stress import stress as run

    if not seconds > 0:
        raise InvalidArgument(f"--seconds {seconds}: a number > 0 is needed")
    check_written(csv)
    if csv and csv.exists():
        read_csv(csv)  # whose other lines are kept
    check_picture(plot)
    todo = _tasks(robots, names_in(families), seeds, seconds)
    methods = [] if solver.lower() == "all" else [name.lower() for name in names_in(solver)]
    outcomes, stopped = until_stopped(
        lambda bar: run(todo, methods, seconds=seconds, progress=partial(bar, "cases"))
    )
    whole = not stopped and not math.isfinite(seconds)
    found = maps(outcomes)
    if as_json:
        print_json(_facts(outcomes, found))
    else:
        _print(outcomes, found if whole else [])
    if csv:
        write_csv(found, csv, VERSION_TEXT)
    if plot and found:
        from lab.extremes.report import save_maps

        save_maps(found, plot, f"Pinocchio {VERSION_TEXT}; ")
    exit_with_status(ok=not _defects(outcomes), stopped=stopped)


def _tasks(robots: list[str] | None, families: list[str], seeds: int, seconds: float) -> list[Task]:
    """Return the cases, in a mixed order if there is no time for all."""
    from lab.extremes.base import EXTREMES
    from lab.extremes.stress import ROBOTS, mixed, tasks

    if robots and not families:  # a robot is put through what any scene can be put through
        families = [name for name, family in EXTREMES.items() if family.any_scene]
    todo = tasks(families, robots or ROBOTS, seeds, heavy=not math.isfinite(seconds))
    return mixed(todo) if math.isfinite(seconds) else todo


def _defects(outcomes: Sequence[Outcome]) -> list[str]:
    """Return what must not be, a line each."""
    return [
        f"{one.verdict.name} {one.method}: {one.task} {one.said}"
        for one in outcomes
        if one.verdict.defect
    ]


def _print(outcomes: Sequence[Outcome], shown: Sequence[Map]) -> None:
    """Print the advice of some maps, the defects, and the counts of everything."""
    from condyn_pin._core._pin import VERSION_TEXT
    from lab.extremes.base import families
    from lab.extremes.report import counts

    known = families()
    for each in shown:
        print_text(f"{each.label}: {known[each.family].title}")
        for method in each.methods:
            print_text(f"    {each.advice(method)}")
    for defect in _defects(outcomes):
        print_text(defect)
    said = ", ".join(f"{n} {name.replace('_', ' ')}" for name, n in counts(outcomes).items())
    print_text(f"{len(outcomes)} cases on Pinocchio {VERSION_TEXT}: {said}")


def _facts(outcomes: Sequence[Outcome], found: Sequence[Map]) -> dict[str, Any]:
    """Return everything in the words of json."""
    from condyn_pin._core._pin import VERSION_TEXT
    from lab.extremes.report import counts

    return {
        "pinocchio": VERSION_TEXT,
        "cases": len(outcomes),
        "counts": counts(outcomes),
        "defects": _defects(outcomes),
        "maps": [_map(each) for each in found],
    }


def _map(each: Map) -> dict[str, Any]:
    """Return a map in the words of json, its cells in a row."""
    cells = [
        {
            "severity": severity,
            "method": method,
            "verdicts": [verdict.name.lower() for verdict in cell.verdicts],
            "error": cell.error,
        }
        for (severity, method), cell in each.cells.items()
    ]
    return {"family": each.family, "robot": each.robot, "cells": cells}


# Benchmark problems

ProblemName = Annotated[
    str,
    typer.Argument(
        help="Its name; without one, all are listed.",
    ),
]


@app.command()
def problem(
    name: ProblemName = "",
    n: Annotated[int | None, typer.Option(help="Size, such as the number of cells of A02.")] = None,
    dt: Annotated[float | None, typer.Option(help="Time step [s].")] = None,
    integrator: arg.IntegratorName = None,
    drift: arg.DriftName = None,
    gain: arg.Gain = None,
    solver: arg.SolverOrNone = None,
    duration: Annotated[
        float | None,
        typer.Option(help="Run only so long [s], without a verdict."),
    ] = None,
    as_json: arg.AsJson = False,
) -> None:
    """Run a benchmark problem and check the motion; exits with 1 if no limit is met."""
    choices = (n, dt, integrator, drift, gain, solver, duration)
    if not name and all(each is None for each in choices):
        _list_problems(as_json)
        return
    from condyn_pin._core.timing import machine
    from condyn_pin.cli.words import drift_of, integrator_of, solver_of
    from lab.problems import load_problem

    result = load_problem(name, n=n).run(
        dt=dt,
        integrator=integrator_of(integrator),
        drift=drift_of(drift, gain),
        solver=solver_of(solver) if solver else None,
        duration=duration,
    )
    if as_json:
        print_json(result.to_dict() | {"machine": machine()})
    else:
        print_text(str(result))
    exit_with_status(ok=bool(result.met), stopped=result.trajectory.status.name == "INTERRUPTED")


def _list_problems(as_json: bool) -> None:
    from lab.problems import PROBLEMS

    facts = {}
    table = text_table("problem", "title", "sizes", "seconds", "the finest limit", "source")
    for one in (kind() for kind in PROBLEMS.values()):
        sizes = {key: getattr(one, key) for key in one.sizes()}
        facts[one.name] = {
            "title": one.title,
            "sizes": sizes,
            "duration": one.duration,
            "limits": one.limits,
            "source": one.source,
        }
        said = ", ".join(f"{key} = {value}" for key, value in sizes.items())
        limit = f"{one.limits[-1].level} ({one.limits[-1].value:g})"
        table.add_row(one.name, one.title, said, f"{one.duration:g}", limit, one.source)
    if as_json:
        print_json(facts)
    else:
        console.print(table)


# Drift

_RATIOS = (0.5, 1.0, 2.0**0.5, 2.0)  # beta / alpha
_MEANING = (
    "A constraint that is kept to the last digit says nothing about energy. What keeps areas "
    "in the phase plane, as RATTLE does, keeps energy near its value for ever; gains and "
    "projections move the state after the step, and the map that does both is no longer one."
)


@app.command()
def drift(
    steps: Annotated[int, typer.Option(min=10, help="Steps of each long run.")] = 10_000,
    dt: Annotated[float, typer.Option(help="Step of the long runs [s].")] = 1e-2,
    plot: arg.Plot = None,
    as_json: arg.AsJson = False,
) -> None:
    """Show drift, stability limits of gains, and energy, on a pendulum whose rod is a constraint.

    Ctrl-C keeps the finished runs.
    """
    from condyn_pin.errors import InvalidArgument
    from condyn_pin.simulation.integrators.explicit import (
        ExplicitEuler,
        RungeKutta4,
        SemiImplicitEuler,
    )
    from lab.drift import contest, gap_growth

    if not 0 < dt < float("inf"):
        raise InvalidArgument(f"--dt {dt}: a number > 0 [s] is needed")
    check_picture(plot)
    explicit, semi, rk4 = ExplicitEuler(), SemiImplicitEuler(), RungeKutta4()
    growths = {
        "explicit Euler": gap_growth(explicit, dt=1e-3, steps=10_000),
        "Runge-Kutta 4": gap_growth(rk4, dt=1e-2, steps=2000),
    }
    found, stopped = until_stopped(
        lambda bar: contest(dt, steps, progress=lambda x: bar("pendulum", int(x * 1000), 1000))
    )
    if plot:
        from lab.drift import save_laboratory

        save_laboratory(growths, (semi, rk4), found, plot)
    if as_json:
        print_json(_drift_facts(growths, (explicit, semi, rk4), found) | {"steps": steps, "dt": dt})
    else:
        for table in _drift_tables(growths, (explicit, semi, rk4), found, steps, dt):
            print_whole(table, console)
        console.print(_MEANING)
    exit_with_status(stopped=stopped)


def _drift_facts(
    growths: Mapping[str, Growth], integrators: Sequence[Any], found: Sequence[Contest]
) -> dict[str, Any]:
    from condyn_pin.simulation.stability import stability_limit

    return {
        "growth": {
            name: {"gap": growth.violation[-1], "t": growth.t[-1], "power": growth.power}
            for name, growth in growths.items()
        },
        "stability_limits": {
            integrator.title: stability_limit(integrator) for integrator in integrators
        },
        "runs": {one.title: {"area": one.area, "errors": one.errors} for one in found},
    }


def _drift_tables(
    growths: Mapping[str, Growth],
    integrators: Sequence[Any],
    found: Sequence[Contest],
    steps: int,
    dt: float,
) -> Iterator[Table]:
    from condyn_pin.simulation.stability import stability_limit

    table = Table("without stabilisation", "gap at the end [m]", "grows like")
    for name, growth in growths.items():
        gap = f"{growth.violation[-1]:.1e} at {growth.t[-1]:g} s"
        table.add_row(name, gap, f"t^{growth.power:.2f}")
    yield table

    table = Table("alpha dt of Baumgarte below", *(f"beta = {r:.3g} alpha" for r in _RATIOS))
    for integrator in integrators:
        limits = (stability_limit(integrator, beta_per_alpha=ratio) for ratio in _RATIOS)
        table.add_row(integrator.title, *(f"{limit:.3f}" for limit in limits))
    yield table

    columns = ("gap [m]", "|J v| [m/s]", "energy [J], first tenth", "last tenth", "area per step")
    table = Table(f"{steps} steps of {1e3 * dt:g} ms", *columns, "status")
    for one in found:
        e = one.errors
        numbers = (f"{x:.1e}" for x in (e.violation, e.constraint_velocity, e.early, e.late))
        table.add_row(one.title, *numbers, f"1 {one.area:+.0e}", e.status)
    yield table


# Model hierarchies

ModelledName = Annotated[
    str,
    typer.Argument(
        help="A robot whose smaller models are known: cassie, talos.",
    ),
]


@app.command()
def ladder(robot: ModelledName, plot: arg.Plot = None, as_json: arg.AsJson = False) -> None:
    """Show smaller and smaller scenes of a robot, with their speed and error."""
    from lab.hierarchy import model_hierarchy, print_hierarchy, save_hierarchies

    check_picture(plot)
    with progress_bar() as progress:
        progress(f"{robot}: every model, about ten seconds", 0, 1)
        table = model_hierarchy(robot)
    if as_json:
        print_json(table.as_dict())
    else:
        print_hierarchy(table, console)
    if plot:
        save_hierarchies([table], plot)
