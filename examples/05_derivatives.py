"""Derivatives of Cassie's closed legs: three ways, products without matrices, and a check.

python examples/05_derivatives.py
"""

import sys
from time import perf_counter

import numpy as np

import condyn_pin as cp

quick = "--quick" in sys.argv
cassie = cp.load_robot("cassie")
legs = cp.Scene(cassie, cassie.loops)
q, v = legs.sample(np.random.default_rng(0))
tau = cassie.passive_torque(q, v)

found = {}
for method in ("kkt", "pinocchio", "differences"):
    workspace = cp.Workspace(legs, cp.Proximal())
    times = []
    for _ in range(3 if quick else 20):
        start = perf_counter()
        d = workspace.derivatives(q, v, tau, method=method)
        blocks = [d.da_dq, d.da_dv, d.da_dtau, d.dlam_dq, d.dlam_dv, d.dlam_dtau]
        times.append(perf_counter() - start)
    found[method] = blocks
    print(f"{method:<12} {1e6 * np.median(times):9.0f} us for all six blocks")


# Redundant rows contradict one another beside the constraints, so that differences by q mean
# something along them only; and lam is one of many.
J = cp.Workspace(legs).jacobian(q)
along = np.linalg.svd(J)[2][legs.rank(q).rank :].T


def apart(one: list[np.ndarray], two: list[np.ndarray]) -> float:
    """Return the largest difference of da_dq and da_dv along the constraints, and of da_dtau."""
    pairs = [(x @ along, y @ along) for x, y in zip(one[:2], two[:2], strict=True)]
    pairs.append((one[2], two[2]))
    return max(np.abs(x - y).max() / np.abs(x).max() for x, y in pairs)


print(f"kkt against pinocchio, repaired: {apart(found['kkt'], found['pinocchio']):.0e}")
print(f"kkt against differences:         {apart(found['kkt'], found['differences']):.0e}")

# Products, as optimal control and learning want them: no matrix is formed.
d = cp.derivatives(legs, q, v, tau)
rng = np.random.default_rng(1)
dq, dv, dtau, by_a = (rng.normal(size=cassie.nv) for _ in range(4))
by_lam = rng.normal(size=legs.rows)
da, dlam = d.jvp(dq, dv, dtau)
to_q, to_v, to_tau = d.vjp(by_a, by_lam)
forward = by_a @ da + by_lam @ dlam
backward = to_q @ dq + to_v @ dv + to_tau @ dtau
print(f"jvp and vjp are transposes of one another to {abs(forward / backward - 1):.0e}")

# `check=True` compares with differences itself, and raises with the worst entry if they disagree.
cp.derivatives(legs, q, v, tau, check=True)

# Constraints hold to first order: J da + dJ (...) = 0, of which the part by tau is J da/dtau = 0.
error = np.abs(J @ d.da_dtau).max() / np.abs(J).max() / np.abs(d.da_dtau).max()
print(f"J da_dtau = 0: relative error {error:.0e}")
