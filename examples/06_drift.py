"""Drift: how gaps grow, which gains are too high, and why closed loops are not enough.

OMP_NUM_THREADS=1 python examples/06_drift.py [--plot drift.png] [--steps 100000]
"""

import argparse
import sys
from pathlib import Path

import numpy as np

import condyn_pin as cp
from condyn_pin.simulation.stability import stability_limit

sys.path.append(str(Path(__file__).parents[1] / "benchmarks"))  # what measures the library
from lab.drift import area, contest, gap_growth, rod_pendulum, save_laboratory

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--plot", help="draw it into this file")
parser.add_argument("--steps", type=int, default=1000, help="of the long runs")
parser.add_argument("--quick", action="store_true", help="fewer of them")
parser.add_argument("--no-view", action="store_true", help="opens no window anyway")
given = parser.parse_args()
if given.quick:
    given.steps = 200

# A point mass on a rod, in Cartesian coordinates: one row, x^2 + z^2 = 1.
scene = rod_pendulum()
q, v = scene.state("horizontal")
print(scene.summary(), "\n")

# 1. Integrators that solve for accelerations leave gaps. A first-order method leaks into the gap
#    at every step, one of high order into the velocity J v, which adds up to t^2.
growths = {
    "explicit Euler": gap_growth(cp.simulation.ExplicitEuler(), dt=1e-3, steps=10_000),
    "Runge-Kutta 4": gap_growth(cp.RungeKutta4(), dt=2e-2, steps=1000),
}
for name, growth in growths.items():
    gap, t = growth.violation[-1], growth.t[-1]
    print(f"{name:15} gap {gap:.1e} m at {t:g} s, grows like t^{growth.power:.2f}")

# 2. Baumgarte pulls the gap back like a spring. A spring that is too stiff for the step explodes.
euler = cp.SemiImplicitEuler()
limit, theory = stability_limit(euler), 2 * np.sqrt(2) - 2
print(f"\nsemi-implicit Euler: alpha dt below {limit:.4f}, theory {theory:.4f}")
popular = cp.Baumgarte(1e3, np.sqrt(2) * 1e3)  # alpha = 1 / dt, beta = sqrt(2) / dt
try:
    cp.simulate(scene, q, v, duration=1.0, dt=1e-3, integrator=euler, drift=popular)
except cp.InvalidArgument as refused:
    print("refused:", refused)

# 3. Gains, projections and RATTLE over many steps. The gap says nothing about the energy.
print(f"\n{given.steps} steps of 10 ms: gap [m], energy error [J] in the first and last tenth")
results = contest(1e-2, given.steps)
for one in results:
    e = one.errors
    print(f"{one.title:34} {e.violation:.0e}  {e.early:.1e} -> {e.late:.1e}")

# 4. Why: RATTLE's step keeps areas of the phase plane; a correction behind a step breaks that.
print("\nchange of phase-plane area by a step:")
for one in results:
    print(f"{one.title:34} {one.area:+.0e}")

if given.plot:
    save_laboratory(growths, (euler, cp.RungeKutta4()), results, given.plot)

kept = area(cp.simulation.Rattle(), cp.simulation.NoDrift(), dt=1e-2)
print(f"\nerror of the area that RATTLE keeps: {abs(kept):.0e}")
