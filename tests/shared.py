"""Scenes, states and answers that many tests share, made once."""

from __future__ import annotations

import functools
import inspect
import subprocess
import sys
from collections.abc import Callable, Collection, Iterable

import numpy as np
import pinocchio as pin
import pytest

import condyn_pin as cp
from condyn_pin._core.compiled import compiled
from condyn_pin.constraints.loop import axis_of as axis_of
from condyn_pin.dynamics.scene import motor_torque, standard_scenes
from condyn_pin.dynamics.workspace import unsupported_constraints
from condyn_pin.errors import MissingExtra

try:
    HEADERS = compiled().pinocchio  # of the compiled core; nothing without it
except MissingExtra:
    HEADERS = ""


@functools.cache
def robot(name: str) -> cp.Robot:
    return cp.load_robot(name)


@functools.cache
def all_scenes() -> dict[str, cp.Scene]:
    """Every standard scene of every robot, and a few that are hard on purpose.

    Every solver answers each of them, refuses it by name, or reports that its answer is inaccurate:
    a scene that is hard in another way needs an entry here, and nothing else.
    """
    scenes = {}
    for name in cp.io.available_robots():
        scenes |= standard_scenes(robot(name))
    talos, bar = robot("talos"), robot("four_bar")
    left, right = talos.contacts
    scenes["talos foot to foot, welded"] = cp.Scene(
        talos, [left, cp.Loop("left_sole_link", "right_sole_link", "weld")]
    )
    scenes["talos hands to the world and together"] = cp.Scene(
        talos,
        [
            cp.Loop("world", "gripper_left_base_link", name="held"),
            cp.PointContact("right_sole_link", offset=(0.1, 0, 0), name="toe"),
            right,
        ],
    )
    scenes["talos foot held twice"] = cp.Scene(
        talos, [left, cp.SurfaceContact("left_sole_link", name="again"), right]
    )
    scenes |= scenes_of_every_kind()
    scenes["four_bar backwards"] = cp.Scene(bar, [cp.Loop("rocker_tip", "coupler_tip")])
    scenes["solo12 alone"] = cp.Scene(robot("solo12"))
    return scenes


def scenes_of_every_kind() -> dict[str, cp.Scene]:
    """Loops and contacts with other rows than 3 and 6."""
    talos, cassie, bar = robot("talos"), robot("cassie"), robot("four_bar")
    left, right = talos.contacts
    hands = ("gripper_left_base_link", "gripper_right_base_link")
    tips = ("coupler_tip", "rocker_tip")
    edge = pin.SE3(np.eye(3), np.array([0.1, -0.2, 0.3]))
    tilted = talos.with_frame("beam", "world", (0.4, 0.1, 1.0), pin.rpy.rpyToMatrix(0.3, 0.2, 0.1))
    return {
        "four_bar hinge": cp.Scene(bar, [cp.Loop(*tips, "hinge", axis="y")]),
        "four_bar planar": cp.Scene(bar, [cp.Loop(*tips, "planar", axis="y")]),
        "four_bar rod": cp.Scene(bar, [cp.Loop("crank_tip", "rocker_tip", "rod", length=0.8)]),
        "four_bar geared": cp.Scene(bar, [cp.constraints.Coupling("rocker", "crank", -0.5, 0.7)]),
        "talos hands hinged": cp.Scene(talos, [left, cp.Loop(*hands, "hinge", axis="x")]),
        "talos hands on a rod": cp.Scene(
            talos, [left, right, cp.Loop(*hands, "rod", length=0.5, name="rod")]
        ),
        "talos hands on a slider": cp.Scene(talos, [right, cp.Loop(*hands, "slider", axis="y")]),
        "talos hand on a beam": cp.Scene(
            tilted,
            [
                cp.Loop("world", hands[1], "hinge", axis="x", name="bar"),
                cp.Loop("beam", hands[0], "slider", axis="x"),
                cp.Loop("right_sole_link", "beam", "planar", axis="y"),
            ],
        ),
        "talos on edges and planes": cp.Scene(
            talos,
            [
                cp.constraints.LineContact("left_sole_link", "y", half_length=0.06),
                cp.constraints.LineContact("right_sole_link", "x", 0.09, edge, name="edge"),
                cp.constraints.PlanarContact(
                    hands[0], (0.0, 0.0, 0.1), (1.0, 0.0, 2.0), name="wall"
                ),
                cp.constraints.PlanarContact(
                    hands[1], normal=(0.0, 1.0, 0.0), height=-0.4, name="side"
                ),
            ],
        ),
        "talos arms geared": cp.Scene(
            talos,
            [
                left,
                cp.constraints.Coupling("arm_left_4_joint", "arm_right_4_joint"),
                cp.constraints.Coupling("leg_left_4_joint", "leg_right_4_joint", -2.0, 1.5),
            ],
        ),
        "cassie on lines": cp.Scene(
            cassie,
            [
                *cassie.loops,
                *(cp.constraints.LineContact(f"{side}-foot") for side in ("left", "right")),
            ],
        ),
    }


# The promises of a status, as the documentation has them: of a and of J^T lam, relative; of a loop
# that is closed [m, rad]; and of derivatives that a check has passed.
SOLVED, FORCES, CLOSED, DERIVATIVES = 1e-8, 1e-7, 1e-10, 1e-6

# The six derivatives of an answer.
BLOCKS = ("da_dq", "da_dv", "da_dtau", "dlam_dq", "dlam_dv", "dlam_dtau")
HAS_LCABA = not cp.LCABA.missing()  # Pinocchio 3 has none
SOLVERS = {name: kind for name, kind in cp.dynamics.SOLVERS.items() if not kind.missing()}


@functools.cache
def states(label: str, count: int = 4) -> tuple[tuple[np.ndarray, np.ndarray, np.ndarray], ...]:
    """Closed, moving states of a scene under motor torques."""
    scene = all_scenes()[label]
    rng = np.random.default_rng(7)
    return tuple((*scene.sample(rng), motor_torque(scene.robot, rng)) for _ in range(count))


@functools.cache
def truth(label: str, count: int = 4) -> tuple[cp.dynamics.Solution, ...]:
    workspace = cp.Workspace(all_scenes()[label], cp.dynamics.Reference())
    return tuple(workspace.solve(*state, throw=False) for state in states(label, count))


def relative(a: np.ndarray, b: np.ndarray, floor: float = 9.81) -> float:
    """Largest difference over the larger of |b| and gravity."""
    return float(np.abs(a - b).max(initial=0.0) / max(np.abs(b).max(initial=0.0), floor))


def central(f: Callable[[float], np.ndarray], h: float = 1e-4) -> np.ndarray:
    """f'(0) by central differences of the fourth order."""
    return (8 * (f(h) - f(-h)) - (f(2 * h) - f(-2 * h))) / (12 * h)


def calls(work: Callable[[], object]) -> int:
    """Count the calls that Python makes, the second time: a clock that no other work slows."""
    work()  # it may import
    count = 0

    def tick(*_: object) -> None:
        nonlocal count
        count += 1

    sys.setprofile(tick)
    try:
        work()
    finally:
        sys.setprofile(None)
    return count // 2  # a call and its return


# Of every kind of row and of base one scene, and of every way in which rows are redundant.
CHOSEN = (
    "cassie loops + contacts", "panda contacts", "solo12 contacts", "solo12 alone",
    "talos contacts", "delta loops", "four_bar loops", "rolling_ball contacts",
    "rolling_disc contacts", "sleigh contacts", "talos foot to foot, welded",
    "talos foot held twice", "four_bar rod", "four_bar geared", "talos hand on a beam",
    "talos on edges and planes",
)  # fmt: skip


def each_of(
    labels: Iterable[str], chosen: Collection[str] = CHOSEN, name: str = "label"
) -> pytest.MarkDecorator:
    """Give a test each of these scenes or robots; those that are not chosen are long."""
    every = [pytest.param(x, marks=() if x in chosen else pytest.mark.long) for x in labels]
    return pytest.mark.parametrize(name, every)


each_scene = each_of(all_scenes())
CHOSEN_ROBOTS = {label.split()[0] for label in CHOSEN}
each_robot = each_of(cp.io.available_robots(), CHOSEN_ROBOTS, "name")
each_solver = pytest.mark.parametrize("solver", [s() for s in SOLVERS.values()], ids=list(SOLVERS))
each_exact_solver = pytest.mark.parametrize(
    "solver",
    [s() for s in SOLVERS.values() if s.exact],
    ids=[name for name, s in SOLVERS.items() if s.exact],
)


def each_row(names: str | Collection[str], rows: object) -> Callable:
    """Give a test every row of a table, as one case that lists the rows that fail.

    Of one name a row is its value, of several it is a tuple; those of a dictionary have labels.
    """
    names = names.split(",") if isinstance(names, str) else names
    labelled = rows if isinstance(rows, dict) and len(names) > 1 else dict(enumerate(rows))

    def decorated(test: Callable) -> Callable:
        @functools.wraps(test)
        def every(**fixtures: object) -> None:
            failed = []
            for label, row in labelled.items():
                values = row if len(names) > 1 else (row,)
                try:
                    test(**dict(zip(names, values, strict=True)), **fixtures)
                except (Exception, pytest.fail.Exception) as error:
                    error.add_note(f"row {label!r}: {values!r}"[:400])
                    failed.append(error)
            if failed:
                raise BaseExceptionGroup(f"{len(failed)} of {len(labelled)} rows", failed)

        signature = inspect.signature(test)
        fixtures = [p for name, p in signature.parameters.items() if name not in names]
        every.__signature__ = signature.replace(parameters=fixtures)
        return every

    return decorated


def takes(solver: cp.dynamics.Solver, scene: cp.Scene) -> bool:
    """Whether a solver can say ok on a scene."""
    redundant = bool(scene.nominal.redundant)
    return not unsupported_constraints(scene, solver) and (solver.takes_redundant or not redundant)


def short_lever(r: float) -> cp.Scene:
    """A body that is held, and a limb on it whose tip is r [m] from its axis, a pin's rounding."""
    model = pin.Model()
    here = pin.SE3.Identity()
    body = model.addJoint(0, pin.JointModelFreeFlyer(), here, "body")
    model.appendBodyToJoint(body, pin.Inertia.FromSphere(1.0, 0.1), here)
    model.addFrame(pin.Frame("body", body, 0, here, pin.FrameType.OP_FRAME))
    limb = model.addJoint(body, pin.JointModelRY(), here, "limb")
    model.appendBodyToJoint(limb, pin.Inertia.FromSphere(0.1, 0.02), here)
    tip = pin.SE3(np.eye(3), np.array([r, 0, 0]))
    model.addFrame(pin.Frame("tip", limb, 0, tip, pin.FrameType.OP_FRAME))
    held = cp.SurfaceContact("body")
    tips = [cp.FrictionalContact("tip", cp.constraints.Point(), friction=0.0)]
    return cp.Scene(cp.Robot("lever", model), [held], contacts=tips)


@functools.cache
def imported_by_a_solve() -> frozenset[str]:
    """What a first solve of a four-bar imports of this library, in an interpreter of its own."""
    program = """
import sys
import numpy as np
import condyn_pin as cp
bar = cp.model.four_bar()
scene = cp.Scene(bar, bar.loops)
cp.solve(scene, cp.dynamics.described_posture(scene), np.zeros(3), np.zeros(3))
print(*sys.modules)
"""
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
    return frozenset(name for name in result.stdout.split() if name.startswith("condyn_pin"))
