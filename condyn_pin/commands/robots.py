"""condyn robots: what can be loaded."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from condyn_pin.commands.arguments import AsJson
from condyn_pin.commands.output import console, print_json, words

if TYPE_CHECKING:
    from condyn_pin.robot import Robot

PANEL = "Look"


def robots(as_json: AsJson = False) -> None:
    """List what can be loaded; `condyn show` has source and licence in full."""
    from condyn_pin.load import available_robots

    loaded = {name: load() for name, load in available_robots().items()}
    if as_json:
        print_json({name: _facts(robot) for name, robot in loaded.items()})
        return
    table = words("robot", "nq", "nv", "mass [kg]", "loops", "postures", "file", "licence")
    for column in table.columns[1:5]:
        column.justify = "right"
    for robot in loaded.values():
        table.add_row(
            robot.name,
            str(robot.nq),
            str(robot.nv),
            f"{robot.mass:.4f}",
            str(len(robot.loops)),
            ", ".join(robot.postures),
            Path(robot.source).name,
            robot.licence.split(" (")[0],
        )
    console.print(table)


def _facts(robot: Robot) -> dict[str, Any]:
    return {
        "nq": robot.nq,
        "nv": robot.nv,
        "mass": robot.mass,
        "loops": [loop.name for loop in robot.loops],
        "contacts": [contact.name for contact in robot.contacts],
        "actuated": list(robot.actuated),
        "postures": list(robot.postures),
        "source": robot.source,
        "licence": robot.licence,
    }
