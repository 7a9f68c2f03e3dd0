"""Talos on two feet: three methods, the ground forces, and how far each answer can be trusted.

python examples/01_two_feet.py
"""

import numpy as np

import condyn_pin as cp

talos = cp.load_robot("talos")
stance = cp.Scene(talos, talos.contacts)  # both soles flat on the ground: 12 rows
print(stance.summary(), "\n")

# Torques that hold the posture: gravity's, less what the ground carries. That part is chosen
# so that nothing is left in the rows of the free-flyer, which has no motor.
q, v = stance.state("half_sitting")
terms = cp.Workspace(stance).terms(q, v)
lam = np.linalg.lstsq(terms.J.T[:6], terms.h[:6], rcond=None)[0]
tau = terms.h - terms.J.T @ lam

# LCABA needs Pinocchio 4; the others run on 3.9 too.
reference = cp.solve(stance, q, v, tau, solver=cp.dynamics.Reference())
for solver in (cp.LCABA(), cp.Proximal(), cp.DenseKKT()):
    try:
        solution = cp.solve(stance, q, v, tau, solver=solver)
    except cp.errors.UnsupportedBackend as error:
        print(f"{type(solver).__name__}: {error}")
        continue
    error = np.abs(solution.a - reference.a).max()
    print(
        f"{type(solver).__name__:9} |a| {np.abs(solution.a).max():.0e}, error {error:.0e} rad/s^2"
    )

print("\nForce of the ground on each foot, world axes [N]:")
for name, force in reference.world_forces.items():
    print(f"  {name:16} {np.array2string(force[:3], precision=3, suppress_small=True)}")
total = sum(force[2] for force in reference.world_forces.values())
weight = 9.81 * talos.mass
print(f"together {total:.4f} N, weight {weight:.4f} N: error {abs(total - weight):.0e} N")
