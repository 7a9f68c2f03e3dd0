"""condyn export: a robot in another format."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from condyn_pin.cli import arguments as arg
from condyn_pin.cli.output import check_written, say

PANEL = "Look"


def export(
    robot: arg.RobotName,
    mjcf: Annotated[Path, typer.Option(help="Write the robot with its loops here, for MuJoCo.")],
    without: Annotated[str, typer.Option(help="Comma-separated: loops to leave out.")] = "",
    variant: arg.Variant = None,
    floating: arg.Floating = False,
) -> None:
    """Write a robot in another format."""
    from condyn_pin._core.files.beside import write_text
    from condyn_pin.cli.words import names_in, robot_of

    check_written(mjcf)
    text = robot_of(robot, variant, floating).to_mjcf(without=names_in(without))
    write_text(mjcf, text)
    say(f"written: {mjcf}")
