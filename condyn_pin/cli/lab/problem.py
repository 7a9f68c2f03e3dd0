"""condyn lab problem: a benchmark problem with a known answer."""

from __future__ import annotations

from typing import Annotated

import typer

from condyn_pin.cli import arguments as arg
from condyn_pin.cli.output import console, leave, print_json, say, words

PANEL = "Simulate"

ProblemName = Annotated[
    str,
    typer.Argument(
        help="Its name; without one, all are listed.",
        autocompletion=arg.names_of("lab", "PROBLEMS"),
    ),
]


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
        _list(as_json)
        return
    from condyn_pin._core.timing import machine
    from condyn_pin.cli.words import drift_of, integrator_of, solver_of
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
    leave(ok=bool(result.met), stopped=result.trajectory.status.name == "INTERRUPTED")


def _list(as_json: bool) -> None:
    from condyn_pin.lab.problems import PROBLEMS

    facts = {}
    table = words("problem", "title", "sizes", "seconds", "the finest limit", "source")
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
