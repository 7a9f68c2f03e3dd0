"""States and steps a second of batches: in one process and two, beside `mujoco.rollout`, on Dask.

    python benchmarks/batch.py processes [--quick] [--rounds 5]
    nice -n 5 python benchmarks/batch.py cluster [--quick]

processes: one and two take turns on the same 100 000 closed, moving states; the ratio is the median
over the rounds. It means nothing while anything else runs on the machine: the load is kept. Work is
the processor time of all processes over that of one alone: 1.00 would be twice as fast on two free
cores. Then motions of Cassie by `simulate_batch`, and by `mujoco.rollout` on the same file
(`Robot.to_mjcf`) from the same states where MuJoCo is installed. The speed alone says nothing: a
larger step is faster and worse. So each row has the largest gap of its loops over all steps, and
how far from the true motion it ends: the one of Runge-Kutta 4 with a quarter of a millisecond,
whose own error is its difference to that with half a millisecond.

cluster: a million states on a Dask cluster of this machine, whose workers use the compiled core.
Three ways to answer the same states: this process with one thread of the core, workers with one
thread each, and Python on a hundredth of them. Processor time is that of all processes, this one
among them, which splits the batch and puts it together again.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import importlib.util
import resource
import sys
from argparse import ArgumentParser, Namespace
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import asdict, dataclass
from functools import partial
from itertools import product
from math import inf
from time import perf_counter
from typing import Any

import numpy as np
import script
from script import Table, processor_time

import condyn_pin as cp
from condyn_pin._core._pin import HAS_LCABA, pin
from condyn_pin.dynamics.scene import motor_torque

WORKERS = 2

# --- answers

DIFFERENT = 1000  # more states would take longer to sample than to solve: they repeat


@dataclass(frozen=True)
class Answers:
    """A verb over many states.

    Attributes
    ----------
    name : str
    states : int
    one, two : float
        States a second in this process, and in two others [1/s].
    ratio : float
        Median of two over one, round by round.
    work : float
        Processor time of two processes over that of one.
    difference : float
        Largest between the accelerations of both.
    counts : dict of str to int
        Statuses.
    """

    name: str
    states: int
    one: float
    two: float
    ratio: float
    work: float
    difference: float
    counts: dict[str, int]


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


def answers(
    name: str,
    call: Callable[..., Any],
    scene: cp.Scene,
    count: int,
    pool: cp.Processes,
    rounds: int,
) -> Answers:
    """Measure a verb."""
    given = states(scene, count)
    call(scene, *given, executor=pool)  # warm-up: processes, imports, workspaces
    times = []
    for _ in range(rounds):
        # the answers of a round are freed before the next: memory that was used before is quicker
        (alone, here), (both, there) = (
            worked(partial(call, scene, *given, executor=each), pool) for each in (None, pool)
        )
        times.append((alone.seconds, both.seconds, here, there))
        a, other = (getattr(found, "solution", found) for found in (alone, both))
        difference, counts = float(np.abs(a.a - other.a).max()), dict(other.counts)
        del alone, both, a, other
    one, two, here, there = np.array(times).T
    return Answers(
        name, count, count / np.median(one), count / np.median(two), float(np.median(one / two)),
        there.min() / here.min(), difference, counts,
    )  # fmt: skip


def compiled(call: Callable[..., Any], *given: Any, executor: Any) -> Any:
    """Call a verb with the compiled core: one thread for this process, two for two others."""
    return call(*given, executor=cp.Native(threads=1 if executor is None else WORKERS))


def pairs(saved: script.Saved) -> list[tuple[Motions, Motions | None]]:
    """Return each way of `mujoco.rollout`, with the fastest of ours that is as good."""
    rows = [Motions(**row) for row in saved["motions"]]
    return [(row, answer(rows, row)) for row in rows if row.engine != "condyn_pin"]


def essence(saved: script.Saved) -> str:
    """Return in two sentences what the tables say."""
    of_python = [row for row in saved["answers"] if "compiled" not in row["name"]]
    rows = [Answers(**row) for row in of_python if "derivatives" not in row["name"]]
    ratios, states = [row.ratio for row in rows], rows[0].states
    times = [mine.simulated / row.simulated if mine else 0.0 for row, mine in pairs(saved)]
    slopes = next(row["ratio"] for row in of_python if "derivatives" in row["name"])
    return (
        f"Two processes on two cores solve {states} states {min(ratios):.2f} to {max(ratios):.2f} "
        f"times as fast as one (derivatives: {slopes:.2f}).\n"
        f"Compared with {len(times)} settings of "
        "`mujoco.rollout` on Cassie, at no larger gap and no larger error, `simulate_batch`\n"
        f"simulates {min(times):.1f} to {max(times):.1f} times as much time per second "
        "(`python benchmarks/batch.py processes`)."
    )


def processes_table(saved: script.Saved) -> str:
    """Return what the tables say, and the tables."""
    where = (
        f"{script.source('batch processes', saved['machine'], script.OF_CORES)}; load "
        f"{saved['load']:.1f} when it began. The reference motion is accurate to "
        f"{saved['error']:.0e}."
    )
    return "\n".join(
        [
            essence(saved), "", *answers_table(saved), "", *motions_table(saved), "",
            *pairs_table(saved), "", where,
        ]
    )  # fmt: skip


def answers_table(saved: script.Saved) -> list[str]:
    """Return what one process and two make of the same states."""
    lines = [
        f"| batch | states | 1 process [1/s] | {WORKERS} [1/s] | x | work | difference | statuses "
        "|",
        "|---|---|---|---|---|---|---|---|",
    ]
    for row in (Answers(**each) for each in saved["answers"]):
        counts = ", ".join(f"{number} {name}" for name, number in row.counts.items())
        lines.append(
            f"| {row.name} | {row.states} | {row.one:.0f} | {row.two:.0f} | {row.ratio:.2f} | "
            f"{row.work:.2f} | {row.difference:.0e} | {counts} |"
        )
    return lines


def motions_table(saved: script.Saved) -> list[str]:
    """Return all ways to simulate, the fastest first."""
    rows = sorted((Motions(**row) for row in saved["motions"]), key=lambda row: -row.simulated)
    return [
        f"| {MOTIONS} motions of cassie, {DURATION:g} s | dt [ms] | steps: 1 core [1/s] | "
        f"{WORKERS} cores [1/s] | simulated [s/s] | gap [m] | error [m, rad] |",
        "|---|---|---|---|---|---|---|",
        *(
            f"| {row.engine}, {row.name} | {1e3 * row.dt:g} | {row.one:.0f} | {row.two:.0f} | "
            f"{row.simulated:.1f} | {row.violation:.0e} | {row.error:.0e} |"
            for row in rows
        ),
    ]


def pairs_table(saved: script.Saved) -> list[str]:
    """Return what is as good as each way of MuJoCo, and how much faster."""
    lines = [
        "| mujoco.rollout | dt [ms] | as good, the fastest of condyn_pin | dt [ms] | x |",
        "|---|---|---|---|---|",
    ]
    for row, mine in pairs(saved):
        found = f"{mine.name} | {1e3 * mine.dt:g}" if mine else "none | "
        times = mine.simulated / row.simulated if mine else 0.0
        lines.append(f"| {row.name} | {1e3 * row.dt:g} | {found} | {times:.2f} |")
    return lines


# --- motions


MOTIONS, DURATION = 32, 1.0  # [s]
JUDGED = slice(None, None, 8)  # the motions that gaps and errors are taken from
FINE = (2.5e-4, 5e-4)  # [s]


@dataclass(frozen=True)
class Motions:
    """One way to simulate many motions of Cassie.

    Attributes
    ----------
    engine : str
    name : str
    dt : float
        [s]
    one, two : float
        Steps a second on one core, and on two [1/s].
    violation : float
        The largest [m].
    error : float
        The largest of the configuration at the end [m, rad].
    """

    engine: str
    name: str
    dt: float
    one: float
    two: float
    violation: float
    error: float

    @property
    def simulated(self) -> float:
        """Simulated seconds a second on two cores."""
        return self.two * self.dt


@dataclass(frozen=True)
class Way:
    """A way to simulate.

    Attributes
    ----------
    engine, name : str
    dt : float
        [s]
    one, two : callable
        () -> steps a second, on one core and on two [1/s].
    judge : callable
        () -> the largest gap [m], and where the judged motions end (k, nq).
    """

    engine: str
    name: str
    dt: float
    one: Callable[[], float]
    two: Callable[[], float]
    judge: Callable[[], tuple[float, np.ndarray]]


def moving(scene: cp.Scene) -> tuple[np.ndarray, np.ndarray]:
    """Return starts at the first posture, moving along the loops."""
    rng, (q, v) = np.random.default_rng(0), scene.state()
    some = [
        cp.mechanism.project_velocity(scene, q, 0.3 * rng.normal(size=len(v)))
        for _ in range(MOTIONS)
    ]
    return np.tile(q, (MOTIONS, 1)), np.array(some)


def ours(scene: cp.Scene, integrator: Any, drift: Any, dt: float, pool: Any) -> float:
    """Return steps a second of `simulate_batch`."""
    found = cp.simulate_batch(
        scene, *moving(scene), duration=DURATION, dt=dt, integrator=integrator, drift=drift,
        executor=pool,
    )  # fmt: skip
    assert found.ok, found.counts
    return MOTIONS * found.steps / found.seconds


def judge_ours(scene: cp.Scene, integrator: Any, drift: Any, dt: float) -> tuple[float, np.ndarray]:
    """Return the largest gap and the ends, every step looked at."""
    found = cp.simulate_batch(
        scene, *(each[JUDGED] for each in moving(scene)), duration=DURATION, dt=dt,
        integrator=integrator, drift=drift, record=1,
    )  # fmt: skip
    assert found.ok, found.counts
    return float(found.violation.max()), found.q


def rolled_out(
    scene: cp.Scene, setting: str, integrator: str, dt: float, threads: int
) -> tuple[Any, np.ndarray, float]:
    """Return MuJoCo's robot, its states (MOTIONS, steps, n), and what they took [s]."""
    import mujoco
    from mujoco.rollout import Rollout
    from simulation_vs_mujoco import Twin

    twin = Twin.of(scene.robot, setting, integrator, dt, conservative=False)
    starts = []
    for q, v in zip(*moving(scene), strict=True):
        twin.set(q, v)
        starts.append(twin.physics())
    datas = [mujoco.MjData(twin.model) for _ in range(threads)]
    with Rollout(nthread=threads if threads > 1 else 0) as rollout:
        begun = perf_counter()
        states, _ = rollout.rollout(twin.model, datas, np.array(starts), nstep=round(DURATION / dt))
        return twin, states, perf_counter() - begun


def theirs(scene: cp.Scene, setting: str, integrator: str, dt: float, threads: int) -> float:
    """Return steps a second of `mujoco.rollout`."""
    _, states, seconds = rolled_out(scene, setting, integrator, dt, threads)
    return states.shape[0] * states.shape[1] / seconds


def judge_theirs(
    scene: cp.Scene, setting: str, integrator: str, dt: float
) -> tuple[float, np.ndarray]:
    """Return the largest gap and the ends, every step looked at by Pinocchio."""
    import mujoco

    twin, states, _ = rolled_out(scene, setting, integrator, dt, 1)
    equations = cp.Workspace(scene).equations
    gap, ends = 0.0, []
    for motion in states[JUDGED]:
        for state in motion:
            mujoco.mj_setState(twin.model, twin.data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
            q, v = twin.state()
            gap = max(gap, equations.open_by(q, v)[0])
        ends.append(q)
    return gap, np.array(ends)


def workers(pool: Executor) -> list[tuple[str, Any, Any]]:
    """Return who does the work on one core and on two: Python, and the compiled core if built."""
    found: list[tuple[str, Any, Any]] = [("", None, pool)]
    if importlib.util.find_spec("condyn_pin_native"):
        found.append((", compiled", cp.Native(threads=1), cp.Native(threads=WORKERS)))
    return found


def ways(scene: cp.Scene, pool: Executor) -> list[Way]:
    """Return the ways to simulate: ours, and those of MuJoCo where it is installed."""
    found = []
    semi, middle = cp.SemiImplicitEuler(), cp.simulation.LinearlyImplicitMidpoint()
    for integrator, gain, steps in (
        (semi, 0.3, (1e-3, 2e-3, 4e-3, 8e-3)),
        (middle, 0.1, (5e-4, 1e-3, 2e-3, 5e-3, 6.25e-3)),
        (cp.simulation.ImplicitMidpoint(), 0.1, (4e-3,)),
    ):
        for dt, closed in product(steps, (False, True)):
            drift = (
                cp.simulation.PostStabilization() if closed else cp.Baumgarte.critical(gain / dt)
            )
            run = partial(ours, scene, integrator, drift, dt)
            judge = partial(judge_ours, scene, integrator, drift, dt)
            for by, one, two in workers(pool):
                name = f"{integrator.title}, {drift.title}{by}"
                found.append(
                    Way("condyn_pin", name, dt, partial(run, one), partial(run, two), judge)
                )
    if not importlib.util.find_spec("mujoco"):
        return found
    for integrator, setting, dt in (
        ("Euler", "default", 2e-3), ("Euler", "solref .005, solimp .9999", 2e-3),
        ("Euler", "default", 1e-3), ("Euler", "solref .002, solimp .9999", 1e-3),
        ("implicitfast", "solref .002, solimp .9999", 1e-3),
        ("Euler", "solref .0005, solimp .9999", 2.5e-4),
        ("Euler", "solref .0002, solimp .9999", 1e-4), ("RK4", "solref .005, solimp .9999", 1e-3),
    ):  # fmt: skip
        run = partial(theirs, scene, setting, integrator, dt)
        found.append(Way(
            "mujoco.rollout", f"{integrator}, {setting}", dt,
            partial(run, 1), partial(run, WORKERS),
            partial(judge_theirs, scene, setting, integrator, dt),
        ))  # fmt: skip
    return found


def apart(scene: cp.Scene, ends: np.ndarray, true: np.ndarray) -> float:
    """Return the largest difference of two configurations [m, rad]; of what is lost, infinity."""
    found = [
        np.abs(pin.difference(scene.robot.model, *pair)).max()
        for pair in zip(true, ends, strict=True)
    ]
    return float(np.max(found)) if np.isfinite(found).all() else inf


def motions(scene: cp.Scene, pool: Executor, rounds: int) -> tuple[list[Motions], float]:
    """Return every way, measured in turns, and the error of what they are judged by [m, rad]."""
    true, coarser = (
        judge_ours(scene, cp.RungeKutta4(), cp.simulation.PostStabilization(), dt)[1] for dt in FINE
    )
    tried = ways(scene, pool)
    judged = [way.judge() for way in tried]
    for way in tried:  # warm-up: processes, workspaces
        way.one(), way.two()
    rates = np.array([[(way.one(), way.two()) for way in tried] for _ in range(rounds)])
    rows = [
        Motions(way.engine, way.name, way.dt, float(one), float(two), gap, apart(scene, ends, true))
        for way, (one, two), (gap, ends) in zip(
            tried, np.median(rates, axis=0), judged, strict=True
        )
    ]
    return rows, apart(scene, coarser, true)


def answer(rows: list[Motions], theirs: Motions) -> Motions | None:
    """Return the fastest way of ours with no larger gap and no larger error."""
    as_good = [
        row
        for row in rows
        if row.engine == "condyn_pin"
        and row.violation <= theirs.violation
        and row.error <= theirs.error
    ]
    return max(as_good, key=lambda row: row.simulated, default=None)


# --- processes


def processes(given: Namespace) -> script.Saved:
    """Measure answers and motions."""
    about = script.measured_on()
    found, (moved, error) = measured(10_000 if given.quick else 100_000, given.rounds)
    rows = {"answers": [asdict(r) for r in found], "motions": [asdict(r) for r in moved]}
    return {**about, "error": error, **rows}


def measured(count: int, rounds: int) -> tuple[list[Answers], tuple[list[Motions], float]]:
    """Return all rows, and the error of what motions are judged by [m, rad]."""
    talos, cassie = cp.load_robot("talos"), cp.load_robot("cassie")
    stance, loops = cp.Scene(talos, talos.contacts), cp.Scene(cassie, cassie.loops)
    with cp.Processes(WORKERS) as pool:
        found = []
        for solver in (cp.Proximal(), *([cp.LCABA()] if HAS_LCABA else [])):
            solve, name = partial(cp.solve_batch, solver=solver), type(solver).__name__
            found.append(answers(f"talos, two feet, {name}", solve, stance, count, pool, rounds))
        found.append(answers("cassie, loops", cp.solve_batch, loops, count, pool, rounds))
        name, few = "talos, two feet, derivatives", count // 20
        slopes = cp.simulation.derivatives_batch
        found.append(answers(name, slopes, stance, few, pool, rounds))
        if importlib.util.find_spec("condyn_pin_native"):
            solve = partial(compiled, cp.solve_batch)
            found.append(answers("talos, two feet, compiled", solve, stance, count, pool, rounds))
            found.append(answers("cassie, loops, compiled", solve, loops, count, pool, rounds))
            name, slopes = f"{name}, compiled", partial(compiled, slopes)
            found.append(answers(name, slopes, stance, few, pool, rounds))
        return found, motions(loops, pool, min(rounds, 3))  # each takes a minute


# --- cluster


def different_states(scene: cp.Scene, count: int) -> tuple[np.ndarray, ...]:
    """Return closed, moving states, no two the same: Dask answers equal ones once."""
    q, v, tau = states(scene, count)
    return q, v * np.random.default_rng(1).uniform(0.1, 1.0, (count, 1)), tau


@dataclass(frozen=True)
class Cluster:
    """One way to answer the states.

    Attributes
    ----------
    name : str
    states : int
    seconds, work : float
        Wall time, and processor time of all processes [s].
    ok : int
        Answers that are proved.
    difference : float
        The largest between its accelerations and those of the first way, relative to the largest.
    """

    name: str
    states: int
    seconds: float
    work: float
    ok: int
    difference: float


def answered(call: Callable[..., Any], pids: Sequence[int]) -> tuple[Any, float, float]:
    """Return what a call returns, its wall time and its processor time [s]."""
    begun, worked = perf_counter(), processor_time(pids)
    found = call()
    return found, perf_counter() - begun, processor_time(pids) - worked


def cluster(given: Namespace) -> script.Saved:
    """Measure all ways, and what a state moves and takes."""
    from dask.distributed import Client, LocalCluster

    about, count = script.measured_on(), 20_000 if given.quick else 1_000_000
    solo = cp.load_robot("solo12")
    scene = cp.Scene(solo, solo.contacts)
    every = different_states(scene, count)
    few = tuple(each[: count // 100] for each in every)
    with (
        LocalCluster(
            n_workers=WORKERS, threads_per_worker=1, dashboard_address=None, memory_limit=0
        ) as workers_of,
        Client(workers_of) as client,
    ):
        pids = list(client.run(os.getpid).values())
        dask: Executor = client.get_executor()
        ways = {
            "this process, one thread of the core": (every, cp.Native(threads=1)),
            f"{WORKERS} workers of Dask, a thread of the core each": (
                every, cp.Native(threads=1, executor=dask),
            ),
            "this process, Python": (few, None),
        }  # fmt: skip
        rows, first = [], np.zeros(0)
        for name, (some, executor) in ways.items():
            solve = partial(cp.solve_batch, scene, executor=executor)
            solve(*(each[:2000] for each in some))  # workers import, and make their workspaces
            found, seconds, work = answered(partial(solve, *some), pids)
            first = first if first.size else found.a
            difference = np.abs(found.a - first[: len(found.a)]).max() / np.abs(first).max()
            ok = found.counts.get("ok", 0)
            rows.append(Cluster(name, len(found.a), seconds, work, ok, float(difference)))
            del found
        taken = {pid: kilobytes / 1024 for pid, kilobytes in client.run(_peak).items()}
    sent = 8 * (solo.nq + 2 * solo.nv)
    back = 8 * (solo.nv + scene.rows + 5 + 1) + 5
    return {
        **about,
        "ways": [asdict(row) for row in rows],
        "sent": sent,
        "back": back,
        "worker": max(taken.values()),
        "here": _peak() / 1024,
    }


def _peak() -> float:
    """Return the most memory that this process has had [kB]."""
    return float(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)


def cluster_table(saved: script.Saved) -> str:
    """Return the ways, what a state moves, and what a thousand times as many would take."""
    rows = [Cluster(**each) for each in saved["ways"]]
    lines = [
        "| Solo12 on four feet | states | wall [s] | processor time [s] | us of it a state | ok | "
        "difference |",
        "|---|---|---|---|---|---|---|",
    ]
    lines += [
        f"| {row.name} | {row.states} | {row.seconds:.1f} | {row.work:.1f} | "
        f"{1e6 * row.work / row.states:.1f} | {row.ok} | {row.difference:.0e} |"
        for row in rows
    ]
    core, dask = rows[:2]
    moved = saved["sent"] + saved["back"]
    hours = 1e9 * dask.work / dask.states / 3600
    spread = dask.work / core.work
    lines += [
        "",
        f"A state moves {saved['sent']} bytes to a worker and {saved['back']} back; a worker took "
        f"{saved['worker']:.0f} MB at most, this process {saved['here']:.0f} MB. Dask takes "
        f"{spread:.2f} times the processor time of one process: it copies each row, and this "
        "process splits the batch and puts it together.",
        "",
        f"**10^9 states** are {hours:.0f} hours of one core at that rate, "
        f"{60 * hours / 100:.0f} minutes of 100. They move {moved:.0f} GB, which no memory here "
        "holds: hand them over in calls of 10^6 or 10^7, and write what comes back. The limit is "
        "then this process, through which every row goes: a network of 1 GB/s carries "
        f"{1e9 / moved:.1e} states a second, what {_cores(dask, moved):.0f} cores answer. Beyond "
        "that, have each worker make its states itself, from a seed, and keep what it answers.",
        "",
        f"{script.source('batch cluster', saved['machine'], script.OF_CORES)}; load "
        f"{saved['load']:.1f} when it began: wall times are those of a busy machine.",
    ]
    return "\n".join(lines)


def _cores(way: Cluster, moved: int) -> float:
    """Return how many cores a network of 1 GB/s keeps at work."""
    return 1e9 / moved * way.work / way.states


def _rounds(parser: ArgumentParser) -> None:
    parser.add_argument("--rounds", type=int, default=5)


SUBJECTS = [
    Table(
        "batch processes",
        "one process and two, beside mujoco.rollout",
        processes,
        processes_table,
        pages=lambda saved: {script.RESULTS_PAGE: {"batch": processes_table(saved)}},
        quick="10 000 states; nothing is written",
        options=_rounds,
    ),
    Table(
        "batch cluster",
        "a million states on a Dask cluster",
        cluster,
        cluster_table,
        pages=lambda saved: {script.RESULTS_PAGE: {"million": cluster_table(saved)}},
        quick="20 000 states; nothing is written",
    ),
]


if __name__ == "__main__":
    sys.exit(script.main(__doc__, SUBJECTS))
