"""condyn robots: the robots that can be loaded."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rich.table import Column

from condyn_pin.cli import arguments as arg
from condyn_pin.cli.output import console, print_json, text_table

if TYPE_CHECKING:
    from condyn_pin.model.robot import Robot

PANEL = "Look"


def robots(as_json: arg.AsJson = False) -> None:
    """List the robots that can be loaded; `condyn show` has the file and the full licence."""
    from condyn_pin.io.load import available_robots

    loaded = {name: load() for name, load in available_robots().items()}
    if as_json:
        print_json({name: _facts(robot) for name, robot in loaded.items()})
        return
    columns = "robot", "nq", "nv", "mass\n[kg]", "loops", "motors", "postures", "licence"
    table = text_table(*(Column(name, no_wrap=name in ("robot", "licence")) for name in columns))
    for column in table.columns[1:6]:
        column.justify = "right"
    for robot in loaded.values():
        table.add_row(
            robot.name,
            str(robot.nq),
            str(robot.nv),
            f"{robot.mass:.2f}",
            str(len(robot.loops)),
            str(len(robot.actuated) + len(robot.coupled_motors)),
            ", ".join(robot.postures),
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
        "coupled_motors": {motor.name: motor.weights for motor in robot.coupled_motors},
        "postures": list(robot.postures),
        "source": robot.source,
        "licence": robot.licence,
    }
