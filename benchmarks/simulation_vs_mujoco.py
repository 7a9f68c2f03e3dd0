"""The same linkages in MuJoCo and here: loop gap and energy error against time.

    python benchmarks/simulation_vs_mujoco.py [--quick]

Writes benchmarks/results/simulation_vs_mujoco.{json,png} and docs/results.md; with
--from-json the tables are made from the committed results, without running anything.

Both engines read one file (`Robot.to_mjcf`), start from one state, and are measured with one
reference, Pinocchio's: the largest gap and change of energy among samples every 16 ms. Energy is
conserved: nothing dissipates. Time is CPU time of one thread, the median over interleaved blocks
of steps; MuJoCo takes the steps of a block in one call of `mj_step`, and the compiled core, if it
is built, those of 32 equal motions in one call of `simulate_batch`.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import os
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from time import process_time, thread_time
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")

import marks
import numpy as np
from simulation_vs_mujoco_text import CORE, PYTHON, Row, draw, load, markdown, pages

import condyn_pin as cp
from condyn_pin._core._pin import pin
from condyn_pin._core.timing import machine
from condyn_pin.simulation.measures import gauge_of
from condyn_pin.simulation.plan import plan
from condyn_pin.simulation.run import follow
from condyn_pin.simulation.torques import Passive

ROOT = Path(__file__).resolve().parent.parent
RESULTS = ROOT / "benchmarks" / "results"

SAMPLED = 1.6e-2  # [s]
BLOCK = 0.01  # CPU seconds of a block, about [s]
MOTIONS = 32  # of a block of the compiled core, which is called once for all of them


@dataclass(frozen=True, eq=False)
class Problem:
    """A linkage that conserves energy, and a state that it starts from."""

    name: str
    scene: cp.Scene
    q: np.ndarray
    v: np.ndarray
    duration: float  # [s]

    def errors(self, Q: Sequence[np.ndarray], V: Sequence[np.ndarray]) -> tuple[float, float]:
        """Return the largest gap [m] and change of energy [J] among some states."""
        q, v = np.array(Q), np.array(V)
        if not (np.isfinite(q).all() and np.isfinite(v).all()):
            return np.inf, np.inf
        found = gauge_of(self.scene).measure(np.zeros(len(q)), q, v)  # nothing is driven
        energy = found.kinetic + found.potential + Passive.of(self.scene.robot).energy(q)
        return float(found.violation.max()), float(np.abs(energy - energy[0]).max())


def problems() -> tuple[Problem, ...]:
    """Return the four-bar for 2 s, and Cassie afloat on its springs without damping for 1 s."""
    bar, cassie = cp.load_robot("four_bar"), cp.load_robot("cassie")
    model = pin.Model(cassie.model)
    model.gravity = pin.Motion.Zero()
    model.damping[:] = 0.0
    cassie = replace(cassie, model=model)
    closed, legs = cp.Scene(bar, bar.loops), cp.Scene(cassie, cassie.loops)
    q, _ = legs.state()
    v = cp.mechanism.project_velocity(legs, q, np.random.default_rng(0).normal(size=cassie.nv))
    kinetic = 0.5 * v @ cp.Workspace(legs).terms(q, v).M @ v
    return (
        Problem("four_bar", closed, *closed.state(), duration=2.0),
        Problem("cassie", legs, q, v * np.sqrt(2.0 / kinetic), duration=1.0),
    )


Block = Callable[[], float]  # CPU time per simulated millisecond [us]


def ours(problem: Problem, integrator: Any, drift: Any, dt: float) -> tuple[Row, Block] | None:
    """Run a method of this library; return its errors and how to time it."""

    def planned(duration: float, record: int) -> Any:
        return plan(
            problem.scene, 0.0, duration=duration, dt=dt, integrator=integrator, drift=drift,
            solver=None, record=record,
        )  # fmt: skip

    whole = planned(problem.duration, max(round(SAMPLED / dt), 1))
    begun = thread_time()
    try:
        found, phase = follow(whole, problem.q, problem.v)
    except cp.errors.StepFailed as failed:
        print(f"{problem.name}: not even the first step: {failed}")
        return None
    step = (thread_time() - begun) / max(found.t[-1] / dt, 1)
    gap, energy = problem.errors(found.q, found.v)
    steps = max(int(BLOCK / step), 5)
    part = planned(steps * dt, steps)

    def block() -> float:
        nonlocal phase
        begun = thread_time()
        _, phase = follow(part, problem.q, problem.v, phase=phase)
        return 1e3 * (thread_time() - begun) / (steps * dt)

    chosen = whole.drift
    method = integrator.title if integrator.keeps_constraints else _title(integrator, chosen)
    return Row(problem.name, PYTHON, method, dt, gap, energy, 0.0, found.status.name.lower()), block


def compiled(problem: Problem, integrator: Any, drift: Any, dt: float) -> tuple[Row, Block] | None:
    """Run a method by the compiled core; None if it breaks down, as it does in Python too."""
    core, every = cp.Native(threads=1), max(round(SAMPLED / dt), 1)

    def run(motions: int, duration: float, record: int | None = None) -> Any:
        return cp.simulate_batch(
            problem.scene, np.tile(problem.q, (motions, 1)), np.tile(problem.v, (motions, 1)),
            duration=duration, dt=dt, integrator=integrator, drift=drift, record=record,
            executor=core,
        )  # fmt: skip

    found = run(1, problem.duration, every)
    if not found.ok:
        return None
    gap, energy = problem.errors(found.samples.q[0], found.samples.v[0])
    begun = process_time()
    run(MOTIONS, 8 * dt)
    steps = 8 * max(round(10 * BLOCK / (process_time() - begun)), 1)

    def block() -> float:
        begun = process_time()
        run(MOTIONS, steps * dt)
        return 1e3 * (process_time() - begun) / (MOTIONS * steps * dt)

    row = Row(problem.name, CORE, _title(integrator, drift), dt, gap, energy, 0.0, "finished")
    return row, block


def _title(integrator: Any, drift: Any) -> str:
    explicit = getattr(integrator, "implicit", None) is False
    return f"{integrator.title}{', explicit springs' if explicit else ''}, {drift.title}"


def theirs(problem: Problem, setting: str, integrator: str, dt: float) -> tuple[Row, Block]:
    """Run MuJoCo; return its errors and how to time it."""
    import mujoco
    from mujoco_twin import Twin

    twin = Twin.of(problem.scene.robot, setting, integrator, dt, conservative=True)
    twin.set(problem.q, problem.v)
    every, Q, V = max(round(SAMPLED / dt), 1), [problem.q], [problem.v]
    begun = thread_time()
    for _ in range(round(problem.duration / (every * dt))):
        mujoco.mj_step(twin.model, twin.data, every)
        q, v = twin.state()
        Q.append(q)
        V.append(v)
    step = (thread_time() - begun) * dt / problem.duration
    gap, energy = problem.errors(Q, V)
    warned = any(warning.number for warning in twin.data.warning)
    steps = max(int(BLOCK / step), 5)

    def block() -> float:
        twin.set(problem.q, problem.v)
        begun = thread_time()
        mujoco.mj_step(twin.model, twin.data, steps)
        return 1e3 * (thread_time() - begun) / (steps * dt)

    said = "diverged" if warned else "finished"
    return Row(
        problem.name, "MuJoCo", f"{integrator}, {setting}", dt, gap, energy, 0.0, said
    ), block


def candidates(problem: Problem, *, quick: bool) -> list[tuple[Row, Block]]:
    """Run everything once for its errors."""
    from mujoco_twin import INTEGRATORS, SETTINGS

    steps = (1e-3,) if quick else (5e-4, 1e-3, 2e-3, 4e-3, 8e-3, 1.6e-2)
    slow = (8e-3,) if quick else (4e-3, 8e-3, 1.6e-2)
    has_core = importlib.util.find_spec("condyn_pin_native") is not None
    semi, springs = cp.SemiImplicitEuler(implicit=False), cp.SemiImplicitEuler()
    eulers = (semi, springs) if problem.scene.robot.springs else (semi,)
    tried = [
        theirs(problem, setting, integrator, dt)
        for setting in SETTINGS
        for integrator in INTEGRATORS
        for dt in steps
    ]
    second = (cp.simulation.Leapfrog(), cp.simulation.LinearlyImplicitMidpoint())
    for integrator in (*eulers, *second, cp.RungeKutta4()):
        gain = 0.03 if integrator.order.q > 2 else 0.3
        for dt in steps:
            drifts = cp.Baumgarte.critical(gain / dt), cp.simulation.PostStabilization()
            tried += [ours(problem, integrator, drift, dt) for drift in drifts]
            tried.append(ours(problem, integrator, cp.simulation.Projection(), dt))
            if has_core and not isinstance(integrator, cp.simulation.Leapfrog):
                tried += [compiled(problem, integrator, drift, dt) for drift in drifts]
    for integrator in (cp.simulation.Rattle(), cp.simulation.GearGuptaLeimkuhler()):
        tried += [ours(problem, integrator, cp.simulation.NoDrift(), dt) for dt in slow]
    return [each for each in tried if each]


def measure(*, quick: bool = False) -> list[Row]:
    """Return all rows, with times from interleaved blocks."""
    rows = []
    for problem in problems():
        tried = candidates(problem, quick=quick)
        times: list[list[float]] = [[] for _ in tried]
        for r in range(3 if quick else 5):
            for i in np.roll(np.arange(len(tried)), r * 7):
                times[i].append(tried[i][1]())
        for (row, _), samples in zip(tried, times, strict=True):
            rows.append(Row(**asdict(row) | {"us": float(np.median(samples))}))
    return rows


def main() -> None:
    """Run, write, and update the docs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="one step size, nothing is written")
    parser.add_argument("--from-json", action="store_true", help="do not run, only rewrite")
    given = parser.parse_args()
    path = RESULTS / "simulation_vs_mujoco.json"
    if given.from_json:
        rows, about = load(path)
    else:
        import mujoco

        mujoco.set_mju_user_warning(lambda text: None)  # what diverges is a row that says so
        rows, about = measure(quick=given.quick), machine() | {"mujoco": mujoco.__version__}
    print(markdown(rows, about))
    if given.quick:
        return
    saved = {"machine": about, "rows": [asdict(row) for row in rows]}
    text = json.dumps(saved, indent=1, default=float).replace("Infinity", "1e999")
    path.write_text(text + "\n", encoding="utf-8")
    draw(rows, RESULTS / "simulation_vs_mujoco.png")
    marks.write(pages(rows, about))


if __name__ == "__main__":
    main()
