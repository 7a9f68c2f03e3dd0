"""The arguments that commands share."""

from __future__ import annotations

from typing import Annotated

import typer

RobotName = Annotated[str, typer.Argument(help="A name of `condyn robots`, or a path.")]
Contacts = Annotated[
    str,
    typer.Option(
        help="Comma-separated: names of ready-made contacts, or FRAME:KIND with the kind "
        "point, surface, line or planar."
    ),
]
Loops = Annotated[bool, typer.Option(help="Include the loops of the robot.")]
Posture = Annotated[str | None, typer.Option(help="Posture; the first one by default.")]
