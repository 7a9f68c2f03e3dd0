"""What comes before the first solve: import, loading, scenes, workspaces.

python benchmarks/startup.py
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from time import perf_counter

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

import condyn_pin as cp
from condyn_pin._core.timing import machine
from condyn_pin.dynamics.scene import standard_scenes

# What a first solve touches, all imported; scipy's LAPACK comes with the first scene.
EVERYTHING = "import condyn_pin as cp; cp.load_robot; cp.Scene; cp.Workspace; cp.solve"


def import_time(code: str) -> float:
    """Return the median time of a statement in fresh interpreters, after pinocchio [s]."""
    timed = f"""
import pinocchio, time
start = time.perf_counter()
{code}
print(time.perf_counter() - start)
"""
    runs = [
        subprocess.run([sys.executable, "-c", timed], capture_output=True, text=True, check=True)
        for _ in range(7)
    ]
    return statistics.median(float(run.stdout) for run in runs)


def median_time(call: Callable[[], object], repeats: int = 21) -> float:
    """Return the median time of a call [s]."""
    samples = []
    for _ in range(repeats):
        start = perf_counter()
        call()
        samples.append(perf_counter() - start)
    return statistics.median(samples)


def first_solve(scene: cp.Scene) -> tuple[float, float, float]:
    """Return the least times of Workspace(scene), of its first solve, and of a later one [s].

    The scene is new, its robot is not. The later solve is that of an older workspace, in turns; the
    least of them, since memory that is new gives other programs their turn.
    """
    still = np.zeros(scene.robot.nv)
    state, older = (cp.dynamics.described_posture(scene), still, still), cp.Workspace(scene)
    times = []
    for _ in range(21):
        new = cp.Scene(scene.robot, scene.constraints)
        start = perf_counter()
        workspace = cp.Workspace(new)
        built = perf_counter()
        workspace.solve(*state, throw=False)
        done = perf_counter()
        warm = median_time(partial(older.solve, *state, throw=False))
        times.append((built - start, done - built, warm))
    least = np.min(times, axis=0)
    return float(least[0]), float(least[1]), float(least[2])


def print_first_solves() -> None:
    """Print what a first solve costs, in solves; createData, twice in it, is Pinocchio's own."""
    print(
        f"{'first solve of a new scene':30}{'createData':>12}{'Workspace':>12}{'solve':>12}"
        f"{'warm':>12}{'first / warm':>14}"
    )
    for name in cp.io.available_robots():
        for label, scene in standard_scenes(cp.load_robot(name)).items():
            kept: list[object] = []  # memory that was used before is quicker to have
            made = median_time(lambda s=scene, k=kept: k.append(s.robot.model.createData()), 5)
            built, first, warm = first_solve(scene)
            milliseconds = (f"{1e3 * each:9.3f} ms" for each in (made, built, first, warm))
            print(f"  {label:28}{''.join(milliseconds)}{(built + first) / warm:14.0f}")


def main() -> None:
    """Print the table."""
    print("{processor}, Python {python}, Pinocchio {pinocchio}, {date}".format(**machine()))
    print(f"import condyn_pin, after pinocchio   {1e3 * import_time('import condyn_pin'):8.1f} ms")
    print(f"  with all that a solve needs        {1e3 * import_time(EVERYTHING):8.1f} ms")
    for name in ("talos", "cassie"):
        load = median_time(lambda name=name: cp.load_robot(name), 7)
        print(f"load_robot({name!r}){'':16}{1e3 * load:8.1f} ms".replace("'", '"'))
        for label, scene in standard_scenes(cp.load_robot(name)).items():
            print(label)
            analysed = median_time(lambda s=scene: cp.Scene(s.robot, s.constraints).nominal, 7)
            print(f"  Scene, with its nominal analysis   {1e3 * analysed:8.1f} ms")
            for solver in (cp.Proximal(), cp.LCABA(), cp.DenseKKT()):
                try:
                    built = median_time(lambda s=scene, m=solver: cp.Workspace(s, m))
                except cp.errors.UnsupportedBackend:
                    continue
                print(f"  Workspace, {type(solver).__name__:24}{1e3 * built:8.2f} ms")
    print_first_solves()


if __name__ == "__main__":
    main()
