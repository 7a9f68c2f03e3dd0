"""A four-bar linkage swings up by its one motor: iLQR on steps that keep its loop closed.

    python examples/22_swing_by_ilqr.py [--quick] [--no-view]

min dt/2 sum |u|^2 + w/2 |x(T) - goal|^2  with  x+ = f(x, u),  x = (q, v), at rest before and after.
Backwards in time, the cost to go, g.dx + dx.H dx / 2, gives the feedback u + k + K dx.
"""

import sys

import numpy as np
import pinocchio as pin

import condyn_pin as cp


def apart(model, a, b):
    """Return what leads from a state to another, in the tangent."""
    return np.append(pin.difference(model, a[: model.nq], b[: model.nq]), (b - a)[model.nq :])


def backward(action, xs, us, g, H, more):
    """Return k (n, m) and K (n, m, 2 nv) of all steps; `more` regularises."""
    (n, m), dt = us.shape, action.dt
    k, K, R = np.zeros((n, m)), np.zeros((n, m, len(g))), dt * np.eye(m)
    for i in reversed(range(n)):
        Fx, Fu = action.derivatives(xs[i], us[i])
        Qu, Qux, Quu = dt * us[i] + Fu.T @ g, Fu.T @ H @ Fx, Fu.T @ H @ Fu + R
        k[i], K[i] = (-np.linalg.solve(Quu + more * R, each) for each in (Qu, Qux))
        g = Fx.T @ g + K[i].T @ (Quu @ k[i] + Qu) + Qux.T @ k[i]
        H = Fx.T @ H @ Fx + K[i].T @ (Quu @ K[i] + Qux) + Qux.T @ K[i]
    return k, K


def forward(action, xs, us, k, K, share):
    """Return the motion that a share of k gives, with K against what that changes."""
    there, torques = [xs[0]], []
    for x, u, more, gain in zip(xs[: len(us)], us, k, K, strict=True):
        torques.append(u + share * more + gain @ apart(action.scene.robot.model, x, there[-1]))
        there.append(action.step(there[-1], torques[-1]))
    return np.array(there), np.array(torques)


def ilqr(action, start, goal, us, *, iterations, w=1e3):
    """Return the states (n + 1, nq + nv) and the torques (n, m) of the best motion."""
    model, more = action.scene.robot.model, 1e-3
    xs, us = forward(action, [start] * len(us), us, us, np.zeros((*us.shape, 2 * model.nv)), 0.0)

    def cost(xs, us):
        return (action.dt * np.sum(us**2) + w * np.sum(apart(model, goal, xs[-1]) ** 2)) / 2

    for _ in range(iterations):
        e = apart(model, goal, xs[-1])
        k, K = backward(action, xs, us, w * e, w * np.eye(len(e)), more)
        if np.abs(k).max() < 1e-2:  # [N m]
            break
        tried = (forward(action, xs, us, k, K, share) for share in 0.5 ** np.arange(6))
        better = next((each for each in tried if cost(*each) < cost(xs, us)), None)
        more = max(0.1 * more, 1e-6) if better else 10 * more
        xs, us = better or (xs, us)
    return xs, us


quick, bar = "--quick" in sys.argv, cp.model.four_bar()
scene, dt, T = cp.Scene(bar, bar.loops), 0.02 if quick else 0.01, 1.2  # [s]
way = [scene.state("open")[0]]
for crank in np.linspace(1.65, -1.75, 50):  # from standing to hanging [rad]
    way.append(cp.mechanism.complete_state(scene, [crank], near=way[-1]).q)
slowly = max(np.abs(cp.control.gravity_compensation(scene, q).u).max() for q in way[1:])
action, v, n = cp.layers.Action(scene, dt), np.zeros(bar.nv), round(T / dt)
start, goal, most = np.append(way[-1], v), np.append(way[1], v), 20 if quick else 60
xs, us = ilqr(action, start, goal, np.zeros((n, 1)), iterations=most)
print(f"crank at {xs[-1, 0]:.3f} rad, at rest, to {np.abs(xs[-1] - goal).max():.0e} rad, rad/s")
print(f"with {np.abs(us).max():.1f} N m at most; to lift it slowly takes {slowly:.1f} N m")
held = (us @ action.B.T)[[*range(n), n - 1]]
torque, how = lambda t, q, v: held[round(t / dt)], action.integrator
run = cp.simulate(scene, way[-1], v, torque, duration=T, dt=dt, integrator=how)
if "--no-view" not in sys.argv:
    cp.view(run)
print(f"its loop is closed all the way, to an error of {run.violation.max():.0e} m")
