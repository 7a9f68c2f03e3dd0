"""States a second of `solve_batch` in one process, in two, and how far two are ahead.

python benchmarks/batch.py            # 100 000 states a scene, a few minutes
python benchmarks/batch.py --quick    # 5 000
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import argparse

import numpy as np

import condyn_pin as cp
from condyn_pin._pin import HAS_LCABA
from condyn_pin.catalogue import motor_torque
from condyn_pin.machine import machine

DIFFERENT = 1000  # states; more would only repeat what takes longer to sample than to solve


def states(scene: cp.Scene, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return closed, moving states under motor torques; beyond 1000 they repeat."""
    rng = np.random.default_rng(0)
    some = [(*scene.sample(rng), motor_torque(scene.robot, rng)) for _ in range(DIFFERENT)]
    again = -(-count // DIFFERENT)
    q, v, tau = (np.tile(np.array(each), (again, 1))[:count] for each in zip(*some, strict=True))
    return q, v, tau


def compare(label: str, verb, scene, count, executor, solver, rounds: int) -> None:
    """Print one row: rates in this process and in two, from interleaved runs."""
    q, v, tau = states(scene, count)
    verb(scene, q[:2000], v[:2000], tau[:2000], solver=solver)  # warm-up: imports, workspaces
    verb(scene, q[:2000], v[:2000], tau[:2000], solver=solver, executor=executor)
    one, two, ratios = [], [], []
    for _ in range(rounds):
        alone = verb(scene, q, v, tau, solver=solver)
        both = verb(scene, q, v, tau, solver=solver, executor=executor)
        one.append(count / alone.seconds)
        two.append(count / both.seconds)
        ratios.append(alone.seconds / both.seconds)
    same = (
        np.array_equal(getattr(alone, "a", alone), getattr(both, "a", both))
        if hasattr(alone, "a")
        else np.array_equal(alone.da_dq, both.da_dq)
    )
    counts = (both if hasattr(both, "counts") else both.solution).counts
    print(
        f"| {label} | {type(solver).__name__} | {count} | {np.median(one):.0f} "
        f"| {np.median(two):.0f} | {np.median(ratios):.2f} | {'yes' if same else 'NO'} | {counts} |"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--rounds", type=int, default=3)
    given = parser.parse_args()
    count = 5_000 if given.quick else 100_000
    talos, cassie = cp.load_robot("talos"), cp.load_robot("cassie")
    stance, loops = cp.Scene(talos, talos.contacts), cp.Scene(cassie, cassie.loops)
    print(
        "{processor}, {cores} cores, Python {python}, Pinocchio {pinocchio}, {date}".format(
            **machine()
        )
    )
    print("| scene | solver | states | one process [1/s] | two [1/s] | x | same bits | statuses |")
    print("|---|---|---|---|---|---|---|---|")
    with cp.Processes(2) as executor:
        for solver in (cp.Proximal(), cp.LCABA()) if HAS_LCABA else (cp.Proximal(),):
            compare(
                "talos, two feet", cp.solve_batch, stance, count, executor, solver, given.rounds
            )
        compare(
            "cassie, loops", cp.solve_batch, loops, count, executor, cp.Proximal(), given.rounds
        )
        compare(
            "talos, derivatives",
            cp.derivatives_batch,
            stance,
            count // 20,
            executor,
            cp.Proximal(),
            given.rounds,
        )


if __name__ == "__main__":
    main()
