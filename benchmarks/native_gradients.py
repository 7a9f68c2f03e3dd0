"""Derivatives of steps with contacts by the compiled core beside Python.

    python benchmarks/native_gradients.py [--quick]

Writes benchmarks/results/native_gradients.json and docs/how-to-run-at-scale.md; with --from-json
the table is made from the committed results, without running anything.

An arm of seven joints presses its hand on a table, sticks or slides there; a humanoid stands on
the corners of its soles, or on one point a foot. States nearby are stepped and differentiated in
batches, by the core and by Python in turns, in one process and one thread, by processor time; a
figure is the median over the rounds. The error is the largest difference of an entry, relative to
the largest of its matrix. Le Lidec and others (arXiv 2409.07107) report 5 us for the derivatives
of a step of an arm with 7 degrees of freedom and 95 us for a humanoid with 36, on their machine.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

import marks
import numpy as np
import script
from native_core import turns, where

import condyn_pin as cp
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.compiled import compiled
from condyn_pin.constraints import Ball, Plane
from condyn_pin.contact import SemismoothNewton
from condyn_pin.gradients import BatchStepDerivatives, step_derivatives_batch
from condyn_pin.model.smaller import lock_joints
from condyn_pin.simulation.records import candidates_of
from condyn_pin.stepping import step_batch

JSON = marks.ROOT / "benchmarks" / "results" / "native_gradients.json"
PAGE = "docs/how-to-run-at-scale.md"
DT = 1e-3  # [s]
BY = cp.StewartTrinkle(contact=SemismoothNewton())
SUNK = 1e-4  # how deep contacts are where steps begin: no gap is about to open [m]
BLOCKS = ("dq_dq", "dq_dv", "dq_dtau", "dv_dq", "dv_dv", "dv_dtau")


@dataclass(frozen=True)
class Row:
    """A scene.

    Attributes
    ----------
    scene : str
    nv, rows : int
        Degrees of freedom, and rows of its contacts.
    step, both : float
        Time of a step, and of one with its derivatives, by the core [s].
    python : float
        Time of a step with its derivatives by Python [s].
    error : float
        Of the derivatives of the core against Python's [1].
    left : int
        Steps that the core leaves to Python, of `count`.
    count : int
    """

    scene: str
    nv: int
    rows: int
    step: float
    both: float
    python: float
    error: float
    left: int
    count: int


@dataclass(frozen=True)
class States:
    """A scene, and states of it with the torques applied."""

    scene: cp.Scene
    Q: Array
    V: Array
    TAU: Array


def arm(count: int, speed: float) -> States:
    """Return Panda, its fingers locked, its hand on a table that it presses on."""
    its = cp.load_robot("panda", variant={"fingers": "free"})
    its = lock_joints(its, ["panda_finger_joint1", "panda_finger_joint2"])
    q = its.postures["default"] if "default" in its.postures else pin.neutral(its.model)
    data = its.model.createData()
    pin.framesForwardKinematics(its.model, data, q)
    tip = data.oMf[its.model.getFrameId("panda_hand_tcp")].translation
    table = Plane(height=float(tip[2]) - 0.01 + SUNK)
    hand = cp.FrictionalContact("panda_hand_tcp", Ball(0.01), on=table, friction=0.5)
    scene = cp.Scene(its, contacts=[hand])
    J = pin.computeFrameJacobian(
        its.model, data, q, its.model.getFrameId("panda_hand_tcp"), pin.LOCAL_WORLD_ALIGNED
    )[:3]
    along = np.linalg.pinv(J)[:, 0] * speed
    held = pin.computeGeneralizedGravity(its.model, data, q) - 20.0 * J[2]  # [N m], 20 N down
    rng = np.random.default_rng(0)
    V = along + rng.normal(scale=1e-4, size=(count, its.nv))
    return States(scene, np.tile(q, (count, 1)), V, np.tile(held, (count, 1)))


def humanoid(count: int, corners: bool) -> States:
    """Return Talos on its feet, under the torques that hold it."""
    its = cp.load_robot("talos")
    contacts = its.frictional_contacts(0.7) if corners else [
        cp.FrictionalContact(each.frame, Ball(0.01), friction=0.7)
        for each in its.contacts
    ]  # fmt: skip
    scene = cp.Scene(its, contacts=contacts)
    q = scene.state()[0].copy()
    gaps = cp.dynamics.contact_gaps(scene, q).values()
    q[2] -= min(gaps) if corners else max(gaps) + SUNK
    held = cp.Scene(its, its.contacts)
    tau = cp.inverse_dynamics(held, q, np.zeros(its.nv), np.zeros(its.nv)).tau
    if corners:  # soles settle on all of them
        q = cp.simulate(scene, q, np.zeros(its.nv), tau, duration=0.1, dt=DT).q[-1]
    V = np.random.default_rng(0).normal(scale=0.01, size=(count, its.nv))
    V = np.array([cp.mechanism.project_velocity(held, q, each) for each in V])  # feet at rest
    return States(scene, np.tile(q, (count, 1)), V, np.tile(tau, (count, 1)))


SCENES: dict[str, Callable[[int], States]] = {
    "arm, sticks": partial(arm, speed=0.0),
    "arm, slides": partial(arm, speed=0.3),
    "humanoid, a point a foot": partial(humanoid, corners=False),
    "humanoid, corners of soles": partial(humanoid, corners=True),
}


def differentiated(at: States, executor: Any) -> BatchStepDerivatives:
    """Return the derivatives of all steps."""
    found = step_derivatives_batch(
        at.scene, at.Q, at.V, at.TAU, dt=DT, integrator=BY, executor=executor
    )
    assert found.ok, found.reasons
    return found


def error(found: BatchStepDerivatives, wanted: BatchStepDerivatives) -> float:
    """Return the largest difference, relative to the largest entry of each matrix."""
    worst = 0.0
    for block in BLOCKS:
        one, two = getattr(found, block), getattr(wanted, block)
        sizes = np.abs(two).max(axis=(1, 2))
        worst = max(worst, float((np.abs(one - two).max(axis=(1, 2)) / sizes).max()))
    return worst


def left_to_python(at: States) -> int:
    """Return how many steps the core leaves."""
    from condyn_pin.dynamics.verbs import workspace_for
    from condyn_pin.gradients.routes.batch import DifferentiatedRows, kinds_of

    count = len(at.Q)
    kinds = {name: kind.times(count) for name, kind in kinds_of(at.scene, ()).items()}
    outputs = {name: np.zeros(kind.shape, kind.dtype) for name, kind in kinds.items()}
    rows = DifferentiatedRows(tuple(at.scene.contacts), DT, BY)
    inputs = {"q0": at.Q, "v0": at.V, "tau0": at.TAU}
    workspace = workspace_for(at.scene.bilateral, None, None)
    return len(rows(workspace, inputs, outputs, 1))


def measure(rounds: int, count: int) -> dict[str, Any]:
    """Return everything."""
    rows, core = [], cp.Native(threads=1)
    for name, make in SCENES.items():
        at, few = make(count), make(4)
        calls = {
            "step": partial(
                step_batch, at.scene, at.Q, at.V, at.TAU, dt=DT, integrator=BY, executor=core
            ),
            "both": partial(differentiated, at, core),
            "python": partial(differentiated, few, None),
        }
        times = turns(calls, rounds)
        wrong = error(differentiated(few, core), differentiated(few, None))
        spent = times["step"] / count, times["both"] / count, times["python"] / len(few.Q)
        sizes = at.scene.robot.nv, candidates_of(at.scene).rows
        rows.append(Row(name, *sizes, *spent, wrong, left_to_python(at), count))
    known = {"headers": compiled().pinocchio, "simd": compiled().simd}
    return {"rows": [asdict(row) for row in rows], "core": known}


def table(saved: dict[str, Any]) -> str:
    """Return the table."""
    lines = [
        "| a step of 1 ms, `ActiveSet` | dof | rows | step [us] | and derivatives [us] | "
        "derivatives alone [us] | Python, both [us] | x Python | error | left |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for each in saved["rows"]:
        row = Row(**each)
        lines.append(
            f"| {row.scene} | {row.nv} | {row.rows} | {1e6 * row.step:.1f} | "
            f"{1e6 * row.both:.1f} | {1e6 * (row.both - row.step):.1f} | "
            f"{1e6 * row.python:.0f} | {row.python / row.both:.0f} | {row.error:.0e} | "
            f"{row.left} of {row.count} |"
        )
    return "\n".join([*lines, "", where(saved, "native_gradients")])


def pages(saved: dict[str, Any]) -> dict[str, dict[str, str]]:
    """Return the blocks of the page."""
    return {PAGE: {"core-gradients": table(saved)}}


def main(words: Sequence[str] | None = None) -> None:
    """Run, write, and update the docs."""
    script.run(
        words, about=__doc__, quick="few rounds; nothing is written", path=JSON,
        measure=lambda given: measure(*(3, 100) if given.quick else (9, 2000)), table=table,
        pages=pages,
    )  # fmt: skip


if __name__ == "__main__":
    main()
