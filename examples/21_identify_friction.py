"""Friction and restitution from a noisy motion: Gauss-Newton on derivatives through contact.

python examples/21_identify_friction.py
"""

import sys

import numpy as np

import condyn_pin as cp
from condyn_pin.constraints import Ball, Box
from condyn_pin.gradients import ActiveSet, EventLocated, trajectory_derivatives

quick, show = "--quick" in sys.argv, "--no-view" not in sys.argv
rng, sigma, every, g = np.random.default_rng(0), 5e-4, 0.02, 9.81  # noise [m], samples [s]
box = cp.model.free_box(mass=1.0, size=(0.2, 0.12, 0.08))
ball = cp.model.free_ball(mass=1.0, radius=0.05)


def touching(body, p):
    """Return the box with friction p, or the ball with restitution p."""
    if body is box:
        contact = cp.FrictionalContact("box", Box(0.1, 0.06, 0.04), friction=p)
    else:
        contact = cp.FrictionalContact("ball", Ball(0.05), friction=0.2, restitution=p)
    return cp.Scene(body, contacts=[contact])


def recorded(scene, q, v, T, axes):
    """Return a motion in fine steps, and its positions with noise."""
    run = cp.simulate(scene, q, v, duration=T, dt=1e-3 if quick else 1e-4, integrator=cp.Moreau())
    return run, rng.normal(run.q[:: round(every / run.t[1]), axes][1:], sigma)


def predicted(scene, q, v, count, axes, wrt, route, dt, tau=0.0):
    """Return positions, their slopes by p and the start's v, and by p within each sample alone."""
    n, found = len(v), []
    S = np.eye(2 * n)[:, [0, *(n + i for i in axes)]] * ([0] + [1] * len(axes))
    grid = {"duration": every, "dt": dt, "integrator": cp.Moreau(), "close_start": False}
    for _ in range(count):  # S+ = A S + dx+/dp: all points of a body have the same p
        run = cp.simulate(scene, q, v, tau, **grid)
        of = trajectory_derivatives(run, tau, wrt=[wrt], route=route)
        by_p, S, q, v = of.by(wrt).sum(axis=1), of.dx_dx @ S, of.q, of.v
        S[:, 0] += by_p
        found.append((q[axes], S[axes], np.abs(by_p).max()))
    return [np.array(each) for each in zip(*found, strict=True)]


def fitted(body, q, v, seen, axes, wrt, route, dt, p):
    """Say p, its standard deviation and the misfit: min |x(p, v0) - seen|^2, v0 unknown too."""
    for _ in range(4 if quick else 6):
        x, slopes, _ = predicted(touching(body, p), q, v, len(seen), axes, wrt, route, dt)
        J, off = slopes.reshape(seen.size, -1), (seen - x).ravel()
        change = np.linalg.lstsq(J, off, rcond=None)[0]
        p, v = np.clip(p + change[0], 0.01, 0.99), v + change[1:] @ np.eye(6)[axes]
    std, misfit = sigma * np.sqrt(np.linalg.inv(J.T @ J)[0, 0]), np.sqrt(np.mean(off**2))
    return f"{wrt} {p:.4f} +- {std:.4f}, misfit {1e3 * misfit:.2f} mm of {1e3 * sigma:.2f} mm noise"


# A box slides from 2 m/s and stops after 0.41 s; the guess is 60 % too high, and too fast.
q, v = touching(box, 0.5).state()
along, of_box = [0.8, 0.6], ([0, 1], "friction", ActiveSet(), 5e-3 if quick else 1e-3)
v[:2] = 2.0 * np.array(along)
run, seen = recorded(touching(box, 0.5), q, v, 0.6, [0, 1])
print(f"true friction 0.5: {fitted(box, q, 1.1 * v, seen, *of_box, 0.8)}")
_, slopes, own = predicted(touching(box, 0.5), q, v, len(seen), *of_box)
print(f"slope of a sample: {own[:20].min():.2g} while it slides, {own[21:].max():.0e} at rest")
held = predicted(touching(box, 0.5), q, 0 * v, 3, *of_box, 3.0 * np.eye(6)[0])[1][..., 0]
print(f"pushed by 3 N it sticks: slope {np.abs(held).max():.0e}, any friction above 0.31 will do")
# A ball falls half a metre: when it bounces again depends on the restitution.
q, v = touching(ball, 0.8).state()
q[2] = 0.55
_, seen = recorded(touching(ball, 0.8), q, v, 1.0, [2])
for route in (ActiveSet(), EventLocated()):
    of_ball = [2], "restitution", route, 1e-2
    print(f"true restitution 0.8, by {route}: {fitted(ball, q, v, seen, *of_ball, 0.7)}")
if show:
    cp.view(run)
off = slopes[:20, :, 0] + g / 2 * np.outer((every * np.arange(1, 21)) ** 2, along)
print(f"slope by friction, -g t^2 / 2 while it slides: error {np.abs(off).max():.0e}")
