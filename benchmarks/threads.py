"""What threads of the BLAS cost small matrices, with an idle neighbour and with a busy one.

python benchmarks/threads.py

The same calls with one thread, which is what the library takes by itself, and with one for each
core, which is what OMP_NUM_THREADS=<cores> asks for: in turns, each in a process of its own.
"""

from __future__ import annotations

import os
import subprocess
import sys
from statistics import median

TURNS = 3

WORK = """
import statistics, sys
from time import perf_counter
import numpy as np
import condyn_pin as cp

robot = cp.load_robot("cassie")
scene = cp.Scene(robot, robot.loops)
q, v = scene.state()
tau = np.zeros(robot.nv)
gauss = cp.Workspace(scene, cp.dynamics.GaussPrinciple())
calls = {
    "derivatives(...)": lambda: cp.derivatives(scene, q, v, tau),
    "Scene.rank": lambda: scene.rank(q),
    "GaussPrinciple, acceleration": lambda: gauss.acceleration(q, v, tau),
}
for name, call in calls.items():
    call()
    times = []
    for _ in range(100):
        start = perf_counter()
        call()
        times.append(perf_counter() - start)
    print(name, statistics.median(times), sep="|")
"""

SPIN = "while True: pass"


def times(**variables: str) -> dict[str, float]:
    """Return the median time of each call [s], in a fresh process."""
    environment = {n: x for n, x in os.environ.items() if not n.endswith("_NUM_THREADS")}
    line = [sys.executable, "-c", WORK]
    ran = subprocess.run(
        line, env=environment | variables, capture_output=True, text=True, check=True
    )
    return {name: float(time) for name, time in (x.split("|") for x in ran.stdout.splitlines())}


def main() -> None:
    """Print the table."""
    cores = os.cpu_count() or 1
    print(f"Cassie's loops, {cores} cores, medians [ms]: one thread | one for each core")
    for busy in (0, cores):
        neighbours = [subprocess.Popen([sys.executable, "-c", SPIN]) for _ in range(busy)]
        try:
            turns = [(times(), times(OMP_NUM_THREADS=str(cores))) for _ in range(TURNS)]
        finally:
            for each in neighbours:
                each.kill()
        print(f"{busy} busy neighbours")
        for name in turns[0][0]:
            one, all_ = (1e3 * median(turn[k][name] for turn in turns) for k in (0, 1))
            print(f"  {name:32}{one:8.3f} {all_:8.3f}")


if __name__ == "__main__":
    main()
