"""condyn tune: choose the solver of a scene by measurement, and keep the choice."""

from __future__ import annotations

from typing import Annotated

import typer

from condyn_pin._core.tolerances import SOLVED
from condyn_pin.cli.commands.arguments import (
    AsJson,
    Contacts,
    Loops,
    Measure,
    RobotName,
    SolversToSweep,
    Variant,
)
from condyn_pin.cli.commands.output import print_json, progress_bar, say, warn

PANEL = "Measure"


def tune(
    robot: RobotName,
    contacts: Contacts = "",
    loops: Loops = True,
    error: Annotated[float, typer.Option(help="The worst error that is good enough.")] = SOLVED,
    measure: Measure = "acceleration",
    solvers: SolversToSweep = "",
    save: Annotated[bool, typer.Option(help="Keep the choice, for `tuned`.")] = True,
    variant: Variant = None,
    as_json: AsJson = False,
) -> None:
    """Choose the fastest solver that meets an error; exits with 1 if there is none."""
    from condyn_pin.cli.commands.words import scene_of, swept_solvers_of
    from condyn_pin.errors import NotReached
    from condyn_pin.study.plan import check_folder, path_of
    from condyn_pin.study.tuning import choose, keep, plan_for

    if save:
        check_folder()
    scene = scene_of(robot, contacts, loops, variant)
    chosen = swept_solvers_of(solvers)
    try:
        with progress_bar() as progress:
            choice = choose(scene, error, measure=measure, solvers=chosen, progress=progress)
    except NotReached as reason:
        if as_json:
            print_json({"measure": measure, "error": error, "solver": None, "reason": str(reason)})
        warn(f"condyn: {reason}")
        raise typer.Exit(1) from reason
    plan = keep(scene, choice) if save else plan_for(scene, choice)
    if as_json:
        print_json(plan)
        return
    say(str(choice))
    if save:
        say(f"kept in {path_of(plan.fingerprint, plan.measure, plan.error)}")
        say(f"solve(scene, q, v, tau, solver=tuned(scene, {error:g}))")
