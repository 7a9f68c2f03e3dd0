"""condyn simulate: a motion from a posture, with its errors."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from condyn_pin.cli import arguments as arg
from condyn_pin.cli.output import (
    check_ending,
    check_written,
    exit_with_status,
    print_json,
    print_text,
)

if TYPE_CHECKING:
    from condyn_pin.simulation.trajectory import Trajectory


Friction = Annotated[
    float | None,
    typer.Option(help="Stand it on feet that may lift and slide, with this friction."),
]


@arg.of_a_robot
def simulate(
    source: arg.Source,
    contacts: arg.Contacts = "",
    loops: arg.Loops = True,
    posture: arg.Posture = None,
    friction: Friction = None,
    duration: Annotated[float, typer.Option(help="Duration of the motion [s].")] = 1.0,
    dt: Annotated[float, typer.Option(help="Time step [s].")] = 1e-3,
    integrator: arg.IntegratorName = None,
    drift: arg.DriftName = None,
    gain: arg.Gain = None,
    solver: arg.SolverOrNone = None,
    record: Annotated[int, typer.Option(help="Keep a sample every so many steps.")] = 1,
    save: Annotated[Path | None, typer.Option(help="Write the trajectory here (npz).")] = None,
    csv: Annotated[Path | None, typer.Option(help="Write the samples here.")] = None,
    as_json: arg.AsJson = False,
) -> None:
    """Simulate from a posture at rest, without torques; exits with 1 if it broke down.

    Ctrl-C keeps the motion so far.
    """
    from condyn_pin.cli.words import drift_of, feet_of, integrator_of, scene_of, solver_of
    from condyn_pin.simulation.run import simulate as simulate_scene

    check_ending(save, ".npz")
    check_written(save, csv)
    scene = scene_of(source, contacts, loops)
    feet = feet_of(scene.robot, friction)
    scene = replace(scene, contacts=feet)
    q, v = scene.state(posture, on_ground=bool(feet))
    found = simulate_scene(
        scene, q, v, duration=duration, dt=dt, record=record,
        integrator=integrator_of(integrator), drift=drift_of(drift, gain),
        solver=solver_of(solver) if solver else None,
    )  # fmt: skip
    if save:
        found.save(save)
    if csv:
        found.to_csv(csv)
    if as_json:
        print_json(_summary(found))
    else:
        print_text(str(found))
    exit_with_status(ok=found.status.ok, stopped=found.status.name == "INTERRUPTED")


def _summary(found: Trajectory) -> dict[str, object]:
    from condyn_pin._core.timing import machine

    run, energy = found.run, found.energy
    return {
        "robot": found.scene.robot.name,
        "status": found.status.word,
        "reason": found.reason,
        "t": float(found.t[-1]),
        "dt": run.dt,
        "integrator": repr(run.integrator),
        "drift": repr(run.drift),
        "solver": repr(run.solver),
        "violation": float(found.violation.max()),
        "constraint_velocity": float(found.constraint_velocity.max()),
        "energy_error": float(abs(energy.error).max()),
        "wall_time": run.wall_time,
        "q": found.q[-1].tolist(),
        "v": found.v[-1].tolist(),
        "machine": machine(),
    }


COMMANDS = (simulate,)
