"""Two principles disagree: how a sleigh moves, and what makes its action stationary.

python examples/30_vakonomic_sleigh.py
"""

import sys

import numpy as np
import pinocchio as pin

import condyn_pin as cp
from condyn_pin.mechanism import curvature

quick, show = "--quick" in sys.argv, "--no-view" not in sys.argv

# Chaplygin's sleigh: its blade does not slip sideways, and allows every place of the plane.
arm, mass, inertia = 0.2, 1.0, 0.1
sleigh = cp.model.sleigh(arm=arm, mass=mass, inertia=inertia)
scene = cp.Scene(sleigh, sleigh.contacts)
print(scene.summary().classification)
print("growth vector:", cp.mechanism.growth_vector(scene))

# d'Alembert: M a + h = A^T lam, forces that do no work. That is what machines do.
q, v, T = np.array([0.0, 0.0, 1.0, 0.0]), np.array([1.0, 0.0, 2.0]), 2.0
dt = 1e-2 if quick else 1e-3
machine = cp.simulate(scene, q, v, duration=T, dt=dt)

# Vakonomic: M a + h = A^T lam - K^T mu, mu' = -lam, with K the curvature of the rows.
workspace = cp.Workspace(scene, cp.DenseKKT())


def slope(q, v, mu):
    """Return a and mu'."""
    a = workspace.acceleration(q, v, -curvature(scene, q, v).T @ mu)
    return a, -workspace.lam()


def vakonomic(mu):
    """Runge-Kutta in v and mu, which do not feel where the sleigh is; q along the mean velocity."""
    path, speeds, at, u = [q], [v], q, v
    for _ in range(round(T / dt)):
        a1, m1 = slope(at, u, mu)
        a2, m2 = slope(at, u + dt / 2 * a1, mu + dt / 2 * m1)
        a3, m3 = slope(at, u + dt / 2 * a2, mu + dt / 2 * m2)
        a4, m4 = slope(at, u + dt * a3, mu + dt * m3)
        before, u = u, u + dt / 6 * (a1 + 2 * (a2 + a3) + a4)
        mu = mu + dt / 6 * (m1 + 2 * (m2 + m3) + m4)
        at = np.array(pin.integrate(sleigh.model, at, dt / 2 * (before + u)))
        path.append(at)
        speeds.append(u)
    return np.array(path), np.array(speeds), mu


paths = {"d'Alembert": machine.q}
for start in (0.0, 0.5):
    path, speeds, mu = vakonomic(np.array([start]))
    paths[f"vakonomic, mu(0) = {start} N s"] = path
    apart = np.hypot(*(path[-1, :2] - machine.q[-1, :2]))
    print(f"vakonomic with mu(0) = {start}: {apart:.3f} m from the machine after {T} s, "
          f"turning at {speeds[-1, 2]:.3f} and not {machine.v[-1, 2]:.3f} rad/s")  # fmt: skip

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
momentum = [np.hypot(mass * u, mass * arm * w + m) for u, w, m in
            ((v[0], v[2], 0.5), (speeds[-1, 0], speeds[-1, 2], mu[0]))]  # fmt: skip
print(f"momentum of the vakonomic sleigh: error {abs(momentum[1] - momentum[0]):.0e} N s")
