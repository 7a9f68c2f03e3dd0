"""Steering two wheels by one linkage: how near Ackermann's trapezoid comes to his condition.

python examples/32_ackermann.py

Both wheels roll about one point if cot(outer) - cot(inner) = track / wheelbase. No linkage of three
bars does that for all angles; one whose arms point to the rear axle comes close.
"""

import sys

import numpy as np

import condyn_pin as cp

quick, show = "--quick" in sys.argv, "--no-view" not in sys.argv
wheelbase, track = 2.5, 1.4  # [m]
inner = np.deg2rad(np.linspace(2.0, 35.0, 6 if quick else 34))
ideal = np.arctan(1 / (1 / np.tan(inner) + track / wheelbase))


def outer(arm):
    """Return the angles of the outer wheel, following the linkage from straight on."""
    steering = cp.model.ackermann(wheelbase=wheelbase, track=track, arm=arm)
    scene, q, found = cp.Scene(steering, steering.loops), np.zeros(2), []
    for angle in inner:
        q = scene.assemble([angle, q[1]], fixed=["left"]).q
        found.append(q[1])
    return np.array(found)


def by_hand(arm):
    """Return the same by plane geometry: both arms end on a rod of one length."""
    lean = np.arctan2(track / 2, wheelbase)
    left = -arm * np.exp(1j * (inner + lean)) + 0.5j * track
    rod = track - 2 * arm * np.sin(lean)
    # |left - right| = rod, right = -arm exp(i (x - lean)) - i track / 2: A cos x + B sin x = C
    p = left + 0.5j * track
    A = 2 * arm * (p * np.exp(1j * lean)).real
    B = 2 * arm * (p * np.exp(1j * lean)).imag
    C = rod**2 - np.abs(p) ** 2 - arm**2
    return np.arctan2(B, A) - np.arccos(C / np.hypot(A, B))


worst, curves = 0.0, {}
for arm in (0.1, 0.2, 0.4):
    x, exact = outer(arm), by_hand(arm)
    exact = x + (exact - x + np.pi) % (2 * np.pi) - np.pi  # angles, whole turns apart
    worst, curves[arm] = max(worst, np.abs(x - exact).max()), x - ideal
    print(
        f"arm {arm} m: off Ackermann's condition by {np.rad2deg(np.abs(x - ideal).max()):.2f} deg"
    )
if show:
    import matplotlib.pyplot as plt

    for arm, off in curves.items():
        plt.plot(np.rad2deg(inner), np.rad2deg(off), label=f"arm {arm} m")
    plt.xlabel("inner wheel [deg]")
    plt.ylabel("outer wheel, off the condition [deg]")
    plt.legend()
    plt.savefig("ackermann.png")

# A car with that steering turns about one point: its front blade is the wheel in the middle.
car = cp.model.car(wheelbase=wheelbase)
road = cp.Scene(car, car.contacts)
middle = np.arctan(1 / (1 / np.tan(inner[-1]) + track / wheelbase / 2))
v = cp.mechanism.project_velocity(road, [0, 0, 0, middle], [1.0, 0, 0, 0])
print(f"at {np.rad2deg(inner[-1]):.0f} deg the rear axle turns on a circle of {v[0] / v[2]:.3f} m")
print(f"linkage against plane geometry: error {worst:.0e} rad")
