"""condyn assemble: close the loops."""

from __future__ import annotations

from typing import Annotated

import typer

from condyn_pin.cli import arguments as arg
from condyn_pin.cli.output import exit_with_status, json_value, print_json, print_text, with_options

PANEL = "Solve"

_NOTHING = (
    "the file has no loops, so there is nothing to close; a robot.toml beside it adds loops "
    "(docs/how-to-close-a-loop.md)"
)


@arg.of_a_robot
def assemble(
    source: arg.Source,
    loops: arg.Loops = True,
    posture: arg.Posture = None,
    q: arg.JointValues = None,
    fixed: Annotated[str, typer.Option(help="Comma-separated: joints that keep their value.")] = "",
    limits: Annotated[bool, typer.Option(help="Keep the joints within their limits.")] = True,
    as_json: arg.AsJson = False,
) -> None:
    """Close the loops, starting from a posture; exits with 1 if they cannot be closed."""
    from condyn_pin.cli.words import names_in, posture_of, scene_of

    scene = scene_of(source, "", loops)
    start, kept = posture_of(scene, posture, q)
    kept += [name for name in names_in(fixed) if name not in kept]
    assembly = scene.assemble(start, fixed=kept, within_limits=limits, throw=False)
    joints = {}
    for name in scene.robot.joints:
        joint = scene.robot.model.joints[scene.robot.model.getJointId(name)]
        joints[name] = assembly.q[joint.idx_q : joint.idx_q + joint.nq]
    if as_json:
        status = {
            "status": assembly.status.word,
            "advice": with_options(assembly.status.value),
        }
        print_json(json_value(assembly) | status | {"joints": joints})
    else:
        print_text(str(assembly))
        if not scene.constraints:
            print_text(f"note: {_NOTHING if loops else '--no-loops leaves nothing to close'}")
        for name, values in joints.items():
            print_text(f"{name:<28} {' '.join(f'{value:.9g}' for value in values)}")
    exit_with_status(ok=assembly.status.ok)
