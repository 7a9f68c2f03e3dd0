"""The arguments that commands share."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Annotated

import typer


def complete_robots(incomplete: str) -> list[str]:
    """Return the robots that a name may become, for the completion of a shell."""
    from condyn_pin.io.load import available_robots

    return [name for name in available_robots() if name.startswith(incomplete)]


def _solvers(incomplete: str) -> list[str]:
    from condyn_pin.dynamics.solvers import SOLVERS

    return _last_of_list(SOLVERS, incomplete)


def _integrators(incomplete: str) -> list[str]:
    from condyn_pin.simulation.integrators import INTEGRATORS

    return _starting(INTEGRATORS, incomplete)


def _drifts(incomplete: str) -> list[str]:
    from condyn_pin.simulation.drift import DRIFTS

    return _starting(DRIFTS, incomplete)


def _problems(incomplete: str) -> list[str]:
    from condyn_pin.lab.problems import PROBLEMS

    names = (kind.name for kind in PROBLEMS.values())
    return [name for name in names if name.lower().startswith(incomplete.lower())]


def _families(incomplete: str) -> list[str]:
    from condyn_pin.lab.extremes import EXTREMES

    return _last_of_list(EXTREMES, incomplete)


def _measures(incomplete: str) -> list[str]:
    from condyn_pin.study.measures import MEASURES

    return _starting(MEASURES, incomplete)


def _starting(names: Iterable[str], incomplete: str) -> list[str]:
    """Return what a name may become."""
    return [name for name in names if name.startswith(incomplete)]


def _last_of_list(names: Iterable[str], incomplete: str) -> list[str]:
    """Return what a list with commas may become, by its last name."""
    before, comma, last = incomplete.rpartition(",")
    return [f"{before}{comma}{name}" for name in _starting(names, last)]


# What a scene is made of
RobotName = Annotated[
    str,
    typer.Argument(help="A name of `condyn robots`, or a path.", autocompletion=complete_robots),
]
RobotNames = Annotated[
    list[str] | None,
    typer.Argument(help="Robots; the main ones if none.", autocompletion=complete_robots),
]
RobotsToStress = Annotated[
    list[str] | None,
    typer.Argument(
        help="Robots to put through it; four of them, and mechanisms, if none.",
        autocompletion=complete_robots,
    ),
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
Posture = Annotated[str | None, typer.Option(help="Posture; the first one by default.")]

# How it is solved and moved
SolverName = Annotated[
    str, typer.Option(help="A name of `condyn solvers`.", autocompletion=_solvers)
]
SolverOrNone = Annotated[
    str | None,
    typer.Option(help="A name of `condyn solvers`; chosen if left out.", autocompletion=_solvers),
]
SolversToSweep = Annotated[
    str,
    typer.Option(
        help="Comma-separated names of `condyn solvers`, all parameters turned; all by default.",
        autocompletion=_solvers,
    ),
]
SolversToBench = Annotated[
    str,
    typer.Option(
        help="Comma-separated names of `condyn solvers`, or all; the main ones by default.",
        autocompletion=_solvers,
    ),
]
SolversToStress = Annotated[
    str,
    typer.Option(
        "--solver",
        "--solvers",
        help="Comma-separated names of `condyn solvers`, or all.",
        autocompletion=_solvers,
    ),
]
IntegratorName = Annotated[
    str | None,
    typer.Option(
        help="Such as rungekutta4, semiimpliciteuler or rattle; chosen if left out.",
        autocompletion=_integrators,
    ),
]
DriftName = Annotated[
    str | None,
    typer.Option(
        help="nodrift, baumgarte, projection or poststabilization; chosen if left out.",
        autocompletion=_drifts,
    ),
]
Gain = Annotated[
    float | None,
    typer.Option(help="alpha = beta of `--drift baumgarte` [1/s]; 30 if left out."),
]
Measure = Annotated[
    str,
    typer.Option(
        help="The quantity whose error counts: acceleration, forces, derivatives or trajectory.",
        autocompletion=_measures,
    ),
]
ProblemName = Annotated[
    str,
    typer.Argument(help="Its name; without one they are listed.", autocompletion=_problems),
]
Families = Annotated[
    str,
    typer.Option(
        help="Comma-separated: families; all of them by default.", autocompletion=_families
    ),
]

# What is written
AsJson = Annotated[bool, typer.Option("--json", help="Print json.")]
TableJson = Annotated[
    Path | None,
    typer.Option("--json", help="Write the table here; - prints it, and nothing else on stdout."),
]
Csv = Annotated[Path | None, typer.Option(help="Write the table here.")]
Plot = Annotated[Path | None, typer.Option(help="Draw it here (png, svg, pdf).")]
Quick = Annotated[bool, typer.Option("--quick", help="A short look: fewer rounds of timing.")]
