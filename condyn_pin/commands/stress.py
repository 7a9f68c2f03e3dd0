"""condyn stress: every method on hard questions."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from condyn_pin.commands.arguments import AsJson
from condyn_pin.commands.output import check_files, console, print_json

if TYPE_CHECKING:
    from condyn_pin.extremes.stress_table import Map

PANEL = "Measure"


def stress(
    robots: Annotated[
        list[str] | None,
        typer.Argument(help="Robots to put through it; four of them, and mechanisms, if none."),
    ] = None,
    solver: Annotated[str, typer.Option(help="Names of `condyn solvers`, or all.")] = "all",
    families: Annotated[
        str, typer.Option(help="Comma-separated: families; all of them by default.")
    ] = "",
    seeds: Annotated[int, typer.Option(min=1, help="How many cases of each severity.")] = 1,
    seconds: Annotated[
        float, typer.Option(help="Stop after this time; cases come in a mixed order then.")
    ] = math.inf,
    plot: Annotated[Path | None, typer.Option(help="Draw the maps (png, svg, pdf).")] = None,
    csv: Annotated[Path | None, typer.Option(help="Write the table here.")] = None,
    as_json: AsJson = False,
) -> None:
    """Turn the dial from tame to absurd; exits with 1 if an answer is wrong without saying so."""
    from condyn_pin._pin import VERSION_TEXT
    from condyn_pin.extremes.base import EXTREMES
    from condyn_pin.extremes.stress import ROBOTS, mixed, tasks
    from condyn_pin.extremes.stress import stress as run
    from condyn_pin.extremes.stress_table import counts, maps, write_csv

    check_files(csv, None, plot, None)
    names = _names(families)
    if robots and not names:  # a robot is put through what any scene can be put through
        names = [name for name, family in EXTREMES.items() if family.any_scene]
    todo = tasks(names, robots or ROBOTS, seeds, heavy=not math.isfinite(seconds))
    if math.isfinite(seconds):
        todo = mixed(todo)
    methods = [] if solver == "all" else _names(solver)
    columns = (TextColumn("cases"), BarColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        bar = progress.add_task("cases", total=len(todo))
        outcomes = run(
            todo,
            methods,
            seconds=seconds,
            progress=lambda done, _: progress.update(bar, completed=done),
        )
    found = maps(outcomes)
    if not math.isfinite(seconds) and not as_json:
        for each in found:
            console.print(f"{each.label}: {EXTREMES[each.family].title}")
            for method in each.methods:
                console.print(f"    {each.advice(method)}")
    defects = [
        f"{outcome.verdict.name} {outcome.method}: {outcome.task} {outcome.said}"
        for outcome in outcomes
        if outcome.verdict.defect
    ]
    counted = counts(outcomes)
    if as_json:
        facts = {"pinocchio": VERSION_TEXT, "cases": len(outcomes), "counts": counted}
        print_json(facts | {"defects": defects, "maps": [_facts(each) for each in found]})
    else:
        for defect in defects:
            console.print(defect)
        said = ", ".join(f"{n} {name.replace('_', ' ')}" for name, n in counted.items())
        console.print(f"{len(outcomes)} cases on Pinocchio {VERSION_TEXT}: {said}")
    if csv:
        write_csv(found, csv, VERSION_TEXT)
    if plot:
        from condyn_pin.extremes.stress_plot import save_maps

        save_maps(found, plot, f"Pinocchio {VERSION_TEXT}; ")
    if defects:
        raise typer.Exit(1)


def _names(text: str) -> list[str]:
    return [name.strip() for name in text.split(",") if name.strip()]


def _facts(each: Map) -> dict[str, Any]:
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
