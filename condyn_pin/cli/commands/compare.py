"""condyn compare: a robot beside the same in MuJoCo."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from condyn_pin._core.tolerances import ENGINES
from condyn_pin.cli import arguments as arg
from condyn_pin.cli.output import exit_with_status, print_json, print_text

if TYPE_CHECKING:
    from condyn_pin._core.arrays import Array
    from condyn_pin.model.robot import Robot

PANEL = "Look"


@arg.of_a_robot
def compare(
    source: arg.Source,
    mjcf: Annotated[Path, typer.Argument(help="The same robot as a file for MuJoCo.")],
    name: Annotated[
        list[str] | None,
        typer.Option(
            help="OURS=THEIRS: a joint with another name in the file; repeat it for others."
        ),
    ] = None,
    without: Annotated[
        str, typer.Option(help="Comma-separated: joints of the file that the robot lacks.")
    ] = "",
    tolerance: Annotated[
        float, typer.Option(help="Relative difference that counts as none.")
    ] = ENGINES,
    seed: Annotated[
        int, typer.Option(help="Seed of the random state that is compared.", min=0)
    ] = 0,
    as_json: arg.AsJson = False,
) -> None:
    """Compare a robot with a file in MuJoCo, and name what differs; exits with 1 if they differ.

    Both are compared in a random moving state with closed loops, with random
    torques at the motors.
    """
    from condyn_pin.cli.words import names_in, pairs_in, robot_of
    from condyn_pin.io.mjcf_file import compiled
    from condyn_pin.io.xml import place
    from condyn_pin.study.mujoco.bridge import MujocoBridge

    chosen = robot_of(source)
    names = pairs_in("--name", name, "OURS=THEIRS is needed, such as root_joint=floating_base")
    with place(mjcf):
        model, _ = compiled(mjcf)
    bridge = MujocoBridge(chosen, model, names=names, without=names_in(without))
    found = bridge.compare(*_random_state(chosen, seed), tolerance=tolerance)
    if as_json:
        print_json(found.to_dict())
    else:
        print_text(str(found))
    exit_with_status(ok=found.ok)


def _random_state(robot: Robot, seed: int) -> tuple[Array, Array, Array]:
    """Return q and v with the loops closed, and torques at the motors."""
    import numpy as np

    from condyn_pin._core.joints import indices
    from condyn_pin.dynamics.scene import Scene

    rng = np.random.default_rng(seed)
    q, v = Scene(robot, robot.loops).sample(rng)
    tau = np.zeros(robot.nv)
    motors = indices(robot.model, robot.motor_joints)[1]
    tau[motors] = rng.normal(size=motors.size)
    return q, v, tau
