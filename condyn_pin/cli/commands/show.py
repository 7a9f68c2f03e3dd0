"""condyn show: what a scene contains."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from condyn_pin.cli.commands.arguments import AsJson, Contacts, Loops, Posture, RobotName, Variant
from condyn_pin.cli.commands.output import (
    check_picture,
    console,
    plain,
    print_json,
    progress_bar,
    words,
)
from condyn_pin.errors import InvalidArgument

if TYPE_CHECKING:
    from condyn_pin.dynamics.scene import Scene
    from condyn_pin.mechanism.summary import Summary

PANEL = "Look"

_NOTHING = (
    "no constraints: --contacts adds some; loops come from the file, or from a robot.toml beside "
    "it (docs/how-to-close-a-loop.md)"
)


def show(
    robot: RobotName,
    contacts: Contacts = "",
    loops: Loops = True,
    posture: Posture = None,
    frames: Annotated[
        bool, typer.Option("--frames", help="List the frames that constraints can use.")
    ] = False,
    ladder: Annotated[
        bool, typer.Option("--ladder", help="Show smaller scenes instead, with their price.")
    ] = False,
    plot: Annotated[Path | None, typer.Option(help="Draw the ladder (png, svg, pdf).")] = None,
    variant: Variant = None,
    as_json: AsJson = False,
) -> None:
    """Show what a scene contains, what is redundant, and what is not used."""
    if ladder:
        _show_ladder(robot, plot, variant, as_json)
        return
    if plot:
        raise InvalidArgument("--plot draws a ladder; add --ladder")
    from condyn_pin.cli.commands.words import scene_of

    scene = scene_of(robot, contacts, loops, variant)
    summary = scene.summary(scene.state(posture)[0] if posture else None)
    if as_json:
        names = {"postures": list(scene.robot.postures), "frames": list(scene.robot.frames)}
        ready = [contact.name for contact in scene.robot.contacts]
        print_json(plain(summary) | names | {"ready_contacts": ready})
        return
    _print(scene, summary, frames)


def _print(scene: Scene, summary: Summary, frames: bool) -> None:
    table = words("", summary.robot)
    for label, text in summary.facts().items():
        table.add_row(label, text)
    for name, kind, rows in summary.constraints:
        table.add_row("constraint", f"{name}: {kind}, {rows} rows")
    for text in summary.unused:
        table.add_row("not used", text)
    for text in summary.notes:
        table.add_row("note", text)
    if not scene.constraints:
        table.add_row("note", _NOTHING)
    table.add_row("postures", ", ".join(scene.robot.postures) or "none")
    table.add_row("ready contacts", ", ".join(c.name for c in scene.robot.contacts) or "none")
    if frames:
        table.add_row("frames", ", ".join(scene.robot.frames))
    console.print(table)


def _show_ladder(name: str, plot: Path | None, variant: list[str] | None, as_json: bool) -> None:
    from condyn_pin.lab.hierarchy import model_hierarchy
    from condyn_pin.lab.hierarchy_table import print_hierarchy, save_hierarchies

    if variant:
        raise InvalidArgument("--ladder has no variants: its models are; leave --variant out")
    check_picture(plot)
    with progress_bar() as progress:
        progress(f"{name}: every model, about ten seconds", 0, 1)
        table = model_hierarchy(name)
    if as_json:
        print_json(table.as_dict())
    else:
        print_hierarchy(table, console)
    if plot:
        save_hierarchies([table], plot)
