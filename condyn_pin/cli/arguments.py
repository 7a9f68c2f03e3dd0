"""The arguments that commands share."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import wraps
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any

import typer


def names_of(room: str, registry: str) -> Callable[[str], list[str]]:
    """Return the shell completion of a registry's names, alone or last in a list with commas."""

    def complete(incomplete: str) -> list[str]:
        known = getattr(import_module(f"condyn_pin.{room}"), registry)
        before, comma, last = incomplete.rpartition(",")
        names = known() if callable(known) else known
        return [f"{before}{comma}{each}" for each in names if each.lower().startswith(last.lower())]

    return complete


robot_names = names_of("io", "available_robots")
solver_names = names_of("dynamics", "SOLVERS")

# What a scene is made of
RobotName = Annotated[
    str,
    typer.Argument(help="A name of `condyn robots`, or a path.", autocompletion=robot_names),
]
RobotNames = Annotated[
    list[str] | None,
    typer.Argument(help="Robots; the main ones if none.", autocompletion=robot_names),
]
Variant = Annotated[
    list[str] | None,
    typer.Option(
        help="OPTION=VALUE of the robot, such as springs=locked; repeat it for another option."
    ),
]
Contacts = Annotated[
    str,
    typer.Option(
        help="Comma-separated: names of ready-made contacts, or FRAME:KIND with the kind "
        "point, surface, line or planar."
    ),
]
Loops = Annotated[bool, typer.Option(help="Include the loops of the robot.")]
Floating = Annotated[
    bool,
    typer.Option(
        "--floating", help="For a URDF or an SDF: the base floats freely, as on a legged robot."
    ),
]
ModelName = Annotated[
    list[str] | None,
    typer.Option(
        "--model", help="For an SDF: which model of the file is the robot; repeat it for several."
    ),
]
Actuated = Annotated[
    str | None,
    typer.Option(help="Comma-separated: the joints with a motor; those of the file by default."),
]
PackageDirs = Annotated[
    list[Path] | None,
    typer.Option(
        "--package-dir", help="Where package:// of a file leads; repeat it for other folders."
    ),
]
JointValues = Annotated[
    list[str] | None,
    typer.Option(
        "--q", help="JOINT=VALUE [rad or m]: set a joint and keep it there; repeat it for others."
    ),
]
Posture = Annotated[str | None, typer.Option(help="Posture to use; the first one by default.")]

# How it is solved and moved
SolverOrNone = Annotated[
    str | None,
    typer.Option(
        help="A name of `condyn solvers`; chosen if left out.", autocompletion=solver_names
    ),
]
IntegratorName = Annotated[
    str | None,
    typer.Option(
        help="Such as rungekutta4, rattle or stewarttrinkle, or a call with parameters: "
        "'Moreau(contact=ADMM(tolerance=1e-6))'; chosen if left out.",
        autocompletion=names_of("simulation", "INTEGRATORS"),
    ),
]
DriftName = Annotated[
    str | None,
    typer.Option(
        help="nodrift, baumgarte, projection or poststabilization; chosen if left out.",
        autocompletion=names_of("simulation", "DRIFTS"),
    ),
]
Gain = Annotated[
    float | None,
    typer.Option(help="alpha = beta of `--drift baumgarte` [1/s]; 30 if left out."),
]

# What is written
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON.")]
TableJson = Annotated[
    Path | None,
    typer.Option("--json", help="Write the table here; - prints it, and nothing else on stdout."),
]
Csv = Annotated[Path | None, typer.Option(help="Write the table here.")]
Plot = Annotated[Path | None, typer.Option(help="Draw it here (png, svg, pdf).")]
Quick = Annotated[bool, typer.Option("--quick", help="Fewer rounds of timing.")]


@dataclass(frozen=True)
class Source:
    """Robot of a command, as arguments of `load_robot`."""

    robot: RobotName
    variant: Variant = None
    floating: Floating = False
    model: ModelName = None
    actuated: Actuated = None
    package_dirs: PackageDirs = None

    @property
    def is_plain(self) -> bool:
        """True if the robot is given by a name or a path alone."""
        return not any((self.variant, self.floating, self.model, self.actuated, self.package_dirs))


def of_a_robot(command: Callable[..., None]) -> Callable[..., None]:
    """Expand the first parameter of a command, a `Source`, into options."""
    signature = inspect.signature(command, eval_str=True)
    _, *others = signature.parameters.values()
    name, *options = inspect.signature(Source, eval_str=True).parameters.values()
    words = [p.replace(kind=inspect.Parameter.KEYWORD_ONLY) for p in (name, *others, *options)]

    @wraps(command)
    def run(**given: Any) -> None:
        source = Source(**{field.name: given.pop(field.name) for field in fields(Source)})
        command(source, **given)

    run.__signature__ = signature.replace(parameters=words)  # type: ignore[attr-defined]
    run.__annotations__ = {word.name: word.annotation for word in words}
    return run
