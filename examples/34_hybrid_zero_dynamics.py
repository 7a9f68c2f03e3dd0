"""Hybrid zero dynamics: a hip motor holds a compass walker to the gait that it has without one.

The torque keeps the virtual constraint swing = h(stance), with h from the passive limit cycle. What
is left is one equation in the stance angle a, linear in z = a'^2 / 2, and heel strike maps the
constraint onto itself at every speed: z goes to delta^2 z + c (Westervelt, Grizzle 2003).
"""

import sys

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import condyn_pin as cp

walker = cp.model.compass_walker(slope=np.deg2rad(3.0))
left, right = (cp.Scene(walker, [foot]) for foot in walker.contacts)
stance, still, hip = cp.Workspace(left), np.zeros(4), np.array([0.0, 0.0, -1.0, 1.0])
fine = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-13}


def embed(x):
    """Return q and v from angles and rates, the left foot at the origin."""
    s, c, u = np.sin(x[0]), np.cos(x[0]), x[2]
    return np.array([s, c, x[0], x[1]]), np.array([c * u, -s * u, u, x[3]])


def accelerations(x, tau):
    """Return those of both legs."""
    return stance.acceleration(*embed(x), tau)[2:]


def landed(x):
    """Return x behind heel strike, the legs having changed names."""
    return np.append(x[:2], cp.impact(right, *embed(x)).v[2:])[[1, 0, 3, 2]]


# The passive gait, by walking; it begins behind a strike, with half the angle between the legs.
apart = lambda t, x: x[0] + x[1] if t > 0.4 else -1.0  # noqa: E731  zero where the foot lands
apart.terminal, start = True, np.array([-0.27102868, 0.27102868, 1.09238359, 0.37737395])
for _ in range(4 if "--quick" in sys.argv else 12):
    swing = solve_ivp(lambda t, x: np.append(x[2:], accelerations(x, still)), (0.0, 2.0), start,
                      events=apart, dense_output=True, **fine)  # fmt: skip
    before, start = start, landed(swing.y[:, -1])
print(f"passive: {swing.t[-1]:.6f} s a step, comes back to {np.abs(start - before).max():.0e}")


def gait(a):
    """Return h, h' and h'' at a stance angle: where the passive gait has its swing leg."""
    t = brentq(lambda t: swing.sol(t)[0] - a, -1e-3, swing.t[-1] + 1e-3, xtol=1e-14)
    _, b, u, w = x = swing.sol(t)
    du, dw = accelerations(x, still)
    return b, w / u, (dw * u - w * du) / u**3


def zero_dynamics(a, z):
    """Return z' = a'' by the stance angle, while the torque keeps (swing - h)'' = 0."""
    h, slope, bend = gait(a)
    x = np.append([a, h], np.sqrt(2 * z[0]) * np.array([1.0, slope]))
    free = accelerations(x, still)
    by = accelerations(x, hip) - free
    torque = (slope * free[0] + bend * 2 * z[0] - free[1]) / (by[1] - slope * by[0])
    return [free[0] + torque * by[0]]


z0, z1 = np.array([0.94, 1.0, 1.06]) ** 2 * start[2] ** 2 / 2, []
for z in z0:
    end = solve_ivp(zero_dynamics, (start[0], -start[0]), [z], rtol=1e-11, atol=1e-12).y[0, -1]
    rates = np.sqrt(2 * end) * np.array([1.0, gait(-start[0])[1]])
    _, _, u, w = landed(np.append(-start[:2], rates))
    print(f"{np.sqrt(2 * z):.4f} to {u:.4f} rad/s; off by {w - gait(start[0])[1] * u:.0e} from h")
    z1.append(u**2 / 2)
slopes = np.diff(z1) / np.diff(z0)
if "--no-view" not in sys.argv:
    import matplotlib.pyplot as plt

    plt.plot(z0, z1, "o-", z0, z0)
    plt.savefig("zero_dynamics.png")
off = max(np.ptp(slopes), abs(z1[1] - z0[1]))
print(f"delta^2 = {slopes[0]:.6f}; z goes along a line: error {off:.0e}")
