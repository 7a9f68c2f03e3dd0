"""condyn doctor: a check of the installation."""

from __future__ import annotations

from condyn_pin.cli import arguments as arg
from condyn_pin.cli.output import console, exit_with_status, print_json, print_text, text_table

PANEL = "Look"


def doctor(as_json: arg.AsJson = False) -> None:
    """Check the installation: versions, features, conflicts, and the command that repairs them."""
    from condyn_pin._core.doctor import diagnose

    found = diagnose()
    if as_json:
        print_json(found)
        exit_with_status(ok=not found.remedy)
        return
    table = text_table("", found.platform)
    for name, text in (*found.versions.items(), *found.features.items()):
        table.add_row(name, text)
    console.print(table)
    for finding in found.findings:
        console.print(f"wrong: {finding}", style="bold red")
    fine = "Everything fits together."
    print_text(f"This repairs it:\n  {found.remedy}" if found.remedy else fine)
    exit_with_status(ok=not found.remedy)
