"""condyn problem: a benchmark problem with a known answer."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

from condyn_pin.cli.commands.arguments import (
    AsJson,
    DriftName,
    Gain,
    IntegratorName,
    ProblemName,
    SolverOrNone,
)
from condyn_pin.cli.commands.output import INTERRUPTED, console, print_json, say, words

if TYPE_CHECKING:
    from condyn_pin.lab.problems.base import Problem

PANEL = "Simulate"


def problem(
    name: ProblemName = "",
    n: Annotated[int | None, typer.Option(help="Its size, such as the cells of A02.")] = None,
    dt: Annotated[float | None, typer.Option(help="Step [s].")] = None,
    integrator: IntegratorName = None,
    drift: DriftName = None,
    gain: Gain = None,
    solver: SolverOrNone = None,
    duration: Annotated[
        float | None, typer.Option(help="A part of it [s]; only the whole has a verdict.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Run a benchmark problem and judge the motion; exits with 1 if no limit is met."""
    choices = (n, dt, integrator, drift, gain, solver, duration)
    if not name and all(each is None for each in choices):
        _list(as_json)
        return
    from condyn_pin._core.machine import machine
    from condyn_pin.cli.commands.words import drift_of, integrator_of, solver_of
    from condyn_pin.lab.problems import load_problem

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
        say(str(result))
    if result.trajectory.status.name == "INTERRUPTED":
        raise typer.Exit(INTERRUPTED)
    if not result.met:
        raise typer.Exit(1)


def _list(as_json: bool) -> None:
    from condyn_pin.lab.problems import PROBLEMS

    if as_json:
        print_json({kind.name: _facts(kind()) for kind in PROBLEMS.values()})
        return
    table = words("problem", "title", "sizes", "seconds", "the finest limit", "source")
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
