"""How far `Scene.assemble` reaches, and what it costs.

python benchmarks/assembly.py

From a closed posture, every joint moved by a normally distributed 0.2 rad or m: how many of 100
such starts end closed on the branch of the posture, and the processor time of one.
"""

from __future__ import annotations

import os
import statistics
from collections import Counter
from time import process_time

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

import condyn_pin as cp
from condyn_pin._core._pin import pin
from condyn_pin._core.timing import machine

SPREAD = 0.2  # [rad, m]


def main() -> None:
    """Print a line for every robot with loops."""
    print("{processor}, Python {python}, Pinocchio {pinocchio}, {date}".format(**machine()))
    for load in cp.io.available_robots().values():
        robot = load()
        if not robot.loops:
            continue
        scene = cp.Scene(robot, robot.loops)
        home = scene.assemble(scene.state()[0]).branch
        rng = np.random.default_rng(0)
        times, statuses = [], Counter[str]()
        for _ in range(100):
            start = pin.integrate(robot.model, scene.nominal.q, SPREAD * rng.normal(size=robot.nv))
            before = process_time()
            assembly = scene.assemble(start, branch=home, throw=False)
            times.append(1e3 * (process_time() - before))
            statuses[assembly.status.name.lower()] += 1
        counts = ", ".join(f"{count} {name}" for name, count in statuses.most_common())
        print(
            f"{robot.name:14} median {statistics.median(times):5.1f} ms, "
            f"longest {max(times):6.1f} ms; {counts}"
        )


if __name__ == "__main__":
    main()
