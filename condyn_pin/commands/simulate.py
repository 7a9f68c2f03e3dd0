"""condyn simulate: a motion from a posture, with its errors."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from condyn_pin.commands.arguments import AsJson, Contacts, Loops, Posture, RobotName, Variant
from condyn_pin.commands.output import check_files, console, print_json
from condyn_pin.errors import InvalidArgument

if TYPE_CHECKING:
    from condyn_pin.simulation.trajectory import Trajectory

PANEL = "Simulate"


def simulate(
    robot: RobotName,
    contacts: Contacts = "",
    loops: Loops = True,
    posture: Posture = None,
    duration: Annotated[float, typer.Option(help="[s]")] = 1.0,
    dt: Annotated[float, typer.Option(help="The step [s].")] = 1e-3,
    integrator: Annotated[
        str, typer.Option(help="Such as rungekutta4, semiimpliciteuler or rattle.")
    ] = "rungekutta4",
    drift: Annotated[
        str | None,
        typer.Option(
            help="nodrift, baumgarte, projection or poststabilization; the last one by default "
            "where it is needed."
        ),
    ] = None,
    gain: Annotated[float, typer.Option(help="alpha = beta of baumgarte [1/s].")] = 30.0,
    solver: Annotated[str | None, typer.Option(help="A name of `condyn solvers`.")] = None,
    record: Annotated[int, typer.Option(help="Every which sample is kept.")] = 1,
    save: Annotated[Path | None, typer.Option(help="Write the trajectory here (npz).")] = None,
    csv: Annotated[Path | None, typer.Option(help="Write the samples here.")] = None,
    variant: Variant = None,
    as_json: AsJson = False,
) -> None:
    """Simulate from a posture at rest, without torques; exits with 1 if it broke down."""
    from condyn_pin.commands.words import drift_of, integrator_of, scene_of, solver_of
    from condyn_pin.simulation.run import simulate as simulate_scene

    scene = scene_of(robot, contacts, loops, variant)
    check_files(csv, save, None, None)
    if save and save.suffix != ".npz":
        raise InvalidArgument(f"{save}: the ending has to be .npz")
    q, v = scene.state(posture)
    found = simulate_scene(
        scene,
        q,
        v,
        duration=duration,
        dt=dt,
        integrator=integrator_of(integrator),
        drift=drift_of(drift, gain) if drift else None,
        solver=solver_of(solver, {}) if solver else None,
        record=record,
    )
    if save:
        found.save(save)
    if csv:
        found.to_csv(csv)
    if as_json:
        print_json(_summary(found))
    else:
        console.print(str(found))
    if not found.status.ok:
        raise typer.Exit(1)


def _summary(found: Trajectory) -> dict[str, object]:
    from condyn_pin.machine import machine

    run, energy = found.run, found.energy
    return {
        "robot": found.scene.robot.name,
        "status": found.status.name.lower(),
        "reason": found.reason,
        "t": float(found.t[-1]),
        "dt": run.dt,
        "integrator": repr(run.integrator),
        "drift": repr(run.drift),
        "solver": repr(run.solver),
        "violation": float(found.violation.max()),
        "slip": float(found.slip.max()),
        "energy_error": float(abs(energy.error).max()),
        "wall_time": run.wall_time,
        "q": found.q[-1].tolist(),
        "v": found.v[-1].tolist(),
        "machine": machine(),
    }
