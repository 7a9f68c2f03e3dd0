"""The arguments that commands share."""

from __future__ import annotations

from typing import Annotated

import typer


def _robots(incomplete: str) -> list[str]:
    """Return the robots that a name may become, for the completion of a shell."""
    from condyn_pin.load import available_robots

    return [name for name in available_robots() if name.startswith(incomplete)]


def _solvers(incomplete: str) -> list[str]:
    """Return the solvers that a name may become, for the completion of a shell."""
    from condyn_pin.solvers import SOLVERS

    return [name for name in SOLVERS if name.startswith(incomplete)]


RobotName = Annotated[
    str, typer.Argument(help="A name of `condyn robots`, or a path.", autocompletion=_robots)
]
SolverName = Annotated[
    str, typer.Option(help="A name of `condyn solvers`.", autocompletion=_solvers)
]
Variant = Annotated[
    list[str] | None,
    typer.Option(
        help="OPTION=VALUE of the robot, such as springs=locked; again for another option."
    ),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print json.")]
Contacts = Annotated[
    str,
    typer.Option(
        help="Comma-separated: names of ready-made contacts, or FRAME:KIND with the kind "
        "point, surface, line or planar."
    ),
]
Loops = Annotated[bool, typer.Option(help="Include the loops of the robot.")]
Posture = Annotated[str | None, typer.Option(help="Posture; the first one by default.")]
