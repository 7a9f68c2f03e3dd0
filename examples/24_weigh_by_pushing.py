"""Mass and friction of a box from one push: Gauss-Newton in torch through whole motions.

    python examples/24_weigh_by_pushing.py [--quick] [--no-view]

min_(mu, w) sum_i |x_i(mu, w) - seen_i|^2    with w = 1 / m and x(mu, w) one layer of torch
The box is pushed by a known force, released, and slides until it stops: a = F w - mu g, then -mu g.
"""

import sys

import numpy as np
import torch

import condyn_pin as cp

quick, sigma, force = "--quick" in sys.argv, 5e-4, 12.0  # noise [m], push [N]
duration, every, push = 0.6, 0.01, 0.25  # of the motion, between samples, of the push [s]
box = cp.model.free_box(mass=1.0, size=(0.2, 0.12, 0.08))
shape = cp.constraints.Box(0.1, 0.06, 0.04)


def scene_of(mu):
    """Return the box on a floor."""
    return cp.Scene(box, contacts=[cp.FrictionalContact("box", shape, friction=mu)])


def positions(dt):
    """Return the samples of a motion in steps of dt as a function of mu and 1 / m."""
    scene, tau = scene_of(0.5), np.zeros((round(duration / dt), 6))
    tau[: round(push / dt), 0] = force
    start = [torch.tensor(x) for x in (*scene.state(), tau)]
    of_1_kg = torch.tensor(np.array([box.model.inertias[1].toDynamicParameters()]))
    motion = cp.layers.torch_simulate(
        scene, dt=dt, integrator=cp.Moreau(), wrt=["friction", "inertias"], every=round(every / dt)
    )
    return lambda p: motion(*start, p[:1], of_1_kg / p[1])[0][:, 0]


# What is seen: the motion in fine steps, with noise.
truth, rng = torch.tensor([0.4, 1 / 1.5], dtype=torch.double), np.random.default_rng(0)
exact = positions(2e-3 if quick else 2.5e-4)(truth)
seen = exact + torch.tensor(rng.normal(0.0, sigma, len(exact)))

x, p = positions(5e-3 if quick else 2.5e-3), torch.tensor([0.2, 1.0], dtype=torch.double)
for _ in range(3 if quick else 5):
    J, off = torch.func.jacfwd(x)(p), seen - x(p)
    p = p + torch.linalg.lstsq(J, off).solution
    misfit = 1e3 * float(off.square().mean().sqrt())
    print(f"friction {p[0]:.4f}, mass {1 / p[1]:.4f} kg; before that {misfit:.2f} mm off")
std, wrong = sigma * torch.linalg.inv(J.T @ J).diagonal().sqrt() / p, (p / truth - 1).abs()
print(
    f"of {1e3 * sigma} mm of noise: friction +- {100 * std[0]:.1f} %, mass +- {100 * std[1]:.1f} %"
)
print(f"friction is off by {100 * wrong[0]:.2f} %, mass by {100 * wrong[1]:.2f} %")
if "--no-view" not in sys.argv:
    scene = scene_of(float(p[0]))
    q, v, pushed = *scene.state(), np.append(force, np.zeros(5)) * float(p[1])  # of 1 kg
    cp.view(cp.simulate(scene, q, v, lambda t, q, v: pushed * (t < push), duration=0.6, dt=1e-3))
t = every * torch.arange(1, round(push / every) + 1, dtype=torch.double)
exact = torch.stack((-9.81 * t**2 / 2, force * t**2 / 2), dim=1)
off = (J[: len(t)] - exact).abs().max()
print(f"slopes of a sample, -g t^2 / 2 and F t^2 / 2 while it is pushed: error {off:.0e}")
