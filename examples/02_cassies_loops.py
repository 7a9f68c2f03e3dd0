"""Cassie's closed legs: which rows are redundant, how each method copes, what a motor does.

python examples/02_cassies_loops.py
"""

import numpy as np

import condyn_pin as cp

cassie = cp.load_robot("cassie")
legs = cp.Scene(cassie, cassie.loops)
summary = legs.summary()
print(f"{summary.rows} rows, rank {summary.rank}, mobility {summary.mobility}")
print("redundant:", ", ".join(summary.redundant), "\n")

# A random closed state, moving along the loops; a torque in the left knee motor.
q, v = legs.sample(np.random.default_rng(0))
tau = cassie.passive_torque(q, v)
tau[cassie.index_v("left-knee-op")] += 20.0  # [N m]

# The plain dense matrix is singular here, and says so; a tiny mu makes it solvable.
for solver in (cp.DenseKKT(), cp.DenseKKT(mu=1e-9), cp.Proximal()):
    solution = cp.solve(legs, q, v, tau, solver=solver, throw=False)
    print(f"{solver!r}\n  {solution.status}\n  bound on the error of a: {solution.error_bound:.0e}")

# The pull in the achilles rod, on the rod and in its axes.
print("\nforce on the rod [N]:", solution.forces["left-achilles-spring-joint"].round(3))

reference = cp.solve(legs, q, v, tau, solver=cp.dynamics.Reference())
error = np.abs(solution.a - reference.a).max() / np.abs(reference.a).max()
print(f"error of Proximal against Reference: {error:.0e} of max |a|")
