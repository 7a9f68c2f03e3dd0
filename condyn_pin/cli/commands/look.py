"""Commands that look at robots and at the installation."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.table import Column, Table

from condyn_pin._core.tolerances import ENGINES
from condyn_pin.cli import arguments as arg
from condyn_pin.cli.output import (
    check_ending,
    check_written,
    console,
    exit_with_status,
    json_value,
    print_json,
    print_text,
    text_table,
)
from condyn_pin.errors import InvalidArgument

if TYPE_CHECKING:
    from condyn_pin._core.arrays import Array
    from condyn_pin.model.robot import Robot
    from condyn_pin.viewing.drawing import Subject
    from condyn_pin.viewing.viewer import Viewer


def robots(as_json: arg.AsJson = False) -> None:
    """List the robots that can be loaded; `condyn show` has the file and the full licence."""
    from condyn_pin.io.load import available_robots

    loaded = {name: load() for name, load in available_robots().items()}
    if as_json:
        print_json({name: _robot_facts(robot) for name, robot in loaded.items()})
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


def _robot_facts(robot: Robot) -> dict[str, Any]:
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
    from condyn_pin.dynamics.workspace import solve

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


@arg.of_a_robot
def compare(
    source: arg.Source,
    mjcf: Annotated[Path, typer.Argument(help="The same robot as a file for MuJoCo.")],
    name: Annotated[
        list[str] | None,
        typer.Option(
            help="OURS=THEIRS: a joint with another name in the file; repeat it for others."
        ),
    ] = None,
    without: Annotated[
        str, typer.Option(help="Comma-separated: joints of the file that the robot lacks.")
    ] = "",
    tolerance: Annotated[
        float, typer.Option(help="Relative difference that counts as none.")
    ] = ENGINES,
    seed: Annotated[
        int, typer.Option(help="Seed of the random state that is compared.", min=0)
    ] = 0,
    as_json: arg.AsJson = False,
) -> None:
    """Compare a robot with a file in MuJoCo, and name what differs; exits with 1 if they differ.

    Both are compared in a random moving state with closed loops, with random
    torques at the motors.
    """
    from condyn_pin.cli.words import names_in, pairs_in, robot_of
    from condyn_pin.io.mjcf_file import compiled
    from condyn_pin.io.xml import place
    from condyn_pin.study.mujoco.bridge import MujocoBridge

    chosen = robot_of(source)
    names = pairs_in("--name", name, "OURS=THEIRS is needed, such as root_joint=floating_base")
    with place(mjcf):
        model, _ = compiled(mjcf)
    bridge = MujocoBridge(chosen, model, names=names, without=names_in(without))
    found = bridge.compare(*_random_state(chosen, seed), tolerance=tolerance)
    if as_json:
        print_json(found.to_dict())
    else:
        print_text(str(found))
    exit_with_status(ok=found.ok)


def _random_state(robot: Robot, seed: int) -> tuple[Array, Array, Array]:
    """Return q and v with the loops closed, and torques at the motors."""
    import numpy as np

    from condyn_pin._core.models import indices
    from condyn_pin.dynamics.scene import Scene

    rng = np.random.default_rng(seed)
    q, v = Scene(robot, robot.loops).sample(rng)
    tau = np.zeros(robot.nv)
    motors = indices(robot.model, robot.motor_joints)[1]
    tau[motors] = rng.normal(size=motors.size)
    return q, v, tau


def solvers(as_json: arg.AsJson = False) -> None:
    """List the solvers: constraints, cost, use and parameters of each."""
    if as_json:
        print_json(solver_rows())
        return

    def facts(row: SolverRow) -> Table:
        lines = Table.grid(padding=(0, 2, 0, 0))
        lines.add_row("rows", row.kinds)
        lines.add_row("redundant", row.redundant)
        lines.add_row("cost", row.cost)
        lines.add_row("use", row.use)
        lines.add_row("parameters", row.parameters.replace("\n", ", "))
        return lines

    table = text_table("solver", "redundant: rows that depend on others, and singular states")
    table.show_lines = True
    for row in solver_rows():
        table.add_row(row.name, facts(row))
    console.print(table)


@dataclass(frozen=True)
class SolverRow:
    """One solver in words, as it declares itself."""

    name: str  # as `cp.NAME()` and, in any case of letters, for ``--solver``
    kinds: str  # of constraints that it takes
    redundant: str  # what it makes of redundant rows, and of states where rows become so
    cost: str
    use: str
    parameters: str  # its fields with their defaults, one a line; None is found on the scene


def solver_rows() -> tuple[SolverRow, ...]:
    """Return a row for every solver."""
    from condyn_pin.dynamics.solvers import SOLVERS
    from condyn_pin.dynamics.solvers.solver import parameter_fields
    from condyn_pin.dynamics.workspace import constraint_kinds_of

    rows = []
    for kind in SOLVERS.values():
        singular = "mu > 0, else singular" if hasattr(kind, "mu") else "singular"
        default = kind()
        values = ((f.name, getattr(default, f.name)) for f in parameter_fields(kind))
        rows.append(
            SolverRow(
                kind.__name__,
                constraint_kinds_of(kind),
                "yes" if kind.takes_redundant else singular,
                kind.cost,
                kind.use,
                "\n".join(f"{name}={value!r}" for name, value in values),
            )
        )
    return tuple(rows)


@arg.of_a_robot
def export(
    source: arg.Source,
    mjcf: Annotated[Path, typer.Option(help="Write the robot with its loops here, for MuJoCo.")],
    without: Annotated[str, typer.Option(help="Comma-separated: loops to leave out.")] = "",
    friction: Annotated[
        float | None,
        typer.Option(help="Add a floor z = 0 with this friction for its feet."),
    ] = None,
    shapes: Annotated[
        bool,
        typer.Option("--shapes", help="Include shapes and meshes."),
    ] = False,
) -> None:
    """Write a robot in another format."""
    from condyn_pin._core.files import write_text
    from condyn_pin.cli.words import feet_of, names_in, robot_of
    from condyn_pin.io.mjcf_write import not_written

    check_written(mjcf)
    loaded = robot_of(source)
    text = loaded.to_mjcf(
        without=names_in(without), contacts=feet_of(loaded, friction), shapes=shapes
    )
    write_text(mjcf, text)
    print_text(f"written: {mjcf}")
    if lost := not_written(loaded):
        print_text(f"not written: {lost}")


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


COMMANDS = (
    robots,
    show,
    view,
    compare,
    solvers,
    export,
    doctor,
)
