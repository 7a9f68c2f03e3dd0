"""Time derivatives: on Talos, two feet, ours against Pinocchio's own and central differences.

And on closed chains and feet of points: a solve with its proof and derivatives, against
Pinocchio's dynamics and derivatives, with how far da_dq is from central differences. Pinocchio's
have those of the forces in them; ours form these when they are asked for.

python benchmarks/derivatives.py
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

from timeit import repeat

import numpy as np

import condyn_pin as cp
from condyn_pin._core._pin import HAS_LCABA, pin
from condyn_pin._core.timing import interleaved, machine
from condyn_pin.dynamics.derivatives.kkt import KktDerivatives
from condyn_pin.dynamics.scene import motor_torque


def main() -> None:
    """Print times and ratios."""
    talos = cp.load_robot("talos")
    scene, rng = cp.Scene(talos, talos.contacts), np.random.default_rng(0)
    state = (*scene.sample(rng), motor_torque(talos, rng))
    workspace = cp.Workspace(scene, cp.Proximal())
    fastest = cp.Workspace(scene, cp.LCABA() if HAS_LCABA else cp.Proximal())
    solution = workspace.solve(*state)

    def of(v: np.ndarray, tau: np.ndarray) -> KktDerivatives:
        return KktDerivatives(workspace, solution, v, tau)

    print("{processor}, Python {python}, Pinocchio {pinocchio}, {date}".format(**machine()))
    beside_solves(workspace, fastest, state, of)
    beside_differences(workspace.model, fastest, state, of)
    for name, held in (("four_bar", False), ("cassie", False), ("cassie", True), ("solo12", True)):
        on_chains(cp.load_robot(name), held)


def on_chains(robot, held) -> None:
    """Print what derivatives of a robot cost, with its contacts or with its loops alone."""
    scene = cp.Scene(robot, [*robot.loops, *(robot.contacts if held else [])])
    rng = np.random.default_rng(0)
    state = (*scene.sample(rng), motor_torque(robot, rng))
    workspace, bare = cp.Workspace(scene, cp.Proximal()), cp.Workspace(scene, cp.Proximal())
    model, data = bare.model, bare.data
    args = (bare.constraint_models, bare.constraint_datas, bare.proximal_settings)

    def pinocchio():
        pin.constraintDynamics(model, data, *state, *args)
        pin.computeConstraintDynamicsDerivatives(model, data, *args)

    def ours():
        d = workspace.derivatives(*state)
        return d.da_dq, d.da_dv, d.da_dtau

    def of_forces_too():
        d = workspace.derivatives(*state)
        return d.da_dq, d.da_dv, d.da_dtau, d.dlam_dq, d.dlam_dv, d.dlam_dtau

    of_pinocchio, of_ours, of_both = least_in_turns((pinocchio, ours, of_forces_too))
    numeric = cp.derivatives(scene, *state, method="differences")
    da_dq = workspace.derivatives(*state).da_dq @ numeric.along.T
    error = np.abs(da_dq - numeric.da_dq @ numeric.along.T).max() / np.abs(da_dq).max()
    print(
        f"{robot.name}, {scene.rows:2} rows: Pinocchio {of_pinocchio:6.1f} us, "
        f"ours {of_ours:6.1f} us, {of_ours / of_pinocchio:5.2f} x, error {error:.0e}; "
        f"with those of the forces {of_both:6.1f} us, {of_both / of_pinocchio:5.2f} x"
    )


def least_in_turns(functions) -> list[float]:
    """Return the least times of functions that take turns [us]: a busy machine only adds."""
    turns = [[min(repeat(f, number=5, repeat=40)) for f in functions] for _ in range(10)]
    return [1e6 / 5 * min(times) for times in zip(*turns, strict=True)]


def beside_solves(workspace, fastest, state, of) -> None:
    """Print the times of the derivatives, of Pinocchio's own and of a solve."""
    model, data, ones = workspace.model, workspace.data, np.ones(workspace.model.nv)
    models, datas = workspace.constraint_models, workspace.constraint_datas
    settings = workspace.proximal_settings
    times = interleaved(
        {
            "pinocchio": lambda q, v, tau: pin.computeConstraintDynamicsDerivatives(
                model, data, models, datas, settings
            ),
            "kkt": lambda q, v, tau: of(v, tau).da_dq,
            "jvp": lambda q, v, tau: of(v, tau).jvp(ones, ones, ones),
            "solve": workspace.solve,
            "fastest acceleration": fastest.acceleration,
            "fastest solve": fastest.solve,
        },
        [state],
        rounds=200,
        repeats=30,
    )
    for name, time in times.items():
        print(f"{name:<22} {time.median:7.1f} us")
    print(f"kkt / pinocchio          {times['kkt'].ratio(times['pinocchio']):.2f}")
    print(f"jvp / solve              {times['jvp'].ratio(times['solve']):.2f}")


def beside_differences(model, fastest, state, of) -> None:
    """Print the times of central differences over those of the derivatives."""
    for what, f in (
        ("of a and lam, solve", lambda *at: np.concatenate(_answer(fastest.solve(*at)))),
        ("of a, acceleration", fastest.acceleration),
    ):
        pair = interleaved(
            {
                "kkt": lambda q, v, tau: of(v, tau).da_dq,
                "differences": lambda q, v, tau, f=f: central(model, f, q, v, tau),
            },
            [state],
            rounds=30,
            repeats=1,
        )
        ratio = pair["differences"].ratio(pair["kkt"])
        print(f"central differences {what}: {pair['differences'].median:.0f} us, {ratio:.0f} x kkt")


def central(model, f, q, v, tau, h=1e-6):
    """Return the derivatives of f by q, v and tau: two calls a column, as users write it."""
    steps = h * np.eye(model.nv)
    columns = [
        f(pin.integrate(model, q, s), v, tau) - f(pin.integrate(model, q, -s), v, tau)
        for s in steps
    ]
    columns += [f(q, v + s, tau) - f(q, v - s, tau) for s in steps]
    columns += [f(q, v, tau + s) - f(q, v, tau - s) for s in steps]
    return np.column_stack(columns) / (2 * h)


def _answer(solution):
    return solution.a, solution.lam


if __name__ == "__main__":
    main()
