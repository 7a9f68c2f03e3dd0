"""Time derivatives on Talos, two feet: ours against Pinocchio's own and central differences.

python benchmarks/derivatives.py
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

import condyn_pin as cp
from condyn_pin._pin import HAS_LCABA, pin
from condyn_pin.catalogue import motor_torque
from condyn_pin.differentiation.kkt import KktDerivatives
from condyn_pin.machine import machine
from condyn_pin.timing import interleaved


def main() -> None:
    """Print times and ratios."""
    talos = cp.load_robot("talos")
    scene, rng = cp.Scene(talos, talos.contacts), np.random.default_rng(0)
    state = (*scene.sample(rng), motor_torque(talos, rng))
    workspace = cp.Workspace(scene, cp.Proximal())
    fastest = cp.Workspace(scene, cp.LCABA() if HAS_LCABA else cp.Proximal())
    solution, ones = workspace.solve(*state), np.ones(talos.nv)
    model, data = workspace.model, workspace.data
    models, datas = workspace.constraint_models, workspace.constraint_datas
    settings = workspace.proximal_settings

    def of(v: np.ndarray, tau: np.ndarray) -> KktDerivatives:
        return KktDerivatives(workspace, solution, v, tau)

    times = interleaved(
        {
            "pinocchio": lambda q, v, tau: pin.computeConstraintDynamicsDerivatives(
                model, data, models, datas, settings
            ),
            "kkt": lambda q, v, tau: of(v, tau).da_dq,
            "jvp": lambda q, v, tau: of(v, tau).jvp(ones, ones, ones),
            "solve": workspace.solve,
            "fastest acceleration": fastest.acceleration,
        },
        [state],
        rounds=200,
        repeats=30,
    )
    print("{processor}, Python {python}, Pinocchio {pinocchio}, {date}".format(**machine()))
    for name, time in times.items():
        print(f"{name:<22} {time.median:7.1f} us")
    kkt, calls = times["kkt"], 2 * 3 * talos.nv
    print(f"kkt / pinocchio          {kkt.ratio(times['pinocchio']):.2f}")
    print(f"jvp / solve              {times['jvp'].ratio(times['solve']):.2f}")
    print(f"{calls} accelerations / kkt {calls * times['fastest acceleration'].ratio(kkt):.0f}")


if __name__ == "__main__":
    main()
