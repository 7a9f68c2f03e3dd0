"""States and steps a second of batches, in one process and in two; beside `mujoco.rollout`.

    python benchmarks/batch.py [--quick]

Writes benchmarks/results/batch.json and docs/results.md; with --from-json
the table is made from the committed results, without running anything.

Answers: one and two processes take turns on the same 100 000 closed, moving states; the ratio is
the median over the rounds. It means nothing while anything else runs on the machine: the load is
kept. Work is the processor time of all processes over that of one alone: 1.00 would be twice as
fast on two free cores.

Motions: `simulate_batch`, and `mujoco.rollout` on the same file (`Robot.to_mjcf`) from the same
states where MuJoCo is installed, each with its largest gap and its error (`batch_motions.py`).
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import argparse
import importlib.util
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

import marks
import numpy as np
import script
from batch_motions import DURATION, MOTIONS, WORKERS, Motions, answer, motions
from processor_time import processor_time

import condyn_pin as cp
from condyn_pin._core._pin import HAS_LCABA
from condyn_pin.dynamics.scene import motor_torque

DIFFERENT = 1000  # more states would take longer to sample than to solve: they repeat
JSON = marks.ROOT / "benchmarks" / "results" / "batch.json"


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


def measure(count: int, rounds: int) -> tuple[list[Answers], tuple[list[Motions], float]]:
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


def pairs(saved: dict[str, Any]) -> list[tuple[Motions, Motions | None]]:
    """Return each way of `mujoco.rollout`, with the fastest of ours that is as good."""
    rows = [Motions(**row) for row in saved["motions"]]
    return [(row, answer(rows, row)) for row in rows if row.engine != "condyn_pin"]


def essence(saved: dict[str, Any]) -> str:
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
        "(`python benchmarks/batch.py`)."
    )


def markdown(saved: dict[str, Any]) -> str:
    """Return what the tables say, and the tables."""
    where = (
        "`python benchmarks/batch.py` on {processor} ({cores} cores), {system}, Python {python}, "
        "Pinocchio {pinocchio}, {date}; load {load:.1f} when it began. The reference motion is "
        "accurate to {error:.0e}."
    )
    return "\n".join(
        [
            essence(saved), "", *answers_table(saved), "", *motions_table(saved), "",
            *pairs_table(saved), "",
            where.format(**saved["machine"], load=saved["load"], error=saved["error"]),
        ]
    )  # fmt: skip


def answers_table(saved: dict[str, Any]) -> list[str]:
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


def motions_table(saved: dict[str, Any]) -> list[str]:
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


def pairs_table(saved: dict[str, Any]) -> list[str]:
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


def pages(saved: dict[str, Any]) -> dict[str, dict[str, str]]:
    """Return the block of docs/results.md."""
    return {marks.RESULTS: {"batch": markdown(saved)}}


def _measured(given: argparse.Namespace) -> dict[str, Any]:
    found, (moved, error) = measure(10_000 if given.quick else 100_000, given.rounds)
    rows = {"answers": [asdict(r) for r in found], "motions": [asdict(r) for r in moved]}
    return {"error": error, **rows}


def main(words: Sequence[str] | None = None) -> None:
    """Run, write, and update the docs."""
    script.run(
        words, about=__doc__, quick="10 000 states, nothing is written", path=JSON, rounds=5,
        measure=_measured, table=markdown, pages=pages,
    )  # fmt: skip


if __name__ == "__main__":
    main()
