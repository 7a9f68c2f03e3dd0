"""condyn lab stress: every method on hard questions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any

import typer

from condyn_pin.cli import arguments as arg
from condyn_pin.cli.output import (
    check_picture,
    check_written,
    leave,
    print_json,
    say,
    until_stopped,
)

if TYPE_CHECKING:
    from condyn_pin.lab.extremes.report import Map
    from condyn_pin.lab.extremes.verdicts import Outcome, Task

PANEL = "Measure"

RobotsToStress = Annotated[
    list[str] | None,
    typer.Argument(
        help="Robots to test; four of them, and mechanisms, if none.",
        autocompletion=arg.robot_names,
    ),
]
SolversToStress = Annotated[
    str,
    typer.Option(
        "--solver",
        "--solvers",
        help="Comma-separated names of `condyn solvers`, or all.",
        autocompletion=arg.solver_names,
    ),
]
Families = Annotated[
    str,
    typer.Option(
        help="Comma-separated families; by default all except those of contact.",
        autocompletion=arg.names_of("lab", "EXTREMES"),
    ),
]


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
    from condyn_pin.lab.extremes.report import maps, read_csv, write_csv
    from condyn_pin.lab.extremes.stress import stress as run

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
        from condyn_pin.lab.extremes.report import save_maps

        save_maps(found, plot, f"Pinocchio {VERSION_TEXT}; ")
    leave(ok=not _defects(outcomes), stopped=stopped)


def _tasks(robots: list[str] | None, families: list[str], seeds: int, seconds: float) -> list[Task]:
    """Return the cases, in a mixed order if there is no time for all."""
    from condyn_pin.lab.extremes.base import EXTREMES
    from condyn_pin.lab.extremes.stress import ROBOTS, mixed, tasks

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
    from condyn_pin.lab.extremes.base import families
    from condyn_pin.lab.extremes.report import counts

    known = families()
    for each in shown:
        say(f"{each.label}: {known[each.family].title}")
        for method in each.methods:
            say(f"    {each.advice(method)}")
    for defect in _defects(outcomes):
        say(defect)
    said = ", ".join(f"{n} {name.replace('_', ' ')}" for name, n in counts(outcomes).items())
    say(f"{len(outcomes)} cases on Pinocchio {VERSION_TEXT}: {said}")


def _facts(outcomes: Sequence[Outcome], found: Sequence[Map]) -> dict[str, Any]:
    """Return everything in the words of json."""
    from condyn_pin._core._pin import VERSION_TEXT
    from condyn_pin.lab.extremes.report import counts

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
