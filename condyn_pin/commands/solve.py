"""condyn solve: one posture, with the errors of the answer."""

from __future__ import annotations

import json
from typing import Annotated

import typer

from condyn_pin.commands.arguments import Contacts, Loops, Posture, RobotName
from condyn_pin.commands.output import console, finite
from condyn_pin.tolerances import SOLVED

PANEL = "Solve"


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
    from condyn_pin.commands.words import scene_of, solver_of
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
            "a": finite(solution.a.tolist()),
            "lam": finite(solution.lam.tolist()),
            "world_forces": {n: finite(f.tolist()) for n, f in solution.world_forces.items()},
            "forces": {name: finite(f.tolist()) for name, f in solution.forces.items()},
            "dynamics_error": finite(solution.dynamics_error),
            "constraint_error": finite(solution.constraint_error),
            "state_error": finite(list(solution.state_error)),
            "error_bound": finite(solution.error_bound),
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
