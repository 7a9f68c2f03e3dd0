"""Motions that are looked at all the way: limp robots that fall, and a million steps.

    python benchmarks/runs.py falls [--falls 1000] [--only solo12] [--dt 1e-3]
    python benchmarks/runs.py long [--steps 1000000] [--only "cassie, Baumgarte"]

falls: each robot is let go 2 cm above the floor, in a random state, without torques. Of every step:
the natural residual of the contact problem, how far loops are open, how deep contacts penetrate,
and what they do to the energy; `contact_step.py` has what a step costs.

long: a four-bar falls from rest and swings on without friction, and Cassie hangs by the pelvis, its
motors pushed to and fro against springs and damping; both by `RungeKutta4` at 1 ms, with each of
three drift schemes. The four-bar once more by `Rattle`, and a point mass on a rod at 10 ms: their
energy has to swing as far in the last tenth of the run as in the first. 1 if a run is not good.

With --only rows are measured anew, and the others stay.
"""

from __future__ import annotations

import os
import sys
from argparse import ArgumentParser, Namespace
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import script
from script import Table

import condyn_pin as cp
from condyn_pin.dynamics import contact_gaps
from condyn_pin.simulation.integrators import Integrator
from lab.drift import rod_pendulum

# --- falls

ROBOTS = {"solo12": {}, "go2": {}, "talos": {}, "cassie": {"variant": {"feet": "points"}}}
FRICTION = 0.7  # [1]
HEIGHT = 0.02  # [m]
DURATION = 1.0  # [s]

# What is allowed: natural residual [1], loops [m, rad], penetration [m].
NATURAL, LOOPS, DEPTH = 1e-8, 1e-5, 1e-3


@dataclass
class Falls:
    """The falls of one robot."""

    robot: str
    falls: int = 0
    steps: int = 0
    broken: list[str] = field(default_factory=list)  # why runs did not go to their end
    natural: float = 0.0  # [1], the largest
    loops: float = 0.0  # [m, rad]
    penetration: float = 0.0  # [m]
    deep: int = 0  # falls that penetrate further than DEPTH
    fastest: float = 0.0  # [rad/s, m/s]
    # of the energy that a fall loses, at most: what corrections have done, and what steps gave
    corrected: float = 0.0  # [1]
    algorithmic: float = 0.0  # [1]
    given: float = 0.0  # the same in a single step [1]
    taken: float = 0.0  # median work of friction and impacts [J]


def fall(robot: str, count: int, dt: float) -> Falls:
    """Return what `count` falls of a robot have shown."""
    scene = scene_of(robot)
    found, taken = Falls(robot), []
    for seed in range(count):
        q, v = scene.sample(np.random.default_rng(seed), spread=0.3)
        q[2] += HEIGHT - min(contact_gaps(scene, q).values())
        run = cp.simulate(scene, q, v, duration=DURATION, dt=dt)
        assert run.contact is not None
        depth = -min(float(gap.min()) for gap in run.gaps.values())
        found.falls += 1
        found.steps += len(run) - 1
        if not run.status.ok:
            found.broken.append(f"{robot}, seed {seed}: {run.reason}")
        found.natural = max(found.natural, float(run.contact.natural.max()))
        found.loops = max(found.loops, float(run.violation.max()))
        found.penetration = max(found.penetration, depth)
        found.deep += int(depth > DEPTH)
        found.fastest = max(found.fastest, float(np.abs(run.v).max()))
        energy = run.energy
        size = float(np.ptp(energy.total))
        found.corrected = max(found.corrected, float(np.abs(energy.correction).max()) / size)
        found.algorithmic = max(found.algorithmic, float(energy.algorithmic[-1]) / size)
        found.given = max(found.given, float(np.diff(energy.algorithmic).max()) / size)
        taken.append(float(energy.contact[-1]))
    found.taken = float(np.median(taken))
    return found


def scene_of(robot: str) -> cp.Scene:
    """Return a robot on its loops, its feet over the floor."""
    loaded = cp.load_robot(robot, **ROBOTS[robot])
    return cp.Scene(loaded, loaded.loops, contacts=loaded.frictional_contacts(FRICTION))


def falls(given: Namespace) -> script.Saved:
    """Let the robots fall."""
    about = script.measured_on()
    rows = {
        name: fall(name, given.falls, given.dt) for name in ROBOTS if given.only in (None, name)
    }
    if given.only:
        kept = script.load("runs falls")
        if kept["dt"] != given.dt:
            raise SystemExit(f"the other rows are of steps of {kept['dt']:g} s")
        rows = {row["robot"]: Falls(**row) for row in kept["rows"]} | rows
    return {**about, "dt": given.dt, "rows": [asdict(row) for row in rows.values()]}


def falls_table(saved: script.Saved) -> str:
    """Return a row a robot."""
    rows, dt = [Falls(**row) for row in saved["rows"]], saved["dt"]
    lines = [
        f"{DURATION:g} s in steps of {1e3 * dt:g} ms from {1e2 * HEIGHT:g} cm; allowed: natural "
        f"{NATURAL:g}, loops {LOOPS:g} m, penetration {1e3 * DEPTH:g} mm.",
        "",
        "| robot | falls | broken | natural | loops [m] | deepest [mm] | deeper than 1 mm "
        "| contacts took [J] | corrections | algorithmic | in a step | fastest [rad/s] |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    lines += [
        f"| {r.robot} | {r.falls} | {len(r.broken)} | {r.natural:.1e} | {r.loops:.1e} | "
        f"{1e3 * r.penetration:.2f} | {r.deep} | {-r.taken:.3g} | "
        f"{r.corrected:.1e} | {r.algorithmic:.1e} | {r.given:.1e} | {r.fastest:.0f} |"
        for r in rows
    ]
    source = script.source("runs falls", saved["machine"])
    said = (
        f"{source}; contacts took: friction and impacts, median. Of the energy that a fall loses, "
        "at most: corrections, which push penetrations out and close loops; algorithmic, which "
        "steps gave, in a fall and in a step."
    )
    return "\n".join([*lines, "", said])


def falls_text(saved: script.Saved) -> str:
    """Return the table, and why runs broke, a line each."""
    reasons = [reason for row in saved["rows"] for reason in row["broken"]]
    return "\n".join([falls_table(saved), "", *reasons])


# --- long

MANY = 1_000_000
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
    dt: float = 1e-3  # [s]

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


def long(given: Namespace) -> script.Saved:
    """Run what is asked for, beside what was measured before."""
    about, command = script.measured_on(), "runs long"
    kept = script.load(command)["runs"] if script.result(command).exists() else []
    found = {row["name"]: row for row in kept}
    for plan in plans():
        if given.only in plan.label:
            found[plan.label] = asdict(long_run(plan, given.steps))
            print(found[plan.label], flush=True)
    return {**about, "runs": [found[plan.label] for plan in plans() if plan.label in found]}


def long_table(saved: script.Saved) -> str:
    """Return the runs as a table."""
    runs = [LongRun(**row) for row in saved["runs"]]
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
    return "\n".join([*lines, "", text.format(**saved["machine"])])


def _falls_options(parser: ArgumentParser) -> None:
    parser.add_argument("--falls", type=int, default=1000)
    parser.add_argument("--only", choices=ROBOTS)
    parser.add_argument("--dt", type=float, default=1e-3, help="[s]")


def _long_options(parser: ArgumentParser) -> None:
    parser.add_argument("--steps", type=int, default=MANY)
    parser.add_argument("--only", default="", help="what the name of a run has to contain")


SUBJECTS = [
    Table(
        "runs falls",
        "limp robots from random states, every step looked at",
        falls,
        falls_text,
        pages=lambda saved: {script.RESULTS_PAGE: {"falls": falls_table(saved)}},
        beside=lambda saved: script.write(script.result("runs falls", ".md"), falls_text(saved)),
        options=_falls_options,
    ),
    Table(
        "runs long",
        "a million steps: gap, slip, energy, memory",
        long,
        long_table,
        beside=lambda saved: script.write(script.result("runs long", ".md"), long_table(saved)),
        options=_long_options,
        wrong=lambda saved: not all(LongRun(**row).is_good for row in saved["runs"]),
    ),
]


if __name__ == "__main__":
    sys.exit(script.main(__doc__, SUBJECTS))
