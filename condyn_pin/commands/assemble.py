"""condyn assemble: close the loops."""

from __future__ import annotations

from typing import Annotated

import typer

from condyn_pin.commands.arguments import Loops, Posture, RobotName
from condyn_pin.commands.output import console

PANEL = "Solve"


def assemble(
    robot: RobotName,
    loops: Loops = True,
    posture: Posture = None,
    fixed: Annotated[str, typer.Option(help="Comma-separated: joints that keep their value.")] = "",
    limits: Annotated[bool, typer.Option(help="Keep the joints within their limits.")] = True,
) -> None:
    """Close the loops from a posture as it is described; exits with 1 if that cannot be."""
    from condyn_pin.commands.words import scene_of

    scene = scene_of(robot, "", loops)
    held = [name.strip() for name in fixed.split(",") if name.strip()]
    assembly = scene.assemble(scene.guess(posture), fixed=held, within_limits=limits, throw=False)
    console.print(str(assembly))
    for name in scene.robot.joints:
        joint = scene.robot.model.joints[scene.robot.model.getJointId(name)]
        values = assembly.q[joint.idx_q : joint.idx_q + joint.nq]
        console.print(f"{name:<28} {' '.join(f'{value:.9g}' for value in values)}")
    if not assembly.status.ok:
        raise typer.Exit(1)
