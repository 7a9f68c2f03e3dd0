"""States a second of `solve_batch` in one process, in two, and how far two are ahead.

python benchmarks/batch.py            # 100 000 states a scene, a minute or two
python benchmarks/batch.py --quick    # 10 000

One and two processes take turns on the same states; the ratio is the median over the rounds. It
means nothing while anything else runs on the machine: the load is printed.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import argparse
from collections.abc import Callable
from concurrent.futures import Executor
from functools import partial
from typing import Any

import numpy as np

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


def row(call: Callable[..., Any], scene: cp.Scene, count: int, pool: Executor, rounds: int) -> str:
    """Return rates in this process and in two, their ratio, and the largest difference."""
    given = states(scene, count)
    call(scene, *given, executor=pool)  # warm-up: processes, imports, workspaces
    pairs = [(call(scene, *given), call(scene, *given, executor=pool)) for _ in range(rounds)]
    one, two = np.array([[each.seconds for each in pair] for pair in pairs]).T
    alone, both = (getattr(each, "solution", each) for each in pairs[-1])
    difference = np.abs(alone.a - both.a).max()
    return (
        f"{count} | {count / np.median(one):.0f} | {count / np.median(two):.0f} | "
        f"{np.median(one / two):.2f} | {difference:.0e} | {both.counts}"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--rounds", type=int, default=3)
    given = parser.parse_args()
    count = 10_000 if given.quick else 100_000
    talos, cassie = cp.load_robot("talos"), cp.load_robot("cassie")
    stance, loops = cp.Scene(talos, talos.contacts), cp.Scene(cassie, cassie.loops)
    solvers = [cp.Proximal(), *([cp.LCABA()] if HAS_LCABA else [])]
    title = "{processor}, {cores} cores, Python {python}, Pinocchio {pinocchio}, {date}"
    print(f"{title.format(**machine())}, load {os.getloadavg()[0]:.1f}\n")
    print(f"| batch | states | 1 process [1/s] | {WORKERS} [1/s] | x | difference | statuses |")
    print("|---|---|---|---|---|---|---|")
    with cp.Processes(WORKERS) as pool:
        for solver in solvers:
            solve = partial(cp.solve_batch, solver=solver)
            name = type(solver).__name__
            print(f"| talos, two feet, {name} | {row(solve, stance, count, pool, given.rounds)} |")
        print(
            f"| cassie, loops, Proximal | {row(cp.solve_batch, loops, count, pool, given.rounds)} |"
        )
        print(
            f"| talos, two feet, derivatives | "
            f"{row(cp.derivatives_batch, stance, count // 20, pool, given.rounds)} |"
        )


if __name__ == "__main__":
    main()
