"""condyn solve: one posture, with the errors of the answer."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer

from condyn_pin._core.tolerances import SOLVED
from condyn_pin.cli import arguments as arg
from condyn_pin.cli.output import exit_with_status, print_json, print_text, warn

if TYPE_CHECKING:
    from condyn_pin.dynamics.solution import Solution

PANEL = "Solve"


@arg.of_a_robot
def solve(
    source: arg.Source,
    contacts: arg.Contacts = "",
    loops: arg.Loops = True,
    posture: arg.Posture = None,
    q: arg.JointValues = None,
    tau: Annotated[
        list[str] | None,
        typer.Option(help="JOINT=TORQUE [N m or N], zero for the others; repeat it for others."),
    ] = None,
    force: Annotated[
        list[str] | None,
        typer.Option(
            help="FRAME=FX,FY,FZ or FRAME=FX,FY,FZ,MX,MY,MZ [N, N m]: a force from outside at the "
            "frame, along the axes of the world; repeat it for others."
        ),
    ] = None,
    solver: arg.SolverOrNone = None,
    mu: Annotated[float | None, typer.Option(help="Regularisation [1/kg].")] = None,
    max_iterations: Annotated[
        int | None, typer.Option(help="Largest number of iterations.")
    ] = None,
    accuracy: Annotated[float, typer.Option(help="Largest acceptable error of a.")] = SOLVED,
    as_json: arg.AsJson = False,
) -> None:
    """Solve for accelerations and forces at rest; exits with 1 if the status is not ok."""
    from condyn_pin.cli.words import forces_of, scene_of, solver_of, state_of, torque_of
    from condyn_pin.dynamics.verbs import solve as solve_scene
    from condyn_pin.dynamics.workspace import default_solver

    scene = scene_of(source, contacts, loops)
    torques, forces = torque_of(scene, tau), forces_of(scene, force)
    at, v = state_of(scene, posture, q)
    name = solver or type(default_solver(scene)).__name__
    chosen = solver_of(name, {"mu": mu, "max_iterations": max_iterations})
    solution = solve_scene(
        scene, at, v, torques, forces=forces, solver=chosen, accuracy=accuracy, throw=False
    )
    if as_json:
        print_json({"robot": scene.robot.name, "solver": repr(chosen)} | _facts(solution))
    else:
        print_text(f"{scene.robot.name}, {chosen!r}")
        print_text(str(solution))
        _say_state(solution)
        if not scene.constraints:
            ready = ", ".join(contact.name for contact in scene.robot.contacts) or "FRAME:KIND"
            print_text(f"note: no constraints; --contacts takes {ready}")
        for note in scene.rank(at).notes:
            print_text(f"note: {note}")
    if not solution.status.ok:
        warn(str(solution.status))
        exit_with_status(ok=False)


def _say_state(solution: Solution) -> None:
    from condyn_pin._core.joints import indices

    robot = solution.scene.robot
    places = robot.joint_values(solution.q)
    rates = {name: solution.a[indices(robot.model, [name])[1]] for name in robot.joints}
    for title, values in (
        ("the joints are at, free-flyers with x y z and a quaternion x y z w [rad, m]:", places),
        ("accelerations of the joints, free-flyers linear first [rad/s^2, m/s^2]:", rates),
    ):
        print_text(title)
        for name, numbers in values.items():
            print_text(f"{name:<28} {' '.join(f'{value:.6g}' for value in np.atleast_1d(numbers))}")


def _facts(solution: Solution) -> dict[str, object]:
    from condyn_pin._core.timing import machine

    return {
        "status": solution.status.word,
        "advice": str(solution.status),
        "q": solution.q,
        "a": solution.a,
        "lam": solution.lam,
        "world_forces": solution.world_forces,
        "forces": solution.forces,
        "dynamics_error": solution.dynamics_error,
        "constraint_error": solution.constraint_error,
        "state_error": list(solution.state_error),
        "error_bound": solution.error_bound,
        "iterations": solution.iterations,
        "solve_time": solution.solve_time,
        "machine": machine(),
    }
