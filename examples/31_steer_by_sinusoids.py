"""Steering by sinusoids: a unicycle and a car with a trailer park sideways, and the DAE follows."""

import sys
from math import factorial, pi

import numpy as np
from scipy.integrate import solve_ivp

import condyn_pin as cp
from condyn_pin.constraints import Driven, HeldJoint, analytic

base, hitch, w, a = 2.5, 2.0, 1.0, 2.0  # of the car [m]; u_1 = a sin(w t) [m/s], w [rad/s]
T, fine = 2 * pi / w, {"method": "DOP853", "rtol": 1e-13, "atol": 1e-14, "dense_output": True}
exact = cp.simulation.DormandPrince(1e-8 if "--quick" in sys.argv else 1e-10, 1e-11)

# Chained form: z_1' = u_1, z_2' = u_2, z_(j+1)' = z_j u_1. z_1 is x and z_n is y of the last axle,
# z_(n-1) the slope of its path, and those before are how that changes with x (Murray, Sastry 1993).


def chained(z, u):
    """Return z'."""
    return np.array([*u, *(z[1:-1] * u[0])])


def disc(z):
    """Return x and heading."""
    return z[0], np.arctan(z[1])


def car(z):
    """Return x and steering of the car, from the path of its trailer with curvature k."""
    c, s = np.cos(np.arctan(z[3])), np.sin(np.arctan(z[3]))
    k, rate = z[2] * c**3, c * (z[1] * c**3 - 3 * z[2] ** 2 * c**4 * s)
    turn = (k + hitch * rate / (1 + (hitch * k) ** 2)) * np.cos(np.arctan(hitch * k))
    return z[0] + hitch * (c - 1), np.arctan(base * turn)


def period(z0, k, b, joints_of):
    """Return z after a period of u_2 = b cos(k w t), and the path (s, s', s'') of two joints."""

    def inputs(t):
        return np.array([a * np.sin(w * t), b * np.cos(k * w * t)])

    def path(t):
        z, (u, du, _) = moved.sol(t), analytic(inputs)(t)
        dz = chained(z, u)
        ddz = chained(z, du) + np.array([0, 0, *(dz[1:-1] * u[0])])
        return analytic(lambda e: np.array(joints_of(z + e * dz + e**2 / 2 * ddz)))(0.0)

    moved = solve_ivp(lambda t, z: chained(z, inputs(t)), (0, T), z0, **fine)
    return moved.y[:, -1], path


def park(robot, joints, joints_of, goal):
    """Return where the robot goes if two of its joints are driven, period by period."""
    q, z, track = np.zeros(robot.nq), np.zeros(len(goal)), []
    for k in range(1, len(goal) - 1):  # a period moves z_(k+2), and leaves those before alone
        b = (goal[k + 1] - z[k + 1]) * factorial(k) * (2 * w / a) ** k / T
        z, path = period(z, k, b, joints_of)
        paths = [lambda t, i=i, path=path: np.array(path(t))[:, i] for i in range(2)]
        drives = [Driven(HeldJoint(j), path) for j, path in zip(joints, paths, strict=True)]
        scene = cp.Scene(robot, [*robot.contacts, *drives])
        v = cp.mechanism.project_velocity(scene, q, np.zeros(robot.nv))
        run = cp.simulate(scene, q, v, duration=T, dt=0.2, integrator=exact)
        q, track = run.q[-1], [*track, run.q]
    return np.vstack(track)


parked = park(cp.model.unicycle(), ("x", "heading"), disc, [0, 0, 1.0])
truck = cp.model.car(trailers=1, wheelbase=base, hitch=hitch)
backed = park(truck, ("x", "steering"), car, [0, 0, 0, 0.2, 1.0])
slope = np.tan(backed[-1, 2] + backed[-1, 4])
y = backed[-1, 1] - hitch * np.sin(np.arctan(slope))
if "--no-view" not in sys.argv:
    import matplotlib.pyplot as plt

    plt.legend(plt.plot(*parked[:, :2].T, *backed[:, :2].T), ["unicycle [m]", "car"], loc=(0, 1))
    plt.savefig("parking.png")
off = max(np.abs(parked[-1] - [0, 1, 0, 0]).max(), abs(y - 1), abs(slope - 0.2))
print(f"parked a metre to the side, trailer at slope {slope:.9f}: error {off:.0e} m, rad")
