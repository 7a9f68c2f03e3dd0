"""Commands that answer at one state: closed loops, forward dynamics, control."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import numpy as np
import typer

from condyn_pin._core.tolerances import SOLVED
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
    warn,
    with_options,
)
from condyn_pin.errors import InvalidArgument

if TYPE_CHECKING:
    from rich.table import Table

    from condyn_pin.control.answer import ControlAnswer
    from condyn_pin.dynamics.solution import Solution


@arg.of_a_robot
def solve(
    source: arg.Source,
    contacts: arg.Contacts = "",
    loops: arg.Loops = True,
    posture: arg.Posture = None,
    q: arg.JointValues = None,
    tau: Annotated[
        list[str] | None,
        typer.Option(help="JOINT=TORQUE [N m or N], zero for the others; repeat it for others."),
    ] = None,
    force: Annotated[
        list[str] | None,
        typer.Option(
            help="FRAME=FX,FY,FZ or FRAME=FX,FY,FZ,MX,MY,MZ [N, N m]: a force from outside at the "
            "frame, along the axes of the world; repeat it for others."
        ),
    ] = None,
    solver: arg.SolverOrNone = None,
    mu: Annotated[float | None, typer.Option(help="Regularisation [1/kg].")] = None,
    max_iterations: Annotated[
        int | None, typer.Option(help="Largest number of iterations.")
    ] = None,
    accuracy: Annotated[float, typer.Option(help="Largest acceptable error of a.")] = SOLVED,
    as_json: arg.AsJson = False,
) -> None:
    """Solve for accelerations and forces at rest; exits with 1 if the status is not ok."""
    from condyn_pin.cli.words import forces_of, scene_of, solver_of, state_of, torque_of
    from condyn_pin.dynamics.workspace import default_solver
    from condyn_pin.dynamics.workspace import solve as solve_scene

    scene = scene_of(source, contacts, loops)
    torques, forces = torque_of(scene, tau), forces_of(scene, force)
    at, v = state_of(scene, posture, q)
    name = solver or type(default_solver(scene)).__name__
    chosen = solver_of(name, {"mu": mu, "max_iterations": max_iterations})
    solution = solve_scene(
        scene, at, v, torques, forces=forces, solver=chosen, accuracy=accuracy, throw=False
    )
    if as_json:
        print_json({"robot": scene.robot.name, "solver": repr(chosen)} | _solution_facts(solution))
    else:
        print_text(f"{scene.robot.name}, {chosen!r}")
        print_text(str(solution))
        _say_state(solution)
        if not scene.constraints:
            ready = ", ".join(contact.name for contact in scene.robot.contacts) or "FRAME:KIND"
            print_text(f"note: no constraints; --contacts takes {ready}")
        for note in scene.rank(at).notes:
            print_text(f"note: {note}")
    if not solution.status.ok:
        warn(str(solution.status))
        exit_with_status(ok=False)


def _say_state(solution: Solution) -> None:
    from condyn_pin._core.models import indices

    robot = solution.scene.robot
    places = robot.joint_values(solution.q)
    rates = {name: solution.a[indices(robot.model, [name])[1]] for name in robot.joints}
    for title, values in (
        ("the joints are at, free-flyers with x y z and a quaternion x y z w [rad, m]:", places),
        ("accelerations of the joints, free-flyers linear first [rad/s^2, m/s^2]:", rates),
    ):
        print_text(title)
        for name, numbers in values.items():
            print_text(f"{name:<28} {' '.join(f'{value:.6g}' for value in np.atleast_1d(numbers))}")


def _solution_facts(solution: Solution) -> dict[str, object]:
    from condyn_pin._core.timing import machine

    return {
        "status": solution.status.word,
        "advice": str(solution.status),
        "q": solution.q,
        "a": solution.a,
        "lam": solution.lam,
        "world_forces": solution.world_forces,
        "forces": solution.forces,
        "dynamics_error": solution.dynamics_error,
        "constraint_error": solution.constraint_error,
        "state_error": list(solution.state_error),
        "error_bound": solution.error_bound,
        "iterations": solution.iterations,
        "solve_time": solution.solve_time,
        "machine": machine(),
    }


_NOTHING = (
    "the file has no loops, so there is nothing to close; a robot.toml beside it adds loops "
    "(docs/how-to-close-a-loop.md)"
)


@arg.of_a_robot
def assemble(
    source: arg.Source,
    loops: arg.Loops = True,
    posture: arg.Posture = None,
    q: arg.JointValues = None,
    fixed: Annotated[str, typer.Option(help="Comma-separated: joints that keep their value.")] = "",
    limits: Annotated[bool, typer.Option(help="Keep the joints within their limits.")] = True,
    as_json: arg.AsJson = False,
) -> None:
    """Close the loops, starting from a posture; exits with 1 if they cannot be closed."""
    from condyn_pin.cli.words import names_in, posture_of, scene_of

    scene = scene_of(source, "", loops)
    start, kept = posture_of(scene, posture, q)
    kept += [name for name in names_in(fixed) if name not in kept]
    assembly = scene.assemble(start, fixed=kept, within_limits=limits, throw=False)
    joints = {}
    for name in scene.robot.joints:
        joint = scene.robot.model.joints[scene.robot.model.getJointId(name)]
        joints[name] = assembly.q[joint.idx_q : joint.idx_q + joint.nq]
    if as_json:
        status = {
            "status": assembly.status.word,
            "advice": with_options(assembly.status.value),
        }
        print_json(json_value(assembly) | status | {"joints": joints})
    else:
        print_text(str(assembly))
        if not scene.constraints:
            print_text(f"note: {_NOTHING if loops else '--no-loops leaves nothing to close'}")
        for name, values in joints.items():
            print_text(f"{name:<28} {' '.join(f'{value:.9g}' for value in values)}")
    exit_with_status(ok=assembly.status.ok)


Qp = Annotated[
    str,
    typer.Option(
        help="proxqp, daqp, quadprog or anyqp.", autocompletion=arg.names_of("control", "QPS")
    ),
]

_UP: Final = 2.0  # [m/s^2]
_SHOWN: Final = 6  # motors, the hardest worked first; `--json` has all of them


@arg.of_a_robot
def control(
    source: arg.Source,
    contacts: Annotated[
        str, typer.Option(help="As in `condyn solve`; by default all contacts of the robot.")
    ] = "",
    loops: arg.Loops = True,
    posture: arg.Posture = None,
    lift: Annotated[
        list[str] | None,
        typer.Option(help="A contact, or a frame with all of its contacts; repeat for others."),
    ] = None,
    up: Annotated[
        float | None,
        typer.Option(help="Upward acceleration of the lifted feet [m/s^2]; 2 by default."),
    ] = None,
    com: Annotated[
        str | None,
        typer.Option(help="Demand this acceleration of the centre of mass, as 0,0,-11 [m/s^2]."),
    ] = None,
    friction: Annotated[float, typer.Option(help="Friction of all contacts.")] = 0.6,
    qp: Qp = "proxqp",
    html: Annotated[
        Path | None,
        typer.Option("--html", "--view", help="Write a page with forces and balance."),
    ] = None,
    png: Annotated[Path | None, typer.Option(help="Write a picture; needs Chromium.")] = None,
    as_json: arg.AsJson = False,
) -> None:
    """Stand, or lift a foot, by whole-body control; exits with 1 if the status is not ok.

    One tick at rest keeps the centre of mass and the trunk, and then the posture. If that fails,
    the contradicting rows are named, with the least amount by which they have to be relaxed.
    """
    from condyn_pin.cli.words import ready_contacts, robot_of, scene_of, stand_and_lift

    check_ending(html, ".html", ".htm")
    check_ending(png, ".png")
    check_written(html, png)
    listed = contacts or ready_contacts(robot_of(source))
    scene = scene_of(source, listed, loops)
    rise = _lift_acceleration(up, lift or [])
    before, after = stand_and_lift(
        scene, posture, lift or [], rise, _demanded_acceleration(com), friction, qp
    )
    shown = after or before
    if as_json:
        print_json(_control_facts(before, after))
    else:
        _print_answers(before, after)
    if shown.status.ok and (html or png):
        from condyn_pin.viewing.viewer import view

        view(shown, balance=True, html=html, png=png, browser=False)
        for path in (html, png):
            if path and not as_json:
                print_text(f"written: {path}")
    exit_with_status(ok=shown.status.ok)


def _lift_acceleration(up: float | None, lift: list[str]) -> float:
    """Return the acceleration of the lifted feet [m/s^2]."""
    from condyn_pin._core.arrays import finite

    if up is None:
        return _UP
    rise = float(finite("--up", up, ()))
    if not lift:
        raise InvalidArgument(f"--up {up:g}: no foot is lifted; --lift FOOT says which")
    return rise


def _demanded_acceleration(text: str | None) -> tuple[float, ...] | None:
    """Return the acceleration that a text demands."""
    from condyn_pin.cli.words import names_in

    if text is None:
        return None
    try:
        found = tuple(map(float, names_in(text)))
    except ValueError:
        found = ()
    if len(found) != 3:
        raise InvalidArgument(f"--com {text}: three numbers are needed, such as 0,0,-11")
    return found


def _print_answers(before: ControlAnswer, after: ControlAnswer | None) -> None:
    """Print forces, task errors, motor torques and the residuals of the answer."""
    shown = after or before
    print_text(f"{shown.scene.robot.name}: {shown.status}")
    if shown.infeasible:
        print_text(str(shown.infeasible))
        return
    if not shown.status.ok:
        return
    if before.margins:
        console.print(_forces(before, after))
    console.print(_errors(shown))
    console.print(_motors(shown))
    for name, its in _bounds(shown).items():
        print_text(f"at its bound    {name}: {', '.join(its)}")
    r = shown.residuals
    print_text(f"KKT residual    {r.kkt:.1e} m/s^2, by {', '.join(shown.path)}")
    print_text(f"dynamics        {r.dynamics:.1e} N m, by Newton-Euler")
    print_text(f"constraints     {r.constraints:.1e} m/s^2, by forward kinematics")
    if shown.scene.robot.springs:
        print_text("note: springs push as far as this posture bends them, and no further")


def _bounds(answer: ControlAnswer) -> dict[str, list[str]]:
    """Active rows by contact, motor or joint."""
    found: dict[str, list[str]] = {}
    for row in answer.active:
        name, _, what = row.partition(": ")
        found.setdefault(name, []).append(what)
    return found


def _forces(before: ControlAnswer, after: ControlAnswer | None) -> Table:
    table = text_table("contact", "force before [N]" if after else "force [N]")
    if after:
        table.add_column("after [N]")
    table.add_column("margin [N]")
    margins = (after or before).margins
    for name in before.margins:
        cells = [_vector(before, name)] + ([_vector(after, name)] if after else [])
        margin = margins.get(name)
        table.add_row(name, *cells, _number(after or before, float(margin.least)) if margin else "")
    return table


def _vector(answer: ControlAnswer, name: str) -> str:
    force = answer.forces.get(name)
    if force is None:
        return "lifted"
    return " ".join(_number(answer, f) for f in force.in_world()[:3])


def _number(answer: ControlAnswer, force: float) -> str:
    """Force as text [N]; zero if it is rounding error of the largest force."""
    return "0" if abs(force) < SOLVED * max(abs(answer.lam)) else f"{force:.4g}"


def _errors(answer: ControlAnswer) -> Table:
    table = text_table("task", "J a + drift - wanted [m/s^2, rad/s^2]")
    for name, error in answer.errors.items():
        table.add_row(name, f"{max(abs(error), default=0.0):.3g} at most")
    return table


def _motors(answer: ControlAnswer) -> Table:
    table = text_table("motor", "torque [N m, N]", "of its limit")
    for name, torque, share in _motor_loads(answer)[:_SHOWN]:
        table.add_row(name, f"{torque:.4g}", "no limit" if share is None else f"{share:.0%}")
    return table


def _motor_loads(answer: ControlAnswer) -> list[tuple[str, float, float | None]]:
    """Motors, their torques, and the shares of their torque limits, the largest share first.

    With them joints on which several motors act, if they have a limit.
    """
    import numpy as np

    from condyn_pin.control.limits import TorqueLimits

    limits = TorqueLimits.of(answer.actuation)
    torques = limits.L @ (answer.actuation.gears * answer.u)
    most = np.where(torques < 0, limits.least, limits.most)
    shares = np.divide(torques, most, out=np.zeros(len(most)), where=most != 0)
    limited = zip(limits.names, torques.tolist(), shares.tolist(), strict=True)
    rows = [*limited] + [(m, t, None) for m, t in answer.torques.items() if m not in limits.names]
    return sorted(rows, key=lambda row: -(row[2] if row[2] is not None else 0.0))


def _control_facts(before: ControlAnswer, after: ControlAnswer | None) -> dict[str, object]:
    from condyn_pin._core.timing import machine

    shown = after or before
    return {
        "robot": shown.scene.robot.name,
        "status": shown.status.word,
        "advice": str(shown.status),
        "tau": shown.tau,
        "a": shown.a,
        "lam": shown.lam,
        "forces": {k: f.in_world() for k, f in shown.forces.items()},
        "forces_before": {k: f.in_world() for k, f in before.forces.items()},
        "margins": {k: float(margin.least) for k, margin in shown.margins.items()},
        "errors": shown.errors,
        "active": shown.active,
        "torques": {
            name: {"torque": t, "of_limit": share} for name, t, share in _motor_loads(shown)
        },
        "infeasible": shown.infeasible,
        "residuals": shown.residuals,
        "path": shown.path,
        "solve_time": shown.solve_time,
        "machine": machine(),
    }


COMMANDS = (
    solve,
    assemble,
    control,
)
