"""condyn show: the content of a scene."""

from __future__ import annotations

from typing import Annotated

import typer

from condyn_pin.cli import arguments as arg
from condyn_pin.cli.output import console, json_value, print_json, text_table

PANEL = "Look"

_NOTHING = (
    "no constraints: --contacts adds some; loops come from the file, or from a robot.toml beside "
    "it (docs/how-to-close-a-loop.md)"
)


@arg.of_a_robot
def show(
    source: arg.Source,
    contacts: arg.Contacts = "",
    loops: arg.Loops = True,
    posture: arg.Posture = None,
    frames: Annotated[
        bool, typer.Option("--frames", help="List the frames that constraints can use.")
    ] = False,
    as_json: arg.AsJson = False,
) -> None:
    """Show what a scene contains, which rows are redundant, and what is not used."""
    from condyn_pin.cli.words import scene_of

    scene = scene_of(source, contacts, loops)
    summary = scene.summary(scene.state(posture)[0] if posture else None)
    ready = [contact.name for contact in scene.robot.contacts]
    if as_json:
        names = {"postures": list(scene.robot.postures), "frames": list(scene.robot.frames)}
        print_json(json_value(summary) | names | {"ready_contacts": ready})
        return
    rows = list(summary.facts().items())
    rows += [("constraint", f"{name}: {kind}, {n} rows") for name, kind, n in summary.constraints]
    rows += [("not modelled", text) for text in summary.unmodelled]
    rows += [("not used", text) for text in summary.unused]
    rows += [("note", text) for text in summary.notes]
    if not scene.constraints:
        rows.append(("note", _NOTHING))
    rows.append(("postures", ", ".join(scene.robot.postures) or "none"))
    rows.append(("ready contacts", ", ".join(ready) or "none"))
    if frames:
        rows.append(("frames", ", ".join(scene.robot.frames)))
    table = text_table("", summary.robot)
    for label, text in rows:
        table.add_row(label, text)
    console.print(table)
