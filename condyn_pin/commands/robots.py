"""condyn robots: what can be loaded."""

from __future__ import annotations

from pathlib import Path

from rich.table import Table

from condyn_pin.commands.output import console

PANEL = "Look"


def robots() -> None:
    """List what can be loaded; `condyn show` has source and licence in full."""
    from condyn_pin.load import available_robots

    table = Table("robot", "nq", "nv", "mass [kg]", "loops", "postures", "file", "licence")
    for column in table.columns[1:5]:
        column.justify = "right"
    table.columns[6].overflow = "fold"  # a name that is cut helps nobody
    for load in available_robots().values():
        robot = load()
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
