"""Model only what a scene requires: Talos without arms, smaller models of Cassie, and their price.

python examples/11_simplify.py
"""

import sys
from pathlib import Path

import numpy as np

import condyn_pin as cp

sys.path.append(str(Path(__file__).parents[1] / "benchmarks"))  # smaller models, measured
import lab

quick = "--quick" in sys.argv
talos = cp.load_robot("talos")
stance = cp.Scene(talos, talos.contacts)

# Arms, grippers and head do not move in this question: locked, they are mass alone. That is exact,
# and the constraints come along.
still = [joint for joint in talos.joints if joint.startswith(("arm", "gripper", "head"))]
small = stance.lock(still)
print(f"nv {stance.robot.nv} -> {small.robot.nv}, {len(still)} joints locked\n")

# Residuals: make the whole robot keep those joints still by welding them, and compare.
q, v = stance.state("half_sitting")
tau = np.zeros(talos.nv)
q_small, v_small = small.reduce_state(q, v)
a_small = cp.solve(
    small, q_small, v_small, small.reduce_torque(tau), solver=cp.dynamics.Reference()
).a
terms = cp.Workspace(stance).terms(q, v)
held = [talos.index_v(joint) for joint in still]
J = np.vstack([terms.J, np.eye(talos.nv)[held]])  # feet, and every locked joint
right = np.concatenate([-terms.gamma, np.zeros(len(held))])
zero = np.zeros((len(J), len(J)))
kkt = np.block([[terms.M, -J.T], [J, zero]])
a = np.linalg.solve(kkt, np.concatenate([tau - terms.h, right]))[: talos.nv]
kept = [i for i in range(talos.nv) if i not in held]
error = np.abs(a[kept] - a_small).max() / np.abs(a_small).max()

# What is not exact has a price, and it is measured: four-bars of Cassie's legs, model by model.
if not quick:
    print(lab.model_hierarchy("cassie"), "\n")

# Or let it be searched: the smallest scene that answers within an error, judged at other states.
bar = cp.model.four_bar()
linkage = cp.Scene(bar, bar.loops)
print(linkage.minimal(error=0.0, solver=cp.DenseKKT()), "\n")
print(f"locked against welded: relative error {error:.0e}")
