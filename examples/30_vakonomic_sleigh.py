"""Two principles disagree: how a sleigh moves, and what makes its action stationary.

python examples/30_vakonomic_sleigh.py
"""

import sys

import numpy as np

import condyn_pin as cp
from condyn_pin.nonholonomic import vakonomic

quick, show = "--quick" in sys.argv, "--no-view" not in sys.argv

# Chaplygin's sleigh: its blade does not slip sideways, and allows every place of the plane.
arm, mass, inertia = 0.2, 1.0, 0.1
sleigh = cp.model.sleigh(arm=arm, mass=mass, inertia=inertia)
scene = cp.Scene(sleigh, sleigh.contacts)
print(scene.summary().classification)
print(cp.mechanism.controllability(scene))

# d'Alembert: M a + h = A^T lam, forces that do no work. That is what machines do.
q, v, T = np.array([0.0, 0.0, 1.0, 0.0]), np.array([1.0, 0.0, 2.0]), 2.0
dt = 1e-2 if quick else 1e-3
machine = cp.simulate(scene, q, v, duration=T, dt=dt)

# Vakonomic: M a + h = A^T lam - K^T mu, mu' = -lam, with K the curvature of the rows.
paths = {"d'Alembert": machine.q}
for start in (0.0, 0.5):
    motion = vakonomic(scene, q, v, [start], duration=T, dt=dt)
    paths[f"vakonomic, mu(0) = {start} N s"] = motion.q
    apart = np.hypot(*(motion.q[-1, :2] - machine.q[-1, :2]))
    print(f"vakonomic with mu(0) = {start}: {apart:.3f} m from the machine after {T} s, "
          f"turning at {motion.v[-1, 2]:.3f} and not {machine.v[-1, 2]:.3f} rad/s")  # fmt: skip

if show:
    import matplotlib.pyplot as plt

    for name, path in paths.items():
        plt.plot(path[:, 0], path[:, 1], label=name)
    plt.axis("equal")
    plt.xlabel("x [m]")
    plt.ylabel("y [m]")
    plt.legend()
    plt.savefig("vakonomic.png")

# Both keep the energy. The vakonomic one keeps the momenta of a free body too, to which that of
# the blade belongs: |(m u, m arm omega + mu)|, and no blade of steel has that.
u, _, w = motion.v.T
momentum = np.hypot(mass * u, mass * arm * w + motion.mu[:, 0])
print(f"momentum of the vakonomic sleigh: error {np.ptp(momentum):.0e} N s")
