"""The compiled core beside Python, beside Pinocchio's bare calls, and beside `mujoco.rollout`.

    python benchmarks/native_core.py [--quick]

Writes benchmarks/results/native_core.json and docs/how-to-run-at-scale.md; with --from-json the
tables are made from the committed results, without running anything.

Everything takes turns in one process, and is timed by processor time, all threads together: that
is what a loaded machine changes least, and threads on cores of their own divide it by their
number. A figure is the median over the rounds. Motions of Cassie are those of `batch_motions.py`.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import importlib.util
import resource
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

import batch_motions
import marks
import numpy as np
import script
from processor_time import processor_time

import condyn_pin as cp
from condyn_pin._core._pin import pin
from condyn_pin._core.compiled import compiled
from condyn_pin.dynamics.derivatives.differences import BLOCKS
from condyn_pin.dynamics.scene import motor_torque, standard_scenes

JSON = marks.ROOT / "benchmarks" / "results" / "native_core.json"
PAGE = "docs/how-to-run-at-scale.md"
ROBOTS = ("talos", "cassie", "solo12", "four_bar")
LEAST = 0.02  # what a turn takes, so that what a verb does once for all states is little [s]


@dataclass(frozen=True)
class Verb:
    """A verb on the states of a scene, processor time a state.

    Attributes
    ----------
    scene, verb : str
    bare, python, core, two, one : float
        Pinocchio's own calls without any proof, Python, the core by one thread and by two, and the
        core for one state after another, in a `Workspace` [us].
    error : float
        Largest difference between the core and Python, relative to the largest number.
    left : int
        States that the core left to Python.
    states : int
    """

    scene: str
    verb: str
    bare: float
    python: float
    core: float
    two: float
    one: float
    error: float
    left: int
    states: int


@dataclass(frozen=True)
class Steps:
    """A way to simulate Cassie.

    Attributes
    ----------
    engine, name : str
    dt : float
        [s]
    rate : float
        Steps a second of processor time [1/s].
    violation, error : float
        The largest gap [m], and how far the ends are from the true motion [m, rad].
    """

    engine: str
    name: str
    dt: float
    rate: float
    violation: float
    error: float


def turns(calls: dict[str, Callable[[], Any]], rounds: int) -> dict[str, float]:
    """Return the median processor time of each call, in turns [s]."""
    for call in calls.values():
        call()
    times: dict[str, list[float]] = {name: [] for name in calls}
    for i in range(rounds):
        names = list(calls)
        for name in names[i % len(names) :] + names[: i % len(names)]:
            begun = processor_time()
            calls[name]()
            times[name].append(processor_time() - begun)
    return {name: float(np.median(each)) for name, each in times.items()}


def bare_calls(scene: cp.Scene, states: tuple[np.ndarray, ...], *, slopes: bool) -> None:
    """Call what Pinocchio has for the states, one after the other."""
    workspace = cp.dynamics.verbs.workspace_for(scene, None, None)
    workspace.acceleration(*(x[0] for x in states))
    model, data, settings = workspace.model, workspace.data, workspace.proximal_settings
    models, datas = workspace.constraint_models, workspace.constraint_datas
    for state in zip(*states, strict=True):
        pin.constraintDynamics(model, data, *state, models, datas, settings)
        if slopes:
            pin.computeConstraintDynamicsDerivatives(model, data, models, datas, settings)


def one_by_one(workspace: cp.Workspace, states: tuple[np.ndarray, ...], *, slopes: bool) -> None:
    """Ask a workspace for the states, one after the other."""
    for state in zip(*states, strict=True):
        if slopes:
            found = workspace.derivatives(*state)
            _ = found.da_dq, found.da_dv, found.da_dtau
        else:
            workspace.solve(*state)


def again_and_again(
    scene: cp.Scene, states: tuple[np.ndarray, ...], *, slopes: bool
) -> tuple[np.ndarray, ...]:
    """Return the states so many times that Pinocchio's calls take `LEAST` for all of them."""
    bare_calls(scene, states, slopes=slopes)
    begun = processor_time()
    bare_calls(scene, states, slopes=slopes)
    times = max(1, round(LEAST / (processor_time() - begun)))
    return tuple(np.tile(x, (times, 1)) for x in states)


def verbs(label: str, scene: cp.Scene, count: int, rounds: int) -> list[Verb]:
    """Measure both verbs on closed, moving states under motor torques."""
    rng = np.random.default_rng(0)
    some = [(*scene.sample(rng), motor_torque(scene.robot, rng)) for _ in range(count)]
    states = tuple(np.array(x) for x in zip(*some, strict=True))
    found, core = [], cp.Workspace(scene, native=True)
    for verb, call, names in (
        ("solve", cp.solve_batch, ("a", "lam")),
        ("derivatives", cp.simulation.derivatives_batch, BLOCKS),
    ):
        few = tuple(x[: count if verb == "solve" else count // 4] for x in states)
        many = again_and_again(scene, few, slopes=verb == "derivatives")
        run, long_run = partial(call, scene, *few), partial(call, scene, *many)
        times = turns(
            {
                "bare": partial(bare_calls, scene, many, slopes=verb == "derivatives"),
                "python": run,
                "core": partial(long_run, executor=cp.Native(threads=1)),
                "two": partial(long_run, executor=cp.Native(threads=2)),
                "one": partial(one_by_one, core, many, slopes=verb == "derivatives"),
            },
            rounds,
        )
        one, two = run(), run(executor=cp.Native(threads=1))
        error = max(
            float(np.abs(getattr(one, x) - getattr(two, x)).max(initial=0.0))
            / max(1.0, float(np.abs(getattr(one, x)).max(initial=0.0)))
            for x in names
        )
        taken = {name: len((few if name == "python" else many)[0]) for name in times}
        per = {name: 1e6 * time / taken[name] for name, time in times.items()}
        found.append(
            Verb(label, verb, **per, error=error, left=left(scene, few), states=len(few[0]))
        )
    return found


def left(scene: cp.Scene, states: tuple[np.ndarray, ...]) -> int:
    """Return how many states the core leaves to Python."""
    core, count, nv = cp.Workspace(scene).compiled, len(states[0]), scene.robot.nv
    outputs = {
        "a": np.zeros((count, nv)), "lam": np.zeros((count, scene.rows)),
        "residuals": np.zeros((count, 5)), "statuses": np.zeros(count, np.int8),
        "iterations": np.zeros(count, np.int32), "solve_times": np.zeros(count),
    }  # fmt: skip
    return len(core.solve(states, outputs, accuracy=None, threads=1))  # type: ignore[arg-type]


def motions(count: int, rounds: int) -> list[Steps]:
    """Measure motions of Cassie: Python, the core, and MuJoCo where it is installed."""
    batch_motions.MOTIONS = count
    cassie = cp.load_robot("cassie")
    scene = cp.Scene(cassie, cassie.loops)
    true = batch_motions.judge_ours(
        scene, cp.RungeKutta4(), cp.simulation.PostStabilization(), batch_motions.FINE[0]
    )[1]
    calls: dict[str, Callable[[], Any]] = {}
    about: dict[str, tuple[str, str, float, Callable[[], Any]]] = {}
    middle = cp.simulation.LinearlyImplicitMidpoint()
    for integrator, gain, dt in (
        (cp.SemiImplicitEuler(), 0.3, 1e-3), (middle, 0.1, 1e-3), (middle, 0.1, 5e-3),
    ):  # fmt: skip
        for drift in (cp.Baumgarte.critical(gain / dt), cp.simulation.PostStabilization()):
            judge = partial(batch_motions.judge_ours, scene, integrator, drift, dt)
            for engine, executor in (("Python", None), ("core", cp.Native(threads=1))):
                name = f"{integrator.title}, {drift.title}"
                key = f"{engine} {name} {dt}"
                calls[key] = partial(batch_motions.ours, scene, integrator, drift, dt, executor)
                about[key] = engine, name, dt, judge
    if importlib.util.find_spec("mujoco"):
        for integrator, setting, dt in (
            ("Euler", "solref .002, solimp .9999", 1e-3), ("Euler", "default", 2e-3),
        ):  # fmt: skip
            key = f"mujoco {integrator} {setting} {dt}"
            calls[key] = partial(batch_motions.theirs, scene, setting, integrator, dt, 1)
            judge = partial(batch_motions.judge_theirs, scene, setting, integrator, dt)
            about[key] = "mujoco.rollout", f"{integrator}, {setting}", dt, judge
    times = turns(calls, rounds)
    found = []
    for key, (engine, name, dt, judge) in about.items():
        gap, ends = judge()
        rate = count * batch_motions.DURATION / dt / times[key]
        error = batch_motions.apart(scene, ends, true)
        found.append(Steps(engine, name, dt, rate, gap, error))
    return found


def memory() -> float:
    """Return what a thread of the core takes on Cassie [MB]."""
    cassie = cp.load_robot("cassie")
    scene = cp.Scene(cassie, cassie.loops)
    q, v = (np.tile(x, (64, 1)) for x in scene.state())
    cp.simulate_batch(scene, q, v, duration=1e-3, executor=cp.Native(threads=1))
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    cp.simulate_batch(scene, q, v, duration=1e-3, executor=cp.Native(threads=33))
    return (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 32 / 1024


def measure(count: int, moved: int, rounds: int) -> dict[str, Any]:
    """Return everything."""
    taken = memory()  # first: it looks at the most that was ever taken
    rows = [
        asdict(row)
        for name in ROBOTS
        for label, scene in standard_scenes(cp.load_robot(name)).items()
        if scene.rows
        for row in verbs(label, scene, count, rounds)
    ]
    return {
        "verbs": rows,
        "motions": [asdict(row) for row in motions(moved, rounds)],
        "memory": taken,
        "core": {"headers": compiled().pinocchio, "simd": compiled().simd},
    }


def verbs_table(saved: dict[str, Any]) -> str:
    """Return what a state takes."""
    lines = [
        "| scene | verb | Pinocchio's calls [us] | Python [us] | core [us] | x Python | x calls | "
        "2 threads, work | one by one [us] | x calls | difference | left |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    lines += [
        f"| {row.scene} | {row.verb} | {row.bare:.1f} | {row.python:.1f} | {row.core:.1f} | "
        f"{row.python / row.core:.1f} | {row.core / row.bare:.2f} | {row.two / row.core:.2f} | "
        f"{row.one:.1f} | {row.one / row.bare:.2f} | {row.error:.0e} | {row.left} of {row.states} |"
        for row in (Verb(**each) for each in saved["verbs"])
    ]
    return "\n".join([*lines, "", where(saved)])


def motions_table(saved: dict[str, Any]) -> str:
    """Return what a step takes."""
    rows = [Steps(**each) for each in saved["motions"]]
    python = {(row.name, row.dt): row.rate for row in rows if row.engine == "Python"}
    base = next((row.rate for row in rows if "mujoco" in row.engine), None)
    lines = [
        "| Cassie on its loops | dt [ms] | steps a second a core | x Python | x mujoco, Euler 1 ms "
        "| simulated [s/s] | gap [m] | error [m, rad] |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        ours = python.get((row.name, row.dt))
        times = f"{row.rate / ours:.2f}" if ours else ""
        beside = f"{row.rate / base:.2f}" if base else ""
        lines.append(
            f"| {row.engine}, {row.name} | {1e3 * row.dt:g} | {row.rate:.0f} | {times} | {beside} "
            f"| {row.rate * row.dt:.1f} | {row.violation:.0e} | {row.error:.0e} |"
        )
    return "\n".join([*lines, "", f"A thread takes {saved['memory']:.1f} MB.", where(saved)])


def where(saved: dict[str, Any], name: str = "native_core") -> str:
    """Return on what it was measured, by the script of that name."""
    about = (
        "`python benchmarks/{script}.py` on {processor} ({cores} cores), {system}, Python "
        "{python}, Pinocchio {pinocchio}, {date}; headers {headers}, {simd}; load {load:.1f} when "
        "it began."
    )
    return about.format(script=name, **saved["machine"], **saved["core"], load=saved["load"])


def pages(saved: dict[str, Any]) -> dict[str, dict[str, str]]:
    """Return the blocks of the page."""
    blocks = {"core-verbs": verbs_table(saved), "core-motions": motions_table(saved)}
    return {PAGE: blocks}


def main(words: Sequence[str] | None = None) -> None:
    """Run, write, and update the docs."""
    script.run(
        words, about=__doc__, quick="few states; nothing is written", path=JSON, rounds=7,
        measure=lambda given: measure(*((40, 2) if given.quick else (400, 8)), given.rounds),
        table=lambda saved: f"{verbs_table(saved)}\n\n{motions_table(saved)}", pages=pages,
    )  # fmt: skip


if __name__ == "__main__":
    main()
