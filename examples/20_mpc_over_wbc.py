"""Model-predictive control at 30 Hz on top of whole-body control at 1 kHz: Solo12 is pushed.

    python examples/20_mpc_over_wbc.py [--quick] [--no-view]

Above, a pendulum looks 0.5 s ahead: min |c - wanted|^2 + 1e-6 |u|^2 over jerks u with the ZMP
z = c - (h / g) c'' in the support. Below, a controller gives torques. Needs the extra "control".
"""

import argparse

import numpy as np

import condyn_pin as cp
from condyn_pin import control

T, AHEAD, G, MARGIN = 1 / 30, np.arange(1, 17), 9.81, 0.03  # [s], steps, [m/s^2], [m]


def after(t):
    """Return what a time makes of (c, c', c''), and of a jerk."""
    return np.array([[1, t, t**2 / 2], [0, 1, t], [0, 0, 1]]), np.array([t**3 / 6, t**2 / 2, t])


def preview(height, low, high):
    """Return the MPC: from c, c', c'' (3, 2) and the way that is wanted (n, 2) to a jerk (2,)."""
    n, B, free = len(AHEAD), after(T)[1], np.array([after(T * k)[0] for k in AHEAD])
    by_u = np.array([[after(T * (k - i))[0] @ B * (i <= k) for i in range(n)] for k in range(n)])
    zmp, C, A, b = np.array([1.0, 0.0, -height / G]), by_u[..., 0], np.zeros((0, n)), np.zeros(0)
    H, Z, qp = C.T @ C + 1e-6 * np.eye(n), by_u @ zmp, control.ProxQP().start()

    def jerk(s, wanted, least, most):  # along one axis
        g, z = C.T @ (free[:, 0] @ s - wanted), free @ s @ zmp
        found = qp(control.QuadraticProgram(H, g, A, b, Z, least - z, most - z))
        assert found.verdict == "solved", f"no way keeps the ZMP on the feet: {found.verdict}"
        return found.x[0]

    return lambda s, wanted: [jerk(s[:, k], wanted[:, k], low[k], high[k]) for k in (0, 1)]


def main(quick: bool, no_view: bool) -> None:
    """Sway, be pushed, and say how well it went."""
    solo = cp.load_robot("solo12")
    held, floor = cp.Scene(solo, solo.contacts), cp.Scene(solo, (), solo.frictional_contacts(0.7))
    q, v = cp.mechanism.place_on_ground(floor, held.state()[0]), np.zeros(18)
    start, feet = control.balance(held, q, v, v, np.zeros(12)).com, control.support_polygon(held, q)
    plan = preview(start[2], feet.in_world.min(axis=0) + MARGIN, feet.in_world.max(axis=0) - MARGIN)
    now, answers = [-1.0, np.zeros((3, 2)), np.zeros(2)], []  # since when: c, c', c'', and u
    aside = 0.04 * np.sin(np.pi * np.linspace(0, 1, 1001)) ** 2  # there and back in 1 s [m]
    way = start[:2] + np.outer(np.append(aside, np.zeros(1500)), [0.0, 1.0])  # each ms

    def reference(t):
        A, B = after(t - now[0])
        return tuple(np.column_stack((A @ now[1] + np.outer(B, now[2]), [start[2], 0.0, 0.0])))

    def torque(t, q, v):
        if t - now[0] > T - 1e-9:
            at = control.balance(held, q, v, 0 * v, np.zeros(12))
            s = np.array([at.com[:2], at.com_velocity[:2], reference(t)[2][:2]])
            now[:] = t, s, plan(s, way[np.rint(1e3 * (t + T * AHEAD)).astype(int)])
        answers.append(below.solve(q, v, t))
        return answers[-1].tau

    tasks = [control.CenterOfMass(reference=reference, weight=100), control.Posture(weight=0.1)]
    tasks += [control.Orientation("base_link", weight=50)]
    below = control.Controller(held, tasks, cones=cp.contact.FrictionCone(0.6, sides=8))
    push = cp.AppliedForce("base_link", lambda t, q, v: (4.0 * (0.2 <= t < 0.3), 0.0, 0.0))  # [N]
    run = cp.simulate(floor, q, v, torque, duration=0.4 if quick else 1.5, dt=1e-3, forces=[push])
    found = cp.simulation.motion_balance(run)
    off = 1e3 * np.linalg.norm(found.com[:, :2] - way[: len(run.t)], axis=1)
    print(f"off by {off.max():.1f} mm at most, {off[-1]:.2f} mm at the end, {found!r}")
    if not no_view:
        cp.view(run, balance=True)
    print(f"largest error of a whole-body program {max(a.residuals.kkt for a in answers):.0e}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--no-view", action="store_true")
    main(**vars(parser.parse_args()))
