"""Time steps of a simulation: against one solve on Talos, and against real time on Cassie.

python benchmarks/simulation.py
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

import condyn_pin as cp
from condyn_pin.machine import machine
from condyn_pin.simulation.anchoring import anchored
from condyn_pin.simulation.defaults import default_drift
from condyn_pin.simulation.leg import Leg, Method
from condyn_pin.simulation.torques import Applied
from condyn_pin.timing import interleaved

DT = 1e-3  # [s]


def main() -> None:
    """Print ratios."""
    print("{processor}, Python {python}, Pinocchio {pinocchio}, {date}".format(**machine()))
    integrators = [kind() for kind in cp.INTEGRATORS.values()]
    of_a_step(integrators)
    of_real_time(integrators)


def of_a_step(integrators: list[cp.Integrator]) -> None:
    """Print what a step costs in solves: Talos on two feet, samples kept."""
    talos = cp.load_robot("talos")
    scene = cp.Scene(talos, talos.contacts)
    q, v = scene.state()
    tau = np.zeros(talos.nv)
    placed = anchored(scene, q)
    workspace = cp.Workspace(placed, drift=default_drift(placed, cp.SemiImplicitEuler(), None, DT))

    def steps(integrator: cp.Integrator):
        drift = default_drift(placed, integrator, None, DT)
        method = Method(Applied(talos.nv, tau), DT, integrator, drift, None, cp.Effects())
        leg = Leg(placed, method)
        leg.begin(0.0, q, v)
        return lambda q, v, tau: leg.step(0.0, q, v, 0, 1)

    calls = {"solve": workspace.acceleration} | {i.title: steps(i) for i in integrators}
    times = interleaved(calls, [(q, v, tau)], rounds=200, repeats=10)
    solve = times["solve"]
    print(f"\nTalos, 12 rows: a solve takes {solve.median:.1f} us")
    print(f"{'integrator':<28}{'solves a step':>14}{'a step / a solve':>18}")
    for integrator in integrators:
        ratio = times[integrator.title].ratio(solve)
        print(f"{integrator.title:<28}{integrator.solves_per_step:>14g}{ratio:>18.2f}")


def of_real_time(integrators: list[cp.Integrator]) -> None:
    """Print how fast Cassie swings that hangs by the pelvis, and how well."""
    cassie = cp.load_robot("cassie")
    scene = cp.Scene(cassie, [*cassie.loops, cp.SurfaceContact("pelvis")])
    q, v = scene.state()
    print(f"\nCassie hanging, {scene.rows} rows, dt {1e3 * DT:g} ms, 1 s")
    print(f"{'integrator':<28}{'x real time':>12}{'gap [m]':>10}{'energy [J]':>12}  status")
    for integrator in integrators:
        runs = [
            cp.simulate(scene, q, v, duration=1.0, dt=DT, integrator=integrator) for _ in range(3)
        ]
        fastest = min(runs, key=lambda run: run.run.wall_time)
        print(
            f"{integrator.title:<28}{fastest.t[-1] / fastest.run.wall_time:>12.1f}"
            f"{fastest.violation.max():>10.1e}{np.abs(fastest.energy.error).max():>12.1e}"
            f"  {fastest.status.name.lower()}"
        )


if __name__ == "__main__":
    main()
