"""condyn assemble: close the loops."""

from __future__ import annotations

from typing import Annotated

import typer

from condyn_pin.cli.commands.arguments import AsJson, Loops, Posture, RobotName, Variant
from condyn_pin.cli.commands.output import plain, print_json, say
from condyn_pin.dynamics.nominal import described_posture

PANEL = "Solve"


def assemble(
    robot: RobotName,
    loops: Loops = True,
    posture: Posture = None,
    fixed: Annotated[str, typer.Option(help="Comma-separated: joints that keep their value.")] = "",
    limits: Annotated[bool, typer.Option(help="Keep the joints within their limits.")] = True,
    variant: Variant = None,
    as_json: AsJson = False,
) -> None:
    """Close the loops, starting from a posture; exits with 1 if they cannot be closed."""
    from condyn_pin.cli.commands.words import names_in, scene_of

    scene = scene_of(robot, "", loops, variant)
    assembly = scene.assemble(
        described_posture(scene, posture), fixed=names_in(fixed), within_limits=limits, throw=False
    )
    joints = {}
    for name in scene.robot.joints:
        joint = scene.robot.model.joints[scene.robot.model.getJointId(name)]
        joints[name] = assembly.q[joint.idx_q : joint.idx_q + joint.nq]
    if as_json:
        status = {"status": assembly.status.name.lower(), "advice": assembly.status.value}
        print_json(plain(assembly) | status | {"joints": joints})
    else:
        say(str(assembly))
        for name, values in joints.items():
            say(f"{name:<28} {' '.join(f'{value:.9g}' for value in values)}")
    if not assembly.status.ok:
        raise typer.Exit(1)
