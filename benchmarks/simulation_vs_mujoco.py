"""The same linkages in MuJoCo and here: loop gap and energy error against time.

    python benchmarks/simulation_vs_mujoco.py [--quick]

Writes benchmarks/results/simulation_vs_mujoco.{json,png} and docs/results.md; with
--from-json the tables are made from the committed results, without running anything.

Both engines read one file (`Robot.to_mjcf`), start from one state, and are measured with one
reference, Pinocchio's: the largest gap and change of energy among samples every 16 ms. Energy is
conserved: nothing dissipates. Time is CPU time of the thread, the median over interleaved blocks
of steps; MuJoCo takes the steps of a block in one call of `mj_step`.
"""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from time import thread_time
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")

import marks
import numpy as np
from method_lines import Lines

import condyn_pin as cp
from condyn_pin._core._pin import pin
from condyn_pin._core.machine import machine
from condyn_pin.simulation.measures import gauge_of
from condyn_pin.simulation.outcome import Effects
from condyn_pin.simulation.passive import Passive
from condyn_pin.simulation.plan import plan
from condyn_pin.simulation.run import follow

ROOT = Path(__file__).resolve().parent.parent
RESULTS = ROOT / "benchmarks" / "results"

SAMPLED = 1.6e-2  # [s]
BLOCK = 0.01  # CPU seconds of a block, about [s]
LOST = 1.0  # a loop that is open by so much is no loop [m]


@dataclass(frozen=True)
class Row:
    """One way to simulate one linkage.

    `us` is CPU time per simulated millisecond [us]; gap [m], energy [J] and what happened.
    """

    problem: str
    engine: str
    method: str
    dt: float  # [s]
    violation: float  # [m]
    energy: float  # [J]
    us: float  # [us / ms]
    status: str

    @property
    def name(self) -> str:
        """Method and step."""
        return f"{self.method}, {1e3 * self.dt:g} ms"


@dataclass(frozen=True, eq=False)
class Problem:
    """A linkage that conserves energy, and a state that it starts from."""

    name: str
    scene: cp.Scene
    q: np.ndarray
    v: np.ndarray
    duration: float  # [s]

    def effects(self) -> Effects:
        """Return what acts: springs always, damping never."""
        return Effects(damping=False)

    def errors(self, Q: Sequence[np.ndarray], V: Sequence[np.ndarray]) -> tuple[float, float]:
        """Return the largest gap [m] and change of energy [J] among some states."""
        q, v = np.array(Q), np.array(V)
        if not (np.isfinite(q).all() and np.isfinite(v).all()):
            return np.inf, np.inf
        scene = self.effects().applied_to(self.scene)
        found = gauge_of(scene).measure(np.zeros(len(q)), q, v)  # nothing is driven
        energy = found.kinetic + found.potential + Passive.of(scene.robot).energy(q)
        return float(found.violation.max()), float(np.abs(energy - energy[0]).max())


def problems() -> tuple[Problem, ...]:
    """Return the four-bar for 2 s, and Cassie afloat without gravity on its springs for 1 s."""
    bar, cassie = cp.load_robot("four_bar"), cp.load_robot("cassie")
    model = pin.Model(cassie.model)
    model.gravity = pin.Motion.Zero()
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
            solver=None, record=record, effects=problem.effects(),
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

    chosen = whole.method.drift
    method = integrator.title if integrator.keeps_constraints else _title(integrator, chosen)
    return Row(
        problem.name, "condyn_pin", method, dt, gap, energy, 0.0, found.status.name.lower()
    ), block


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
            drifts = (
                cp.Baumgarte.critical(gain / dt),
                cp.simulation.PostStabilization(),
                cp.simulation.Projection(),
            )
            tried += [ours(problem, integrator, drift, dt) for drift in drifts]
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


def answer(rows: Sequence[Row], to: Row) -> Row | None:
    """Return our fastest way that is at least as accurate as one of MuJoCo, in gap and energy."""
    good = [
        row
        for row in rows
        if row.engine != "MuJoCo" and row.problem == to.problem and row.status == "finished"
        if row.violation <= to.violation and row.energy <= to.energy
    ]
    return min(good, key=lambda row: row.us, default=None)


def markdown(rows: Sequence[Row], about: dict[str, str]) -> str:
    """Return the whole table, and what it says: every way of MuJoCo with steps of 1 and 4 ms."""
    shown = [row for row in _theirs(rows) if row.dt in (1e-3, 4e-3)]
    lines = [
        "| linkage | MuJoCo | gap [m] | energy [J] | us/ms | condyn_pin, no less accurate | gap "
        "[m] | energy [J] | us/ms | x |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for row in shown:
        found = answer(rows, row)
        mine = "none | | | |"
        if found:
            mine = f"{found.name} | {found.violation:.0e} | {found.energy:.0e} | {found.us:.1f} |"
        lines.append(
            f"| {row.problem} | {row.name} | {row.violation:.0e} | {row.energy:.0e} "
            f"| {row.us:.1f} | "
            f"{mine} {_ratio(rows, row):.2f} |"
        )
    ratios: dict[str, list[float]] = {}
    for row in _theirs(rows):
        ratios.setdefault(row.problem, []).append(_ratio(rows, row))
    counts = ", ".join(
        f"{sum(r >= 1 for r in found)} of {len(found)} on {name} (x from {min(found):.2g} to "
        f"{max(found):.2g})"
        for name, found in ratios.items()
    )
    lines += [
        "",
        "us/ms: CPU time per simulated millisecond. x: MuJoCo's time over ours, at no larger gap "
        "and no larger energy error; **below 1 MuJoCo is ahead**, 0 where no setting of condyn_pin "
        "is as accurate. Of its points with steps from 0.5 to 16 ms condyn_pin is ahead at "
        f"{counts}.",
    ]
    where = (
        "`python benchmarks/simulation_vs_mujoco.py` on {processor} ({cores} cores, one thread), "
        "{system}, Python {python}, Pinocchio {pinocchio}, MuJoCo {mujoco}, {date}."
    )
    return "\n".join([*lines, where.format(**about)])


def _theirs(rows: Sequence[Row]) -> list[Row]:
    return [
        r for r in rows if r.engine == "MuJoCo" and r.status == "finished" and r.violation < LOST
    ]


def _ratio(rows: Sequence[Row], row: Row) -> float:
    """Return MuJoCo's time over ours at no larger errors; 0 where ours are all larger."""
    found = answer(rows, row)
    return row.us / found.us if found else 0.0


def pages(rows: Sequence[Row], about: dict[str, str]) -> dict[str, dict[str, str]]:
    """Return the block of docs/results.md."""
    return {marks.RESULTS: {"mujoco": markdown(rows, about)}}


# MuJoCo's ways, all without lines: colours of its constraints, and markers of its integrators.
_STIFFNESS = {"default": "#F0A000", "solref .005": "#D55E00", "solref .002": "#802000"}
_STEPS = {"Euler": "x", "RK4": "+", "implicitfast": "1"}


def _of_mujoco(method: str) -> dict[str, Any]:
    """Return how a way of MuJoCo is drawn, from 'integrator, constraints'."""
    integrator, _, constraints = method.partition(", ")
    colour = next(c for key, c in _STIFFNESS.items() if constraints.startswith(key))
    return {"color": colour, "marker": _STEPS[integrator], "ls": "", "ms": 7, "zorder": 3}


def draw(rows: Sequence[Row], path: Path) -> None:
    """Draw gap and energy error against time, a column a linkage."""
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    names = list(dict.fromkeys(row.problem for row in rows))
    lines = Lines(dict.fromkeys(row.method for row in rows if row.engine != "MuJoCo"))
    figure = Figure(figsize=(6 * len(names), 10), layout="constrained")
    places = figure.subplots(2, len(names), squeeze=False)
    for j, name in enumerate(names):
        kept = [r for r in rows if r.problem == name and r.status == "finished"]
        curves: dict[tuple[str, str], list[Row]] = {}
        for row in kept:
            curves.setdefault((row.engine, row.method), []).append(row)
        for i, (field, unit) in enumerate((("violation", "m"), ("energy", "J"))):
            ax = places[i, j]
            for (engine, method), points in curves.items():
                x = [row.us for row in points]
                y = [max(getattr(row, field), 1e-17) for row in points]
                ax.plot(x, y, **(_of_mujoco(method) if engine == "MuJoCo" else lines.of(method)))
            ax.set(xscale="log", yscale="log", title=f"{name}: {field} error [{unit}]")
            ax.set(xlabel="CPU time per simulated ms [us]", ylim=(None, LOST))
            ax.grid(visible=True, color="0.92")
    theirs = [
        Line2D([], [], label=f"MuJoCo {method}", **_of_mujoco(method))
        for method in dict.fromkeys(row.method for row in rows if row.engine == "MuJoCo")
    ]
    shown = theirs + lines.legend()
    figure.legend(handles=shown, loc="outside lower center", ncols=3, frameon=False, fontsize=8)
    figure.savefig(path, dpi=130)


def load(path: Path) -> tuple[list[Row], dict[str, str]]:
    """Return the rows that `main` wrote, and what they were taken on."""
    saved = json.loads(path.read_text(encoding="utf-8"))
    return [Row(**row) for row in saved["rows"]], saved["machine"]


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
