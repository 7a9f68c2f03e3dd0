"""Cassie falls on its feet: contacts that close, slide and let go, and loops that stay closed.

python examples/13_drop_cassie.py
"""

import sys

import numpy as np

import condyn_pin as cp
from condyn_pin.contact import ADMM
from condyn_pin.viewing import plots

quick, show = "--quick" in sys.argv, "--no-view" not in sys.argv
cassie = cp.load_robot("cassie", variant={"feet": "points"})
scene = cp.Scene(cassie, cassie.loops, cassie.frictional_contacts(friction=0.7))

# From the posture, 5 cm up; the motors hold it. Springs and damping act by themselves.
q, v = scene.state()
q[2] += 0.05
places = [cassie.index_q(motor) for motor in cassie.actuated]
columns = [cassie.index_v(motor) for motor in cassie.actuated]
stand = q[places].copy()


def hold(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Return the torques of the motors: back to the posture."""
    tau = np.zeros(cassie.nv)
    tau[columns] = 200.0 * (stand - q[places]) - 5.0 * v[columns]
    return tau


# Every step poses a contact problem; each answer is proved before the next one.
scheme = cp.Moreau(contact=ADMM(tolerance=1e-9))
run = cp.simulate(scene, q, v, hold, duration=0.15 if quick else 0.4, dt=5e-4, integrator=scheme)
print(run)

for name, modes in run.modes.items():
    closed = np.flatnonzero(modes != "open")
    touched = f"touches at t = {run.t[closed[0]]:.4f} s" if len(closed) else "does not touch"
    print(f"{name:<20} {touched}; at the end it is {modes[-1]}")
fall = np.sqrt(2 * 0.05 / 9.81)
print(f"a stone falls 0.05 m in {fall:.4f} s")

deepest = max(float(-gap.min()) for gap in run.gaps.values())
energy = run.energy
print(f"deepest penetration {deepest:.1e} m, loops open by {run.violation.max():.1e} m")
print(f"contacts took {-energy.contact[-1]:.2f} J, damping {-energy.damping[-1]:.2f} J")

if show:
    plots.modes(run).figure.savefig("cassie_modes.png")
    cp.view(run, cones=True, light=True)
print(f"Coulomb's law in every step: error {run.contact.natural.max():.0e}")
