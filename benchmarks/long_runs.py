"""Long runs: whether loops stay closed and memory stays flat; write results/long_runs.{json,md}.

    python benchmarks/long_runs.py [--steps 1000000] [--only "cassie, Baumgarte"]

A four-bar falls from rest and swings on without friction, and Cassie hangs by the pelvis, its
motors pushed to and fro against springs and damping; both by `RungeKutta4` at 1 ms, with each of
three drift schemes. The four-bar once more by `Rattle`, and a point mass on a rod at 10 ms: their
energy has to swing as far in the last tenth of the run as in the first. Lines that were measured
before are kept.
"""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

import condyn_pin as cp
from condyn_pin._core.timing import machine
from condyn_pin.simulation.integrators import Integrator
from lab.drift import rod_pendulum

RESULTS = Path(__file__).resolve().parent / "results"
STEPS = 1_000_000
DT = 1e-3  # [s]
RK4 = cp.RungeKutta4()
LOOK = 100  # steps between two samples
PUSH, STIFFNESS = 10.0, 100.0  # [N m], [N m/rad]

# What a gap may be [m, rad]: by Rattle, with a correction after each step, and with gains alone.
KEPT, CORRECTED, BY_GAINS = 1e-13, 1e-8, 1e-5

# How far the energy of Rattle may swing in the last tenth, beside the first.
SAME = 1e-2


@dataclass(frozen=True)
class Plan:
    """What is run."""

    name: str
    scene: cp.Scene
    drift: cp.simulation.Drift
    integrator: Integrator = RK4
    dt: float = DT  # [s]

    @property
    def label(self) -> str:
        """Name, and how the constraints are kept."""
        keeper = self.integrator if self.integrator.keeps_constraints else self.drift
        return f"{self.name}, {type(keeper).__name__}"

    @property
    def allowed(self) -> float:
        """What a gap may be [m, rad]."""
        if self.integrator.keeps_constraints:
            return KEPT
        return BY_GAINS if isinstance(self.drift, cp.Baumgarte) else CORRECTED


@dataclass(frozen=True)
class LongRun:
    """One run.

    Attributes
    ----------
    name : str
        Of the scene, and how its constraints are kept.
    steps : int
    dt : float
        [s]
    status : str
        How it ended.
    violation, constraint_velocity : float
        The largest of all samples [m, rad], [m/s, rad/s].
    allowed : float
        What the gap may be [m, rad].
    energy_error : float or None
        The largest that came or went without work, relative to what was exchanged; None with
        damping, whose work the samples are too far apart for.
    early, late : float or None
        The same in the first tenth of the run, and in the last.
    fastest : float
        Largest velocity [rad/s, m/s].
    memory : float
        Growth of the process over the last nine tenths of the run [MB].
    samples : float
        How much of that its samples take [MB].
    step_us : float
        Time of a step, on a machine that others used too [us].
    """

    name: str
    steps: int
    dt: float
    status: str
    violation: float
    constraint_velocity: float
    allowed: float
    energy_error: float | None
    early: float | None
    late: float | None
    fastest: float
    memory: float
    samples: float
    step_us: float

    @property
    def is_good(self) -> bool:
        """Whether it went to its end, closed all the way, in the memory that it began with.

        By Rattle, also whether its energy swings as it did.
        """
        whole = self.status == "FINISHED" and self.memory - self.samples < 10.0
        kept = self.allowed > KEPT or (
            self.early and self.late and self.late < self.early * (1 + SAME)
        )
        return whole and bool(kept) and self.violation < self.allowed


def plans() -> Iterator[Plan]:
    """Yield every run."""
    bar, cassie = cp.load_robot("four_bar"), cp.load_robot("cassie")
    hanging = [*cassie.loops, cp.SurfaceContact("pelvis")]
    scenes = {"four_bar": cp.Scene(bar, bar.loops), "cassie hanging": cp.Scene(cassie, hanging)}
    for name, scene in scenes.items():
        for drift in (
            cp.simulation.PostStabilization(),
            cp.Baumgarte(20.0, 20.0),
            cp.simulation.Projection(),
        ):
            yield Plan(name, scene, drift)
    yield Plan("four_bar", scenes["four_bar"], cp.simulation.NoDrift(), cp.simulation.Rattle())
    yield Plan(
        "rod pendulum", rod_pendulum(), cp.simulation.NoDrift(), cp.simulation.Rattle(), 1e-2
    )


def servos(scene: cp.Scene) -> Callable[[float, np.ndarray, np.ndarray], np.ndarray]:
    """Return torques that hold every motor near its place, and push it to and fro."""
    joints = [
        scene.robot.model.joints[scene.robot.model.getJointId(n)] for n in scene.robot.actuated
    ]
    at, along = [j.idx_q for j in joints], [j.idx_v for j in joints]
    place = scene.state()[0][at]
    rates = 2 * np.pi * np.linspace(0.3, 0.9, len(joints))  # [rad/s]
    tau = np.zeros(scene.robot.nv)

    def servo(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        tau[along] = PUSH * np.sin(rates * t) - STIFFNESS * (q[at] - place)
        return tau

    return servo


def long_run(plan: Plan, steps: int) -> LongRun:
    """Run a scene from its nominal state, at rest."""
    scene, dt = plan.scene, plan.dt
    q, v = scene.state()
    damped = bool(np.any(scene.robot.model.damping))
    grown, watch = _memory()
    run = cp.simulate(
        scene, q, v, servos(scene) if damped else 0.0, duration=steps * dt, dt=dt,
        integrator=plan.integrator, drift=plan.drift, record=LOOK, progress=watch,
    )  # fmt: skip
    error = np.abs(run.energy.error) / run.energy.scale
    tenth = max(len(run) // 10, 1)
    errors = [float(part.max()) for part in (error, error[:tenth], error[-tenth:])]
    energy_error, early, late = [None] * 3 if damped else errors
    return LongRun(
        name=plan.label,
        steps=steps,
        dt=dt,
        status=run.status.name,
        violation=float(run.violation.max()),
        constraint_velocity=float(run.constraint_velocity.max()),
        allowed=plan.allowed,
        energy_error=energy_error,
        early=early,
        late=late,
        fastest=float(np.abs(run.v).max()),
        memory=grown(),
        samples=0.9e-6 * sum(x.nbytes for x in (run.t, run.q, run.v, run.a, run.lam, run.tau)),
        step_us=1e6 * run.run.wall_time / steps,
    )


def _memory() -> tuple[Callable[[], float], Callable[[float], None]]:
    """Return how far memory has grown since a tenth of a run [MB], and what watches it."""
    seen: list[float] = []

    def watch(share: float) -> None:
        if share >= 0.1:
            pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
            seen.append(pages * os.sysconf("SC_PAGE_SIZE") / 1e6)

    return lambda: seen[-1] - seen[0], watch


def markdown(runs: list[LongRun], where: dict[str, Any]) -> str:
    """Return the runs as a table."""
    lines = [
        f"Runge-Kutta 4 or RATTLE, gaps at every {LOOK}th step; "
        "energy errors are shares of what is exchanged.",
        "",
        "| run | dt [ms] | steps | gap [m, rad] | allowed | slip [m/s, rad/s] | energy error |"
        " first tenth | last tenth | memory [MB] | of it samples | us a step |",
        "|---" * 12 + "|",
    ]
    for run in runs:
        energy, early, late = (
            "" if x is None else f"{x:.{digits}e}"
            for x, digits in ((run.energy_error, 1), (run.early, 3), (run.late, 3))
        )
        ending = "" if run.status == "FINISHED" else f" ({run.status.lower()})"
        lines.append(
            f"| {run.name}{ending} | {1e3 * run.dt:g} | {run.steps} | {run.violation:.1e} "
            f"| {run.allowed:g} | {run.constraint_velocity:.1e} | {energy} | {early} | {late} "
            f"| {run.memory:+.1f} | {run.samples:.1f} | {run.step_us:.0f} |"
        )
    text = "{processor}, {system}, Python {python}, Pinocchio {pinocchio}, {date}."
    return "\n".join([*lines, "", text.format(**where), ""])


def main() -> int:
    """Run, write after each run, and say whether all are good."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=STEPS)
    parser.add_argument("--only", default="", help="what the name of a run has to contain")
    arguments = parser.parse_args()
    bad = 0
    for plan in plans():
        if arguments.only not in plan.label:
            continue
        run = long_run(plan, arguments.steps)
        bad |= not run.is_good
        print(run, flush=True)
        path = RESULTS / "long_runs.json"
        old = json.loads(path.read_text(encoding="utf-8"))["runs"] if path.exists() else []
        runs = {each.name: each for each in (*(LongRun(**fields) for fields in old), run)}
        order = [each.label for each in plans()]
        kept = [runs[label] for label in order if label in runs]
        report = {"machine": machine(), "runs": [asdict(each) for each in kept]}
        path.write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")
        (RESULTS / "long_runs.md").write_text(markdown(kept, machine()), encoding="utf-8")
    return bad


if __name__ == "__main__":
    raise SystemExit(main())
