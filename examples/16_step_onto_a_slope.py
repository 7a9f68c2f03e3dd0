"""Solo12 steps onto a slope: two planes for one foot, and how near it comes to slipping.

python examples/16_step_onto_a_slope.py
"""

import sys

import numpy as np

import condyn_pin as cp
from condyn_pin.constraints import Plane
from condyn_pin.viewing import plots

quick, show = "--quick" in sys.argv, "--no-view" not in sys.argv
solo = cp.load_robot("solo12")
stand = solo.postures["standing"]
names, friction, slope = [foot.name for foot in solo.contacts], 0.7, np.radians(15)
level = cp.Scene(solo, contacts=solo.frictional_contacts(friction))
stand = cp.mechanism.place_on_ground(level, stand)
feet = {name: cp.solve(cp.Scene(solo, [cp.PointContact(name)]), stand, np.zeros(18), np.zeros(18))
        .forces[name].at for name in names}  # fmt: skip

# The floor, and a slope that rises out of it ahead: the left front foot may touch both.
edge = feet["FL_FOOT"][0] + 0.02
normal = (-np.sin(slope), 0.0, np.cos(slope))
ramp = Plane(normal, height=-np.sin(slope) * edge)
above = cp.FrictionalContact("FL_FOOT", on=ramp, friction=friction, name="FL on the slope")
scene = cp.Scene(solo, contacts=[*level.contacts, above])


def posture(base: np.ndarray, front_left: np.ndarray) -> np.ndarray:
    """Return the angles of the legs with the base shifted, and one foot elsewhere [m]."""
    places = {**feet, "FL_FOOT": feet["FL_FOOT"] + front_left}
    held = [cp.PointContact(name, anchor=tuple(places[name])) for name in names]
    q = stand.copy()
    q[:3] += base
    return cp.Scene(solo, held).assemble(q, fixed=["root_joint"]).q[7:]


# Lean away from the foot, lift it, put it 5 cm up the slope, and lean back halfway.
lean, none = np.array([-0.06, -0.05, 0.0]), np.zeros(3)
up = np.array([0.07, 0.0, 0.05 * np.tan(slope)])
keys = [posture(none, none), posture(lean, none), posture(lean, up / 2 + (0, 0, 0.03)),
        posture(lean, up - (0, 0, 0.002)), posture(lean / 2, up - (0, 0, 0.002))]  # fmt: skip
times = np.array([0.0, 0.3, 0.5, 0.7, 1.0])


def tau(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Return the torques of the motors, towards what is planned."""
    wanted = np.array([np.interp(t, times, angles) for angles in np.transpose(keys)])
    return np.concatenate([np.zeros(6), 30.0 * (wanted - q[7:]) - 0.5 * v[6:]])


run = cp.simulate(scene, stand, np.zeros(18), tau, duration=0.8 if quick else 1.2, dt=1e-3)
print(run)
print("at the end:", {name: str(modes[-1]) for name, modes in run.modes.items()})

# What friction has to give, of what it could: 1 is where a foot slips.
for name, force in run.forces.items():
    t1, t2, n = force[-50:].mean(axis=0)
    if n > 1e-3:
        print(
            f"{name:<16} {n:6.3f} N, needs {np.hypot(t1, t2) / (friction * n):.2f} of its friction"
        )
carried = sum(contact @ axes.T for contact, axes in (
    (force[-50:].mean(axis=0), ramp.placement.rotation if "slope" in name else np.eye(3))
    for name, force in run.forces.items()))  # fmt: skip
print(f"all feet carry {carried.round(3)} N of a weight of {9.81 * solo.mass:.3f} N")
if show:
    plots.modes(run).figure.savefig("slope_modes.png")
    cp.view(run, cones=True, light=True)
print(f"Coulomb's law in every step: error {run.contact.natural.max():.0e}")
