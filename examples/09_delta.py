"""A Delta robot holds its platform: three motor torques instead of eighteen joint torques.

python examples/09_delta.py
"""

import numpy as np

import condyn_pin as cp

delta = cp.load_robot("delta")
scene = cp.Scene(delta, delta.loops)
q, v = scene.state("low")
print(f"{delta.nv} joints, {scene.rows} rows, mobility {scene.rank(q).mobility}")

# Plain inverse dynamics asks torques of joints that have no motor.
joints = cp.Workspace(scene).terms(q, v).h
passive = [joint for joint in delta.joints if joint not in delta.actuated]
print(
    f"h has torques at {np.count_nonzero(np.abs(joints) > 1e-9)} joints; motors: {delta.actuated}"
)

# Through the loops, the motors alone do it: B u + J^T lam = g(q).
held = cp.control.gravity_compensation(scene, q)
print(held)
assert held.fully_actuated

# The same from the transmission, by virtual work: u = G^T g.
through = cp.control.transmission(scene, q)
by_work = through.motor_torques(joints)
print(f"by virtual work the same to {np.abs(by_work - held.u).max():.0e} N m")

# Three motors, three directions: the Jacobian of the platform is square, and its inverse says what
# the motors feel of a force on it.
J = through.jacobian("platform")[:3]
push = np.array([0.0, 0.0, -1.0])  # [N]
print("1 N down on the platform asks of the motors [N m]:", np.round(-J.T @ push, 4))

# Forward dynamics with these torques: nothing moves.
solution = cp.solve(scene, q, v, held.tau)
error = np.abs(solution.a).max() / 9.81
print(f"with these torques it stays: error {error:.0e} of gravity")
