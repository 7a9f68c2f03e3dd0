"""Solo12 hops: iLQR on steps whose feet stick and lift off; springs land it.

    python examples/23_solo12_hops.py [--quick] [--no-view]

min dt/2 sum |u|^2 + 1/2 |x(T) - goal|_W^2  with  x+ = f(x, u),  x = (q, v)
A sticking foot has no gradient towards height, but one towards the upward velocity that lifts it.
"""

import sys

import numpy as np
import pinocchio as pin

import condyn_pin as cp

quick, solo, g = "--quick" in sys.argv, cp.load_robot("solo12"), 9.81
scene = cp.Scene(solo, contacts=solo.frictional_contacts(friction=0.7))
action = cp.layers.Action(scene, 0.02 if quick else 0.01)
model, dt, nq = solo.model, action.dt, solo.nq


def apart(a, b):
    """Return what leads from a state to another, in the tangent."""
    return np.append(pin.difference(model, a[:nq], b[:nq]), (b - a)[nq:])


def backward(xs, us, p, P, more):
    """Return k (n, m) and K (n, m, 2 nv) of all steps, from the slope p and curvature P at T."""
    k, K, R = 0 * us, np.zeros((*us.shape, len(p))), dt * np.eye(us.shape[1])
    for i in reversed(range(len(us))):
        Fx, Fu = action.derivatives(xs[i], us[i])
        Qu, Qux, Quu = dt * us[i] + Fu.T @ p, Fu.T @ P @ Fx, Fu.T @ P @ Fu + R
        k[i], K[i] = (-np.linalg.solve(Quu + more * R, each) for each in (Qu, Qux))
        p = Fx.T @ p + K[i].T @ (Quu @ k[i] + Qu) + Qux.T @ k[i]
        P = Fx.T @ P @ Fx + K[i].T @ (Quu @ K[i] + Qux) + Qux.T @ K[i]
    return k, K


def forward(xs, us, k, K, share):
    """Return the motion that a share of k gives, with K against what that changes."""
    there, torques = [xs[0]], []
    for x, u, more, gain in zip(xs[: len(us)], us, k, K, strict=True):
        torques.append(u + share * more + gain @ apart(x, there[-1]))
        there.append(action.step(there[-1], torques[-1]))
    return np.array(there), np.array(torques)


def ilqr(start, goal, base, legs, base_v, legs_v, us):
    """Return states and torques from a start to a goal, with the weights of its parts."""
    W = np.repeat((base, legs, base_v, legs_v), (6, 12, 6, 12))

    def cost(xs, us):
        return (dt * np.sum(us**2) + W @ apart(goal, xs[-1]) ** 2) / 2

    xs, us = forward([start] * len(us), us, us, np.zeros((*us.shape, len(W))), 0.0)
    for more in 0.1 ** np.arange(8):
        k, K = backward(xs, us, W * apart(goal, xs[-1]), np.diag(W), more)
        tried = (forward(xs, us, k, K, share) for share in 0.5 ** np.arange(6))
        xs, us = next((each for each in tried if cost(*each) < cost(xs, us)), (xs, us))
    return xs, us


stand = np.append(scene.state()[0], np.zeros(solo.nv))
up = stand + 0.06 * np.eye(len(stand))[2]  # [m] higher, and so fast that it rises 12 cm more
up[nq + 2] = np.sqrt(2 * g * 0.12)
held = cp.control.gravity_compensation(cp.Scene(solo, solo.contacts), stand[:nq]).u
pushes, us = ilqr(stand, up, 1e3, 1e-2, 100, 1e-2, np.tile(held, (round(0.2 / dt), 1)))
flies, _ = ilqr(pushes[-1], stand, 1e-3, 100, 1e-3, 0.1, np.zeros((round(0.16 / dt), 12)))
gaps = [min(cp.step(scene, x[:nq], x[nq:], dt=1e-9).gaps.values()) for x in flies]
print(f"all feet {100 * max(gaps):.0f} cm off the floor, by {np.abs(us).max():.1f} N m")
end, legs = flies[-1], stand[7:nq]
run = cp.simulate(scene, end[:nq], end[nq:], lambda t, q, v: np.append(
    np.zeros(6), 8.0 * (legs - q[7:]) - 0.3 * v[6:]
), duration=0.6, dt=1e-3)  # fmt: skip
print(f"it lands, and stands at {100 * run.q[-1, 2]:.0f} cm")
if "--no-view" not in sys.argv:
    cp.view(run)
took = zip(pushes, us @ action.B.T, strict=False)
off = max(cp.step(scene, x[:nq], x[nq:], tau, dt=dt).dynamics_error for x, tau in took)
print(f"momentum and impulses of each step agree by Newton-Euler, to an error of {off:.0e} N s")
