"""Time steps of a simulation: against one solve, against real time, and how well they go.

python benchmarks/simulation.py
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

from collections.abc import Callable

import numpy as np

import condyn_pin as cp
from condyn_pin._core.timing import interleaved, machine
from condyn_pin.simulation.plan import anchored, plan
from condyn_pin.simulation.run import HybridPhase

DT = 1e-3  # [s]


def main() -> None:
    """Print a table for Talos on two feet, and one for Cassie hanging by the pelvis."""
    print("{processor}, Python {python}, Pinocchio {pinocchio}, {date}".format(**machine()))
    talos, cassie = cp.load_robot("talos"), cp.load_robot("cassie")
    table(cp.Scene(talos, talos.contacts), duration=0.2)
    table(cp.Scene(cassie, [*cassie.loops, cp.SurfaceContact("pelvis")]), duration=1.0)


def table(scene: cp.Scene, *, duration: float) -> None:
    """Print what steps cost, and what a run leaves open."""
    q, v = scene.state()
    tau = np.zeros(scene.robot.nv)
    integrators = [kind() for kind in cp.simulation.INTEGRATORS.values()]
    workspace = cp.Workspace(anchored(scene, q))
    calls = {"a solve": workspace.acceleration}
    calls |= {i.title: steps(workspace.scene, q, v, i) for i in integrators}
    times = interleaved(calls, [(q, v, tau)], rounds=200, repeats=10)
    solve = times["a solve"]
    name = f"{scene.robot.name}, {scene.rows} rows"
    print(f"\n{name}, dt {1e3 * DT:g} ms; a solve {solve.median:.1f} us")
    print(
        f"{'':<28}{'us':>8}{'solves':>8}{'measured':>10}{'x real time':>13}{'gap':>10}"
        f"{'energy [J]':>12}"
    )
    for i in integrators:
        time = times[i.title]
        run = cp.simulate(scene, q, v, duration=duration, dt=DT, integrator=i)
        quality = f"{run.violation.max():>10.1e}{np.abs(run.energy.error).max():>12.1e}"
        print(
            f"{i.title:<28}{time.median:>8.1f}{i.solves_per_step:>8g}{time.ratio(solve):>10.2f}"
            f"{1e6 * DT / time.median:>13.1f}"
            f"{quality if run.status.ok else '  ' + run.status.name.lower()}"
        )


def steps(
    scene: cp.Scene, q: np.ndarray, v: np.ndarray, integrator: cp.simulation.Integrator
) -> Callable[..., object]:
    """Return a step as `simulate` takes it, its sample kept."""
    planned = plan(
        scene, 0.0, duration=DT, dt=DT, integrator=integrator, drift=None, solver=None, record=1
    )
    phase = HybridPhase(scene, planned)
    phase.begin(0.0, q, v)
    return lambda q, v, tau: phase.step(0.0, q, v, 0)


if __name__ == "__main__":
    main()
