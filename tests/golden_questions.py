"""What golden.py asks, by public names only: records of trees with other modules compare, too."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import condyn_pin as cp

sys.path.append(str(Path(__file__).parents[1] / "benchmarks"))
import lab

if TYPE_CHECKING:
    from golden import Record

# Robots that move, by every integrator with every drift scheme; those beyond 20 joints by a few.
MOVED = ("four_bar", "pendulum", "delta", "cassie", "solo12", "rolling_disc", "sleigh")
ON_LARGE = (
    *("dormandprince", "expliciteuler", "implicitmidpoint"),
    *("generalisedalpha", "radauiia", "gearguptaleimkuhler"),
)
ON_EXTREMES = (cp.dynamics.NullSpace, cp.Proximal, cp.DenseKKT, cp.dynamics.GaussPrinciple)
BLOCKS = ("da_dq", "da_dv", "da_dtau", "dlam_dq", "dlam_dv", "dlam_dtau")
COMMANDS = """
--help | show --help | solve --help | robots | robots --json | solvers | solvers --json | problem
show four_bar | show cassie --json | show talos --frames | assemble delta --json
assemble stewart --posture lifted | solve cassie --solver nullspace | solve talos --contacts wrist
solve five_bar --solver densekkt | solve talos --contacts left_sole_link,right_sole_link
simulate delta --duration 0.02 --csv OUT.csv | simulate cassie --duration 0.01 --save OUT.npz
problem heavy_top --duration 0.05 | problem A01 --dt 0.01 | drift --steps 20 | solve nothing
export four_bar --mjcf OUT.xml | view four_bar --no-browser --html OUT.html | trade nothing
""".replace("\n", "|")


def ask(record: Record) -> None:
    """Put every question, always in the same order."""
    for label, scene in scenes().items():
        for questions in (on_states, on_solvers, on_derivatives, on_verbs):
            questions(record, label, scene)
    for name in MOVED:
        on_motions(record, name)
    for questions in (on_batches, on_extremes, on_bad_input, on_commands):
        questions(record)


def scenes() -> dict[str, cp.Scene]:
    """Every robot with its loops, and with its contacts; and constraints of every kind."""
    robots = {name: cp.load_robot(name) for name in cp.io.available_robots()}
    found = {}
    for name, robot in robots.items():
        found[f"{name} loops"] = cp.Scene(robot, robot.loops)
        if robot.contacts:
            found[f"{name} contacts"] = cp.Scene(robot, (*robot.loops, *robot.contacts))
    bar, talos, solo = robots["four_bar"], robots["talos"], robots["solo12"]
    tips = ("coupler_tip", "rocker_tip")
    hands = ("gripper_left_base_link", "gripper_right_base_link")
    left, right = talos.contacts
    on_talos = {
        "corners": (*left.corners(), *right.corners()),
        "twice": (left, right, cp.SurfaceContact(left.frame, name="again")),
        "hinge": (left, cp.Loop(*hands, "hinge", axis="x")),
        "weld": (left, cp.Loop(left.frame, right.frame, "weld")),
        "slider": (right, cp.Loop(*hands, "slider", axis="y")),
        "rod": (left, right, cp.Loop(*hands, "rod", length=0.5)),
        "edges": (
            cp.constraints.LineContact(left.frame, "y", half_length=0.06),
            cp.constraints.PlanarContact(right.frame),
        ),
        "geared": (
            left,
            cp.constraints.Coupling("arm_left_4_joint", "arm_right_4_joint", -2.0, 1.5),
        ),
    }
    on_bar = {
        "hinge": cp.Loop(*tips, "hinge", axis="y"),
        "planar": cp.Loop(*tips, "planar", axis="y"),
        "rod": cp.Loop("crank_tip", "rocker_tip", "rod", length=0.8),
        "geared": cp.constraints.Coupling("rocker", "crank", -0.5, 0.7),
    }
    found |= {f"talos {key}": cp.Scene(talos, rows) for key, rows in on_talos.items()}
    found |= {f"four_bar {key}": cp.Scene(bar, [row]) for key, row in on_bar.items()}
    return found | {"solo12 two feet": cp.Scene(solo, solo.contacts[:2])}


def states(scene: cp.Scene, count: int = 1) -> list[Sequence[np.ndarray]]:
    """Closed, moving states, with motor torques."""
    rng, model = np.random.default_rng(7), scene.robot.model
    found = []
    for _ in range(count):
        q, v = scene.sample(rng)
        tau = np.zeros(model.nv)
        for name in scene.robot.actuated:
            joint = model.joints[model.getJointId(name)]
            tau[joint.idx_v : joint.idx_v + joint.nv] = rng.normal(size=joint.nv)
        found.append((q, v, scene.robot.mass * tau))
    return found


def on_states(record: Record, label: str, scene: cp.Scene) -> None:
    """What a scene says of itself, and the states that it allows."""
    record.keep(f"{label}: summary", lambda: str(scene.summary()))
    record.keep(f"{label}: rank", scene.rank)
    record.keep(f"{label}: rank in words", lambda: str(scene.rank()))
    record.keep(f"{label}: rows", lambda: scene.row_names)
    record.keep(f"{label}: sample", states, scene, 3)
    record.keep(
        f"{label}: sample_batch", cp.simulation.sample_batch, scene, 3, np.random.default_rng(3)
    )
    for posture in scene.robot.postures:
        record.keep(f"{label}: state {posture}", scene.state, posture)
        guess = cp.dynamics.described_posture(scene, posture)
        record.keep(f"{label}: assemble {posture}", scene.assemble, guess, throw=False)
    q, v, _ = states(scene)[0]
    record.keep(f"{label}: check", scene.check, cp.dynamics.described_posture(scene), v)
    record.keep(
        f"{label}: project", cp.mechanism.project_velocity, scene, q, v + 1.0, metric="identity"
    )
    record.keep(
        f"{label}: project a", cp.mechanism.project_acceleration, scene, q, v, np.ones(len(v))
    )


def on_solvers(record: Record, label: str, scene: cp.Scene) -> None:
    """The answers of every solver, with a_ref and without."""
    for name, solver in cp.dynamics.SOLVERS.items():
        for drift, state in zip((None, cp.Baumgarte(20.0, 10.0)), states(scene, 2), strict=True):
            key = f"{label}: {name}, {drift}"
            answer = record.keep(
                key, cp.solve, scene, *state, solver=solver(), drift=drift, throw=False
            )
            if answer is not None:
                record.keep(f"{key} in words", str, answer)


def on_derivatives(record: Record, label: str, scene: cp.Scene) -> None:
    """Derivatives by every method; by differences where they take no minute."""

    def blocks(**options: Any) -> list[np.ndarray]:
        found = cp.derivatives(scene, *states(scene)[0], **options)
        return [getattr(found, block) for block in BLOCKS]

    record.keep(f"{label}: derivatives kkt", blocks, solver=cp.dynamics.NullSpace())
    record.keep(f"{label}: derivatives pinocchio", blocks, method="pinocchio")
    if scene.robot.nv < 20:
        record.keep(f"{label}: derivatives differences", blocks, method="differences")


def on_verbs(record: Record, label: str, scene: cp.Scene) -> None:
    """What else can be asked of a state."""
    q, v, tau = states(scene)[0]
    frame = scene.robot.model.frames[scene.robot.model.nframes - 1].name
    push, cone = cp.AppliedForce(frame, force=(1.0, 2.0, 3.0)), cp.contact.FrictionCone(0.7)
    motors = list(scene.robot.actuated)[:1]
    calls: dict[str, Callable[[], Any]] = {
        "inverse": lambda: cp.inverse_dynamics(scene, q, v, np.ones(len(v))),
        "gravity": lambda: cp.control.gravity_compensation(scene, q),
        "impact": lambda: cp.impact(scene, q, v + 0.5),
        "impact by q": lambda: cp.impact(scene, q, v + 0.5, restitution=0.3).dv_dq,
        "operational": lambda: cp.control.operational_space(scene, q, frame),
        "pushed": lambda: cp.solve(scene, q, v, tau, forces=[push]),
        "terms": lambda: cp.Workspace(scene).terms(q, v),
        "transmission": lambda: cp.control.transmission(scene, q),
        "integrable": lambda: cp.mechanism.is_integrable(scene, q),
        "locked": lambda: str(scene.lock(motors, q).summary()),
        "modellings": lambda: [str(scene) for scene in cp.study.modellings(scene)],
        "margins": lambda: cp.contact.margins(cp.solve(scene, q, v, tau), cone),
        "cone rows": lambda: cp.contact.cone_rows(scene, q, cone),
        "mjcf": lambda: scene.robot.to_mjcf(),
    }
    if scene.robot.nv < 20:
        calls["merged"] = lambda: str(cp.mechanism.merge_points(scene).summary())
        calls["minimal"] = lambda: str(scene.minimal(error=1e-3))
    for name, call in calls.items():
        record.keep(f"{label}: {name}", call)


def on_motions(record: Record, name: str) -> None:
    """Twenty steps."""
    robot = cp.load_robot(name)
    scene = cp.Scene(robot, (*robot.loops, *robot.contacts))
    start, run = scene.state(), {"duration": 0.02, "dt": 1e-3}
    drifts = [
        cp.Baumgarte(30.0, 30.0),
        cp.simulation.NoDrift(),
        cp.simulation.PostStabilization(),
        cp.simulation.Projection(),
    ]
    kinds = cp.simulation.INTEGRATORS
    for integrator in (kinds[each]() for each in (kinds if robot.nv < 20 else ON_LARGE)):
        for drift in drifts:
            key = f"{name}: {integrator}, {drift}"
            x = record.keep(
                key, cp.simulate, scene, *start, integrator=integrator, drift=drift, **run
            )
            if x is not None:
                record.keep(f"{key} in words", str, x)
                record.keep(f"{key}: energy", lambda x: [x.energy, x.momentum, x.forces], x)
                record.keep(f"{key}: gaps", lambda x: [x.violation, x.slip], x)


def on_batches(record: Record) -> None:
    """Many states at once, in this thread and in others."""
    scene = cp.Scene(cassie := cp.load_robot("cassie"), cassie.loops)
    Q, V = cp.simulation.sample_batch(scene, 6, np.random.default_rng(1))
    TAU = np.zeros_like(V)
    with ThreadPoolExecutor(2) as threads:
        for name, executor in {"serial": None, "threads": threads}.items():
            run = {"executor": executor}
            record.keep(f"solve_batch {name}", cp.solve_batch, scene, Q, V, TAU, **run)
            record.keep(
                f"derivatives_batch {name}",
                cp.simulation.derivatives_batch,
                scene,
                Q,
                V,
                TAU,
                **run,
            )
            record.keep(
                f"simulate_batch {name}", cp.simulate_batch, scene, Q, V, duration=5e-3, **run
            )


def on_extremes(record: Record) -> None:
    """Hard questions: the tamest of each family, and one half as hard as they come."""
    bar = cp.model.four_bar()
    scene = cp.Scene(bar, bar.loops)
    for family, extreme in lab.EXTREMES.items():
        light = [each for each in extreme.severities if each not in extreme.heavy]
        for severity in dict.fromkeys((light[0], light[len(light) // 2])):
            key = f"extreme {family} {severity:g}"
            case = record.keep(key, extreme.case, severity, scene=scene)
            for solver in ON_EXTREMES if case else ():
                state = (case.scene, case.q, case.v, case.tau)
                record.keep(f"{key} {solver()}", cp.solve, *state, solver=solver(), throw=False)


def on_bad_input(record: Record) -> None:
    """What is refused, and in which words."""
    bar = cp.model.four_bar()
    scene, zero = cp.Scene(bar, bar.loops), np.zeros(3)
    q = scene.state()[0]
    calls: dict[str, Callable[[], Any]] = {
        "robot": lambda: cp.load_robot("cassi"),
        "file": lambda: cp.load_robot("nowhere.urdf"),
        "frame": lambda: cp.Scene(bar, [cp.PointContact("nowhere")]),
        "kind": lambda: cp.Loop("a", "b", "glue"),
        "axis": lambda: cp.Loop("a", "b", "hinge", axis="w"),
        "one": lambda: cp.Scene(bar, bar.loops[0]),
        "twice": lambda: cp.Scene(bar, [*bar.loops, *bar.loops]),
        "size": lambda: cp.solve(scene, q[:1], zero, zero),
        "nan": lambda: cp.solve(scene, q, zero, zero * np.nan),
        "mu": lambda: cp.Proximal(mu=-1.0),
        "method": lambda: cp.derivatives(scene, q, zero, zero, method="magic"),
        "soft": lambda: cp.derivatives(scene, q, zero, zero, solver=cp.dynamics.Soft()),
        "open": lambda: scene.assemble(q + 1.0, fixed=["crank", "coupler", "rocker"]),
        "start": lambda: cp.simulate(scene, q + 0.3, zero, duration=0.1),
        "dt": lambda: cp.simulate(scene, q, zero, duration=0.1, dt=-1.0),
        "event": lambda: cp.simulate(scene, q, zero, duration=0.1, events=["fall"]),
        "posture": lambda: scene.state("lying"),
        "joint": lambda: scene.lock(["knee"]),
        "cone": lambda: cp.contact.FrictionCone(-0.1),
        "study": lambda: cp.Study([scene], solvers=["magic"]),
    }
    for name, call in calls.items():
        record.keep(f"refused: {name}", call)


def on_commands(record: Record) -> None:
    """Lines of the command line, with the files that they write."""
    for words in filter(None, map(str.strip, COMMANDS.split("|"))):
        with tempfile.TemporaryDirectory() as folder:
            line = [f"{folder}/{word}" if "OUT." in word else word for word in words.split()]
            in_checkout = line[0] in ("problem", "drift")  # they measure the library
            package = [str(Path(lab.__file__).parent)] if in_checkout else ["-m", "condyn_pin"]
            program = [sys.executable, *package, *line]
            ran = subprocess.run(program, capture_output=True, text=True, check=False)
            said = [text.replace(folder, "") for text in (ran.stdout, ran.stderr)]
            record.keep(f"condyn {words}", lambda code, said: [code, *said], ran.returncode, said)
            for path in Path(folder).iterdir():
                if path.suffix != ".npz":  # which has the date
                    record.keep(f"condyn {words}: file", np.fromfile, path, np.uint8)
