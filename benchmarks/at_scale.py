"""A million states on a Dask cluster of this machine, whose workers use the compiled core.

    python benchmarks/at_scale.py [--quick]

Writes benchmarks/results/at_scale.json and docs/how-to-run-at-scale.md; with --from-json the table
is made from the committed results, without running anything.

Three ways to answer the same states: this process with one thread of the core, workers of Dask with
one thread each, and Python on a hundredth of them. Processor time is that of all processes, this
one among them, which splits the batch and puts it together again.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import resource
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import asdict, dataclass
from functools import partial
from time import perf_counter
from typing import Any

import marks
import numpy as np
import script
from processor_time import processor_time

import condyn_pin as cp
from condyn_pin.dynamics.scene import motor_torque

JSON = marks.ROOT / "benchmarks" / "results" / "at_scale.json"
PAGE = "docs/how-to-run-at-scale.md"
DIFFERENT = 1000  # more states would take longer to sample than to solve: they repeat
WORKERS = 2


@dataclass(frozen=True)
class Way:
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


def states(scene: cp.Scene, count: int) -> tuple[np.ndarray, ...]:
    """Return closed, moving states, no two the same: Dask answers equal ones once."""
    rng = np.random.default_rng(0)
    some = [(*scene.sample(rng), motor_torque(scene.robot, rng)) for _ in range(DIFFERENT)]
    q, v, tau = (
        np.resize(np.array(each), (count, len(each[0]))) for each in zip(*some, strict=True)
    )
    return q, v * rng.uniform(0.1, 1.0, (count, 1)), tau


def answered(call: Callable[..., Any], pids: Sequence[int]) -> tuple[Any, float, float]:
    """Return what a call returns, its wall time and its processor time [s]."""
    begun, worked = perf_counter(), processor_time(pids)
    found = call()
    return found, perf_counter() - begun, processor_time(pids) - worked


def measure(count: int) -> dict[str, Any]:
    """Return all ways, and what a state moves and takes."""
    from dask.distributed import Client, LocalCluster

    solo = cp.load_robot("solo12")
    scene = cp.Scene(solo, solo.contacts)
    given = states(scene, count)
    few = tuple(each[: count // 100] for each in given)
    with (
        LocalCluster(
            n_workers=WORKERS, threads_per_worker=1, dashboard_address=None, memory_limit=0
        ) as cluster,
        Client(cluster) as client,
    ):
        pids = list(client.run(os.getpid).values())
        dask: Executor = client.get_executor()
        ways = {
            "this process, one thread of the core": (given, cp.Native(threads=1)),
            f"{WORKERS} workers of Dask, a thread of the core each": (
                given, cp.Native(threads=1, executor=dask),
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
            rows.append(Way(name, len(found.a), seconds, work, ok, float(difference)))
            del found
        taken = {pid: kilobytes / 1024 for pid, kilobytes in client.run(_peak).items()}
    sent = 8 * (solo.nq + 2 * solo.nv)
    back = 8 * (solo.nv + scene.rows + 5 + 1) + 5
    return {
        "ways": [asdict(row) for row in rows],
        "sent": sent,
        "back": back,
        "worker": max(taken.values()),
        "here": _peak() / 1024,
    }


def _peak() -> float:
    """Return the most memory that this process has had [kB]."""
    return float(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)


def table(saved: dict[str, Any]) -> str:
    """Return the ways, what a state moves, and what a thousand times as many would take."""
    rows = [Way(**each) for each in saved["ways"]]
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
        _where(saved),
    ]
    return "\n".join(lines)


def _cores(way: Way, moved: int) -> float:
    """Return how many cores a network of 1 GB/s keeps at work."""
    return 1e9 / moved * way.work / way.states


def _where(saved: dict[str, Any]) -> str:
    about = (
        "`nice -n 5 python benchmarks/at_scale.py` on {processor} ({cores} cores), {system}, "
        "Python {python}, Pinocchio {pinocchio}, {date}; load {load:.1f} when it began: wall times "
        "are those of a busy machine."
    )
    return about.format(**saved["machine"], load=saved["load"])


def pages(saved: dict[str, Any]) -> dict[str, dict[str, str]]:
    """Return the block of the page."""
    return {PAGE: {"million": table(saved)}}


def main(words: Sequence[str] | None = None) -> None:
    """Run, write, and update the docs."""
    script.run(
        words, about=__doc__, quick="20 000 states; nothing is written", path=JSON,
        measure=lambda given: measure(20_000 if given.quick else 1_000_000),
        table=table, pages=pages,
    )  # fmt: skip


if __name__ == "__main__":
    main()
