"""States a second of `solve_batch` in one process, in two, and how far two are ahead.

Then steps a second of `simulate_batch`, and of `mujoco.rollout` on the same file (`Robot.to_mjcf`)
from the same states where MuJoCo is installed, with the largest gap of a loop in both.

python benchmarks/batch.py            # 100 000 states a scene, a minute or two
python benchmarks/batch.py --quick    # 10 000

One and two processes take turns on the same states; the ratio is the median over the rounds. It
means nothing while anything else runs on the machine: the load is printed. Work is the processor
time of all processes over that of one alone: 1.00 would be twice as fast on two free cores.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import argparse
import importlib.util
from collections.abc import Callable
from concurrent.futures import Executor
from functools import partial
from time import perf_counter
from typing import Any

import numpy as np
from processor_time import processor_time

import condyn_pin as cp
from condyn_pin._pin import HAS_LCABA
from condyn_pin.catalogue import motor_torque
from condyn_pin.machine import machine

DIFFERENT = 1000  # more states would take longer to sample than to solve: they repeat
WORKERS = 2


def states(scene: cp.Scene, count: int) -> tuple[np.ndarray, ...]:
    """Return closed, moving states under motor torques."""
    rng = np.random.default_rng(0)
    some = [(*scene.sample(rng), motor_torque(scene.robot, rng)) for _ in range(DIFFERENT)]
    return tuple(
        np.resize(np.array(each), (count, len(each[0]))) for each in zip(*some, strict=True)
    )


def worked(call: Callable[[], Any], pool: cp.Processes) -> tuple[Any, float]:
    """Return what a call returns, and the processor time that all processes took [s]."""
    start = processor_time(pool.pids)
    found = call()
    return found, processor_time(pool.pids) - start


def row(
    call: Callable[..., Any], scene: cp.Scene, count: int, pool: cp.Processes, rounds: int
) -> str:
    """Return rates in this process and in two, ratio, work, and the largest difference."""
    given = states(scene, count)
    call(scene, *given, executor=pool)  # warm-up: processes, imports, workspaces
    ways = partial(call, scene, *given), partial(call, scene, *given, executor=pool)
    figures, found = [], []
    for _ in range(rounds):
        found.clear()  # a gigabyte that is kept makes the next one of pages that nobody has used
        found += [worked(way, pool) for way in ways]
        figures.append([(each.seconds, work) for each, work in found])
    (one, here), (two, there) = np.array(figures).transpose(1, 2, 0)
    alone, both = (getattr(each, "solution", each) for each, _ in found)
    difference = np.abs(alone.a - both.a).max()
    return (
        f"{count} | {count / np.median(one):.0f} | {count / np.median(two):.0f} | "
        f"{np.median(one / two):.2f} | {there.min() / here.min():.2f} | {difference:.0e} | "
        f"{both.counts}"
    )


MOTIONS, STEPS, DT = 32, 200, 1e-3


def moving(scene: cp.Scene) -> tuple[np.ndarray, np.ndarray]:
    """Return starts at the first posture, moving along the loops."""
    rng, (q, v) = np.random.default_rng(0), scene.state()
    some = [scene.project_velocity(q, 0.3 * rng.normal(size=len(v))) for _ in range(MOTIONS)]
    return np.tile(q, (MOTIONS, 1)), np.array(some)


def ours(
    scene: cp.Scene, drift: Any, integrator: Any, pool: Executor | None
) -> tuple[float, float]:
    """Return steps a second and the largest gap [m]."""
    found = cp.simulate_batch(
        scene, *moving(scene), duration=STEPS * DT, dt=DT, integrator=integrator, drift=drift,
        executor=pool,
    )  # fmt: skip
    return MOTIONS * STEPS / found.seconds, float(np.max(found.violation))


def theirs(scene: cp.Scene, setting: str, integrator: str, threads: int) -> tuple[float, float]:
    """Return the same of `mujoco.rollout`."""
    import mujoco
    from mujoco.rollout import Rollout
    from mujoco_twin import Twin

    twin = Twin.of(scene.robot, setting, integrator, DT, conservative=False)
    starts = []
    for q, v in zip(*moving(scene), strict=True):
        twin.set(q, v)
        starts.append(twin.physics())
    datas = [mujoco.MjData(twin.model) for _ in range(threads)]
    with Rollout(nthread=threads if threads > 1 else 0) as rollout:
        begun = perf_counter()
        states, _ = rollout.rollout(twin.model, datas, np.array(starts), nstep=STEPS)
        seconds = perf_counter() - begun
    gaps, equations = [], cp.Workspace(scene).equations
    for motion in states[::8]:
        for state in motion[:: STEPS // 50]:
            mujoco.mj_setState(twin.model, twin.data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
            gaps.append(equations.open_by(*twin.state())[0])
    return MOTIONS * STEPS / seconds, max(gaps)


def motions(scene: cp.Scene, pool: Executor, rounds: int) -> None:
    """Print steps a second of both engines, alone and on two cores."""
    ways: dict[str, tuple[Callable[[], Any], Callable[[], Any]]] = {}
    semi, rk4 = cp.SemiImplicitEuler(), cp.RungeKutta4()
    for integrator, drift in (
        (semi, cp.Baumgarte.critical(0.3 / DT)), (semi, cp.PostStabilization()),
        (rk4, cp.PostStabilization()),
    ):  # fmt: skip
        name = f"condyn_pin {integrator.title}, {drift.title}"
        ways[name] = (
            partial(ours, scene, drift, integrator, None),
            partial(ours, scene, drift, integrator, pool),
        )
    if importlib.util.find_spec("mujoco"):
        for setting, integrator in (
            ("default", "Euler"), ("solref .002, solimp .9999", "Euler"),
            ("solref .005, solimp .9999", "RK4"),
        ):  # fmt: skip
            rates = [partial(theirs, scene, setting, integrator, k) for k in (1, WORKERS)]
            ways[f"mujoco.rollout {integrator}, {setting}"] = (rates[0], rates[1])
    for one, both in ways.values():  # warm-up: processes, workspaces
        one(), both()
    found = {name: [(one(), both()) for _ in range(rounds)] for name, (one, both) in ways.items()}
    for name, pairs in found.items():
        rates = np.array([[each[0] for each in pair] for pair in pairs])
        (one, two), gap = np.median(rates, axis=0), pairs[-1][1][1]
        print(
            f"| {scene.robot.name}, {name} | {one:.0f} | {two:.0f} | {two / one:.2f} | {gap:.0e} |"
        )


def solutions(
    stance: cp.Scene, loops: cp.Scene, pool: cp.Processes, count: int, rounds: int
) -> None:
    """Print states a second of the answers and of their derivatives."""
    print(
        f"| batch | states | 1 process [1/s] | {WORKERS} [1/s] | x | work | difference | statuses |"
    )
    print("|---|---|---|---|---|---|---|---|")
    for solver in (cp.Proximal(), *([cp.LCABA()] if HAS_LCABA else [])):
        solve = partial(cp.solve_batch, solver=solver)
        name = type(solver).__name__
        print(f"| talos, two feet, {name} | {row(solve, stance, count, pool, rounds)} |")
    print(f"| cassie, loops, Proximal | {row(cp.solve_batch, loops, count, pool, rounds)} |")
    few = count // 20
    print(
        f"| talos, two feet, derivatives | {row(cp.derivatives_batch, stance, few, pool, rounds)} |"
    )


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--motions", action="store_true", help="the second table only")
    parser.add_argument("--rounds", type=int, default=3)
    given = parser.parse_args()
    count = 10_000 if given.quick else 100_000
    talos, cassie = cp.load_robot("talos"), cp.load_robot("cassie")
    stance, loops = cp.Scene(talos, talos.contacts), cp.Scene(cassie, cassie.loops)
    title = "{processor}, {cores} cores, Python {python}, Pinocchio {pinocchio}, {date}"
    print(f"{title.format(**machine())}, load {os.getloadavg()[0]:.1f}\n")
    with cp.Processes(WORKERS) as pool:
        if not given.motions:
            solutions(stance, loops, pool, count, given.rounds)
        print(
            f"\n| {MOTIONS} motions of {STEPS} steps | 1 process [1/s] | {WORKERS} [1/s] | x | "
            "gap [m] |"
        )
        print("|---|---|---|---|---|")
        motions(loops, pool, given.rounds)


if __name__ == "__main__":
    main()
