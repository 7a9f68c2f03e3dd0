"""condyn view: look at a robot, or at a motion that was saved."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from condyn_pin.cli import arguments as arg
from condyn_pin.cli.output import check_ending, check_written, print_text
from condyn_pin.errors import InvalidArgument

if TYPE_CHECKING:
    from condyn_pin.viewing.drawing import Subject
    from condyn_pin.viewing.viewer import Viewer

PANEL = "Look"

ViewedContacts = Annotated[
    str | None,
    typer.Option(help="As in `condyn solve`; those of the robot if forces are drawn."),
]


@arg.of_a_robot
def view(
    source: arg.Source,
    contacts: ViewedContacts = None,
    loops: arg.Loops = True,
    posture: arg.Posture = None,
    forces: Annotated[
        bool, typer.Option("--forces", help="Draw the forces on it while it is held still.")
    ] = False,
    speed: Annotated[float, typer.Option(help="Seconds of a motion played in one second.")] = 1.0,
    light: Annotated[bool, typer.Option("--light", help="At most 30 000 triangles.")] = False,
    cones: Annotated[
        bool, typer.Option("--cones", help="Draw the friction cones of a motion's contacts.")
    ] = False,
    balance: Annotated[
        bool, typer.Option("--balance", help="Draw support, pressure and capture point.")
    ] = False,
    html: Annotated[Path | None, typer.Option(help="Write one page that opens from disk.")] = None,
    png: Annotated[Path | None, typer.Option(help="Write a picture; needs Chromium.")] = None,
    port: Annotated[
        int, typer.Option(help="Port of the server; a free one by default.", min=0, max=65535)
    ] = 0,
    browser: Annotated[bool, typer.Option(help="Open the browser, if there is a display.")] = True,
    at: Annotated[
        float | None,
        typer.Option(help="Show only this instant of a motion [s].", show_default=False),
    ] = None,
    motion: Annotated[
        int | None, typer.Option(help="Which motion of a batch, counted from 0.", min=0)
    ] = None,
) -> None:
    """Look at a robot or a motion in a browser until Ctrl-C, or write it to a file."""
    from condyn_pin.viewing.viewer import view as view_subject

    check_ending(html, ".html", ".htm")
    check_ending(png, ".png")
    check_written(html, png)
    subject = source.robot
    if not subject.endswith(".npz"):
        if motion is not None:
            raise InvalidArgument(f"--motion {motion}: it is for a batch (.npz), not for {subject}")
        if at is not None:
            raise InvalidArgument(f"--at {at:g}: it is for a motion (.npz), not for {subject}")
        chosen = _standing(source, contacts, loops, posture, forces)
    elif posture or forces or contacts or not (loops and source.is_plain):
        raise InvalidArgument(f"{subject}: a motion has its own states, constraints and forces")
    else:
        chosen = _motion(subject, motion)
    with view_subject(
        chosen, posture=None if forces else posture, t=at, speed=speed, light=light, cones=cones,
        balance=balance, html=html, png=png, browser=browser, port=port,
    ) as viewer:  # fmt: skip
        _serve(viewer, html, png)


def _serve(viewer: Viewer, *files: Path | None) -> None:
    """Print notes, written files and the address, and wait for Ctrl-C while the page is served."""
    for note in viewer.notes:
        print_text(f"note: {note}")
    for path in files:
        if path:
            print_text(f"written: {path}")
    if not viewer.url:
        return
    try:
        print_text(f"{viewer.drawing.title}: {viewer.url} (Ctrl-C ends it)")
        viewer.wait()
    except KeyboardInterrupt:
        print_text("closed")


def _motion(path: str, motion: int | None) -> Subject:
    from condyn_pin.simulation.batch.trajectory import BatchTrajectory
    from condyn_pin.simulation.trajectory import Trajectory

    if motion is None:
        return Trajectory.load(path)
    batch = BatchTrajectory.load(path)
    if motion >= len(batch):
        raise InvalidArgument(f"--motion {motion}: {path} has {len(batch)}, from 0")
    return batch[motion]


def _standing(
    source: arg.Source,
    contacts: str | None,
    loops: bool,
    posture: str | None,
    forces: bool,
) -> Subject:
    """Scene of a robot, or with `forces` its static equilibrium held by motors and springs."""
    from condyn_pin.cli.words import robot_of, scene_of
    from condyn_pin.control.actuation import Actuation
    from condyn_pin.control.inverse import gravity_compensation
    from condyn_pin.dynamics.verbs import solve

    if contacts is None:
        contacts = ",".join(c.name for c in robot_of(source).contacts) if forces else ""
    scene = scene_of(source, contacts, loops)
    if not forces:
        return scene
    q, v = scene.state(posture)
    robot = scene.robot
    sprung = (spring.joint for spring in robot.springs)
    holding: tuple[Any, ...] = (*robot.actuated, *robot.coupled_motors, *sprung)
    if not holding:
        return solve(scene, q, v, 0 * v, throw=False)
    return gravity_compensation(scene, q, actuation=Actuation(robot, holding))
