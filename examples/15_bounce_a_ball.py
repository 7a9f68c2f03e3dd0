"""A ball bounces: restitution, rebound heights, and the error of the time step.

python examples/15_bounce_a_ball.py
"""

import sys
from itertools import pairwise

import numpy as np

import condyn_pin as cp
from condyn_pin.constraints import Ball

quick, show = "--quick" in sys.argv, "--no-view" not in sys.argv
radius, height, e, g = 0.05, 0.5, 0.8, 9.81
ball = cp.model.free_ball(mass=1.0, radius=radius)
touch = cp.FrictionalContact("ball", Ball(radius), friction=0.2, restitution=e)
scene = cp.Scene(ball, contacts=[touch])
q, v = scene.state()
q[2] = radius + height

# In closed form: t0 to the floor, and after it z = v1 s - g s^2 / 2 with v1 = e sqrt(2 g h).
fall, again = np.sqrt(2 * height / g), e * np.sqrt(2 * g * height)
s = 0.6 - fall
print(f"it touches after {fall:.6f} s, and is at {again * s - g * s**2 / 2:.6f} m after 0.6 s")
for dt in (1e-3,) if quick else (1e-2, 1e-3, 1e-4):
    run = cp.simulate(scene, q, v, duration=0.6, dt=dt, integrator=cp.Moreau())
    missed = run.q[-1, 2] - radius - (again * s - g * s**2 / 2)
    print(f"dt {dt:g} s: off by {missed:.1e} m at the end")

# Each bounce is e^2 as high as the one before, and takes 1 - e^2 of the energy.
run = cp.simulate(scene, q, v, duration=1.6, dt=1e-3, integrator=cp.Moreau())
hits = np.flatnonzero(run.forces["ball"][:, 2] > 0)
print(f"hits at t = {run.t[hits].round(3)} s")
peaks = [run.q[a:b, 2].max() - radius for a, b in pairwise(hits)]
wanted = height * e ** (2 * np.arange(1, 1 + len(peaks)))
print(f"heights {np.round(peaks, 4)} m; they have to be {np.round(wanted, 4)} m")
energy = run.energy
print(f"impacts took {-energy.contact[-1]:.4f} J of {energy.total[0] - energy.total.min():.4f} J")

# With StewartTrinkle nothing rebounds, and it says so.
try:
    cp.step(scene, q, v, dt=1e-3, integrator=cp.StewartTrinkle())
except cp.InvalidArgument as refused:
    print(f"refused: {refused}")

after, before = run.v[hits, 2], run.v[hits - 1, 2]
if show:
    cp.view(run)
print(f"rebound over approach, against e: error {np.abs(after / before + e).max():.0e}")
