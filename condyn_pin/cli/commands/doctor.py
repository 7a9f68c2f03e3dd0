"""condyn doctor: what is installed."""

from __future__ import annotations

import typer

from condyn_pin.cli.commands.arguments import AsJson
from condyn_pin.cli.commands.output import console, print_json, say, words

PANEL = "Look"


def doctor(as_json: AsJson = False) -> None:
    """Say what is installed, whether it fits together, and how to repair it."""
    from condyn_pin._core.doctor import diagnose

    found = diagnose()
    if as_json:
        print_json(found)
        raise typer.Exit(1 if found.remedy else 0)
    table = words("", found.platform)
    for name, version in found.versions.items():
        table.add_row(name, version)
    for name, text in found.features.items():
        table.add_row(name, text)
    console.print(table)
    for finding in found.findings:
        console.print(f"wrong: {finding}", style="bold red")
    if found.remedy:
        say(f"This repairs it:\n  {found.remedy}")
        raise typer.Exit(1)
    console.print("Everything fits together.")
