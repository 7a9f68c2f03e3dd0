"""What comes before the first solve: import, loading, scenes, workspaces.

python benchmarks/startup.py
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
from collections.abc import Callable
from time import perf_counter

os.environ.setdefault("OMP_NUM_THREADS", "1")

import condyn_pin as cp
from condyn_pin._core.machine import machine
from condyn_pin.dynamics.catalogue import standard_scenes

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
            audited = median_time(lambda s=scene: cp.Scene(s.robot, s.constraints).audit, 7)
            print(f"  Scene, with its audit              {1e3 * audited:8.1f} ms")
            for solver in (cp.Proximal(), cp.LCABA(), cp.DenseKKT()):
                try:
                    built = median_time(lambda s=scene, m=solver: cp.Workspace(s, m))
                except cp.UnsupportedBackend:
                    continue
                print(f"  Workspace, {type(solver).__name__:24}{1e3 * built:8.2f} ms")


if __name__ == "__main__":
    main()
