"""condyn problem: a benchmark problem with a known answer."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

from condyn_pin.commands.arguments import AsJson
from condyn_pin.commands.output import console, print_json

if TYPE_CHECKING:
    from condyn_pin.problems.base import Problem

PANEL = "Simulate"


def problem(
    name: Annotated[str, typer.Argument(help="Its name; without one they are listed.")] = "",
    n: Annotated[int | None, typer.Option(help="Its size, such as the cells of A02.")] = None,
    dt: Annotated[float | None, typer.Option(help="Step [s].")] = None,
    integrator: Annotated[str, typer.Option(help="Name of an integrator.")] = "",
    drift: Annotated[str, typer.Option(help="Name of a drift scheme.")] = "",
    gain: Annotated[float, typer.Option(help="Of Baumgarte, alpha = beta [1/s].")] = 10.0,
    solver: Annotated[str, typer.Option(help="A name of `condyn solvers`.")] = "",
    duration: Annotated[float | None, typer.Option(help="A part of it [s].")] = None,
    as_json: AsJson = False,
) -> None:
    """Run a benchmark problem and judge the motion; exits with 1 if no limit is met."""
    if not name:
        _list(as_json)
        return
    from condyn_pin.commands.words import drift_of, integrator_of, solver_of
    from condyn_pin.machine import machine
    from condyn_pin.problems.loading import load_problem

    result = load_problem(name, n=n).run(
        dt=dt,
        integrator=integrator_of(integrator) if integrator else None,
        drift=drift_of(drift, gain) if drift else None,
        solver=solver_of(solver, {}) if solver else None,
        duration=duration,
    )
    if as_json:
        print_json(result.to_dict() | {"machine": machine()})
    else:
        console.print(str(result))
    if not result.met:
        raise typer.Exit(1)


def _list(as_json: bool) -> None:
    from rich.table import Table

    from condyn_pin.problems import PROBLEMS

    if as_json:
        print_json({kind.name: _facts(kind()) for kind in PROBLEMS.values()})
        return
    table = Table("problem", "title", "sizes", "seconds", "the finest limit", "source")
    for kind in PROBLEMS.values():
        one = kind()
        finest = one.limits[-1]
        sizes = ", ".join(f"{key} = {getattr(one, key)}" for key in one.sizes())
        limit = f"{finest.level} ({finest.value:g})"
        table.add_row(one.name, one.title, sizes, f"{one.duration:g}", limit, one.source)
    console.print(table)


def _facts(one: Problem) -> dict[str, Any]:
    return {
        "title": one.title,
        "sizes": {key: getattr(one, key) for key in one.sizes()},
        "duration": one.duration,
        "limits": one.limits,
        "source": one.source,
    }
