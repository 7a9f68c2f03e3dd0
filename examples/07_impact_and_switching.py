"""A four-legged robot falls, lands on its feet, and lifts one foot: impacts and events.

python examples/07_impact_and_switching.py
"""

import sys

import numpy as np

import condyn_pin as cp

quick = "--quick" in sys.argv
solo = cp.load_robot("solo12")
feet = [cp.PointContact(contact.frame) for contact in solo.contacts]
air, ground = cp.Scene(solo), cp.Scene(solo, feet)

# From the posture, 5 cm up and falling flat; the joints are held by a stiff spring in tau.
q, v = ground.state()
height = 0.05
q[2] += height
stand = q[7:].copy()


def tau(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Return the torques of the motors: back to the posture."""
    return np.concatenate([np.zeros(6), 5.0 * (stand - q[7:]) - 0.1 * v[6:]])


floor = []


def gap(snapshot: cp.simulation.Snapshot) -> float:
    """Return how high the foot stands over where the posture had it."""
    foot = snapshot.position("FL_FOOT")[2]
    if not floor:
        floor.append(foot - height)
    return foot - floor[0]


events = [
    cp.Event(name="landing", when=gap, scene=ground),
    cp.Event(name="lift-off", at=0.15, scene=cp.Scene(solo, feet[:3])),
]
run = cp.simulate(air, q, v, tau, duration=0.16 if quick else 0.3, dt=5e-4, events=events)
print(run)

landing = run.run.happened[0]
fall = np.sqrt(2 * height / 9.81)
print(f"\nlanded at t = {landing.t:.6f} s; a stone falls {height} m in {fall:.6f} s")
print(f"the impact took {landing.energy_lost:.4f} J")

# The same impact by itself: all feet stop at once, and what was lost is what the velocities say.
before, after = run.v[landing.sample - 1], run.v[landing.sample]
alone = cp.impact(ground, run.q[landing.sample - 1], before)
print(f"impulses [N s]: { {name: f.round(3).tolist() for name, f in alone.impulses.items()} }")
M = cp.Workspace(ground).terms(run.q[landing.sample], after).M
lost = 0.5 * (before @ M @ before - after @ M @ after)

left = np.abs(cp.Workspace(ground).jacobian(run.q[landing.sample]) @ after).max()
print(f"velocity of the feet after it: {left:.0e} m/s")
print(f"energies lost agree to {abs(lost / landing.energy_lost - 1):.0e}")
error = max(abs(landing.t / fall - 1), np.abs(alone.v - after).max())
print(f"time of landing, and velocity after both impacts: error {error:.0e}")
