"""Stewart's platform from motor commands: where it is, how fast it moves, what it can carry.

python examples/08_stewart.py
"""

import sys

import numpy as np

import condyn_pin as cp

quick = "--quick" in sys.argv
stewart = cp.load_robot("stewart")
scene = cp.Scene(stewart, stewart.loops)
print(scene.summary(), "\n")

# Encoders measure the six motors; the loops say the rest. Commands are followed in small strides,
# so that the platform stays on its branch.
columns = [stewart.index_q(leg) for leg in stewart.actuated]
q, _ = scene.state("home")
home = q[columns]
steps = 10 if quick else 100
worst, smallest = 0.0, np.inf
for k in range(steps):
    wave = 0.02 * np.sin(2 * np.pi * k / steps + np.arange(6))
    state = cp.mechanism.complete_state(scene, home + wave, near=q)
    q = state.q
    worst = max(worst, state.residual)
    smallest = min(smallest, state.assembly.smallest_singular_value)
print(f"{steps} commands: loops closed to {worst:.0e} m, smallest singular value {smallest:.3f}")

# Speeds of the motors to the velocity of the platform, and forces on it back to the motors.
through = cp.control.transmission(scene, q)
platform = stewart.frames[-1]
J = through.jacobian(platform)
print(f"Jacobian of {platform!r} from the motors has condition {np.linalg.cond(J):.1f}")
rng = np.random.default_rng(0)
w = rng.normal(size=6)
push = rng.normal(size=stewart.nv)
power = push @ through.velocities(w) - through.motor_torques(push) @ w
print(f"power of joints less power of motors: {power:.0e} W")

# The forces that hold it, and the proof: with them nothing accelerates.
held = cp.control.gravity_compensation(scene, q)
print("forces of the motors [N]:", np.round(held.u, 3))
at_rest = cp.solve(scene, q, np.zeros(stewart.nv), held.tau)
error = np.abs(at_rest.a).max() / 9.81
print(f"with these it stays: error {error:.0e} of gravity")
