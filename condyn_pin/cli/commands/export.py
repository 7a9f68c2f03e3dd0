"""condyn export: a robot in another format."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from condyn_pin.cli import arguments as arg
from condyn_pin.cli.output import check_written, print_text

PANEL = "Look"


@arg.of_a_robot
def export(
    source: arg.Source,
    mjcf: Annotated[Path, typer.Option(help="Write the robot with its loops here, for MuJoCo.")],
    without: Annotated[str, typer.Option(help="Comma-separated: loops to leave out.")] = "",
    friction: Annotated[
        float | None,
        typer.Option(help="Add a floor z = 0 with this friction for its feet."),
    ] = None,
    shapes: Annotated[
        bool,
        typer.Option("--shapes", help="Include shapes and meshes."),
    ] = False,
) -> None:
    """Write a robot in another format."""
    from condyn_pin._core.files import write_text
    from condyn_pin.cli.words import feet_of, names_in, robot_of
    from condyn_pin.io.mjcf_write import not_written

    check_written(mjcf)
    loaded = robot_of(source)
    text = loaded.to_mjcf(
        without=names_in(without), contacts=feet_of(loaded, friction), shapes=shapes
    )
    write_text(mjcf, text)
    print_text(f"written: {mjcf}")
    if lost := not_written(loaded):
        print_text(f"not written: {lost}")
