"""condyn lab ladder: a robot in smaller and smaller scenes."""

from __future__ import annotations

from typing import Annotated

import typer

from condyn_pin.cli import arguments as arg
from condyn_pin.cli.output import check_picture, console, print_json, progress_bar

PANEL = "Look"

ModelledName = Annotated[
    str,
    typer.Argument(
        help="A robot whose smaller models are known: cassie, talos.",
        autocompletion=arg.names_of("lab", "HIERARCHIES"),
    ),
]


def ladder(robot: ModelledName, plot: arg.Plot = None, as_json: arg.AsJson = False) -> None:
    """Show smaller and smaller scenes of a robot, with their speed and error."""
    from condyn_pin.lab.hierarchy import model_hierarchy, print_hierarchy, save_hierarchies

    check_picture(plot)
    with progress_bar() as progress:
        progress(f"{robot}: every model, about ten seconds", 0, 1)
        table = model_hierarchy(robot)
    if as_json:
        print_json(table.as_dict())
    else:
        print_hierarchy(table, console)
    if plot:
        save_hierarchies([table], plot)
