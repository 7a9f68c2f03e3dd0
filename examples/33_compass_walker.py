"""A compass walker on a slope, without a motor: its limit cycle, and how its errors evolve.

x = (stance, swing, and their rates). A step is a flow x' = f(x) up to heel strike, g(x) = stance +
swing = 0, and a jump R: the other foot lands, and the legs change names. Errors evolve by Phi over
the flow and by the saltation matrix over the strike, S = DR + (f+ - DR f-) g_x / (g_x f-).
"""

import sys

import numpy as np
from scipy.integrate import solve_ivp

import condyn_pin as cp

walker = cp.model.compass_walker(slope=np.deg2rad(3.0))
left, right = (cp.Scene(walker, [foot]) for foot in walker.contacts)
stance, still, g_x = cp.Workspace(left), np.zeros(4), np.array([1.0, 1.0, 0.0, 0.0])
swap = np.array([1, 0, 3, 2])


def embed(x):
    """Return q and v with the left foot at the origin, and their derivatives by x."""
    (a, b, u, w), s, c = x, np.sin(x[0]), np.cos(x[0])
    q, v = np.array([s, c, a, b]), np.array([c * u, -s * u, u, w])
    q_x = np.array([[c, 0, 0, 0], [-s, 0, 0, 0], [1, 0, 0, 0], [0, 1, 0, 0]])
    v_x = np.array([[-s * u, 0, c, 0], [-c * u, 0, -s, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    return q, v, q_x, v_x


def flow(t, y):
    """Return x' and Phi'."""
    q, v, q_x, v_x = embed(y[:4])
    of = stance.derivatives(q, v, still)
    f_x = np.vstack([np.eye(4)[2:], (of.da_dq @ q_x + of.da_dv @ v_x)[2:]])
    return np.concatenate([y[2:4], of.solution.a[2:], (f_x @ y[4:].reshape(4, 4)).ravel()])


def strike(t, y):
    """Return g."""
    return g_x @ y[:4]


strike.terminal, strike.direction = True, 1.0  # the swing foot comes back from beyond


def step(x):
    """Return the end of a step, the flow, how the section maps onto itself, and S Phi."""
    y, fine = np.append(x, np.eye(4)), {"method": "DOP853", "rtol": 1e-12, "atol": 1e-13}
    y = solve_ivp(flow, (0.0, 0.1), y, **fine).y[:, -1]  # it begins on the ground, and leaves it
    swing = solve_ivp(flow, (0.1, 2.0), y, events=strike, **fine)
    y, Phi = swing.y[:, -1], swing.y[4:, -1].reshape(4, 4)
    q, v, q_x, v_x = embed(y[:4])
    hit = cp.impact(right, q, v)
    x1 = np.append(y[:2], hit.v[2:])[swap]
    R_x = np.vstack([np.eye(4)[:2], (hit.dv_dq @ q_x + hit.dv_dv @ v_x)[2:]])[swap]
    before, after = (flow(0.0, np.append(x, np.eye(4)))[:4] for x in (y[:4], x1))
    of_time = g_x / (g_x @ before)  # an error makes the strike come earlier by so much
    S = R_x + np.outer(after - R_x @ before, of_time)
    return x1, swing, R_x @ (Phi - np.outer(before, of_time @ Phi)), S @ Phi


# The section is behind a strike: half the angle between the legs, and two rates.
B = np.array([[-1.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
z, off = np.array([0.25, 1.0, 0.4]), 1.0
while off > 1e-12:  # Newton's method for z = P(z)
    x1, swing, mapped, whole = step(B @ z)
    P_z, off = np.linalg.pinv(B) @ mapped @ B, np.abs(x1[1:] - z).max()
    z = z + np.linalg.solve(np.eye(3) - P_z, x1[1:] - z)
multipliers = np.sort_complex(np.linalg.eigvals(whole))
print(f"a step takes {swing.t[-1]:.6f} s, the legs {2 * z[0]:.6f} rad apart; rates {z[1:]} rad/s")
print(f"eigenvalues of S Phi: {multipliers.round(6)}: 1 along the motion, the others die out")
print(f"a tenth is left after {np.log(0.1) / np.log(np.abs(multipliers[:-1]).max()):.1f} steps")
# twice the same, by two derivatives of one walk, and the 1 that is known
twice = np.abs(multipliers[:-1] - np.sort_complex(np.linalg.eigvals(P_z))).max()
if "--no-view" not in sys.argv:
    import matplotlib.pyplot as plt

    plt.plot(swing.y[0], swing.y[2], swing.y[1], swing.y[3])
    plt.savefig("compass.png")
print(f"eigenvalues: error {max(twice, abs(multipliers[-1] - 1)):.0e}")
