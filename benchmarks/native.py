"""The compiled core beside Python, beside Pinocchio's bare calls, and beside `mujoco.rollout`.

    python benchmarks/native.py core [--quick] [--rounds 7]
    python benchmarks/native.py contact [--quick]
    python benchmarks/native.py gradients [--quick]

Everything takes turns in one process, and is timed by processor time, all threads together: that
is what a loaded machine changes least, and threads on cores of their own divide it by their
number. A figure is the median over the rounds.

core: `solve`, derivatives, and the motions of Cassie that `batch.py` has.

contact: Solo12 stands on four points under the torques that hold it, or slides on them: eight
motions of 0.2 s in steps of 1 ms, in one thread. What a foot does beside it is measured by
Pinocchio, in every step: how deep it goes, and of who stands how far it is carried.

gradients: an arm of seven joints presses its hand on a table, sticks or slides there; a humanoid
stands on the corners of its soles, or on one point a foot. States nearby are stepped and
differentiated in batches, in one thread. The error is the largest difference of an entry, relative
to the largest of its matrix. Le Lidec and others (arXiv 2409.07107) report 5 us for the derivatives
of a step of an arm with 7 degrees of freedom and 95 us for a humanoid with 36, on their machine.
"""

from __future__ import annotations

import os
import sys
from argparse import ArgumentParser, Namespace

os.environ.setdefault("OMP_NUM_THREADS", "1")

import importlib.util
import resource
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

import batch
import contact_step
import numpy as np
import script
from script import Table, processor_time

import condyn_pin as cp
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.compiled import compiled
from condyn_pin.constraints import Ball, Plane
from condyn_pin.contact import SemismoothNewton
from condyn_pin.dynamics.derivatives.others import BLOCKS
from condyn_pin.dynamics.scene import motor_torque, standard_scenes
from condyn_pin.gradients import BatchStepDerivatives, step_derivatives_batch
from condyn_pin.model.smaller import lock_joints
from condyn_pin.simulation.records import candidates_of
from condyn_pin.stepping import step_batch


def turns(calls: dict[str, Callable[[], Any]], rounds: int) -> dict[str, float]:
    """Return the median processor time of each call, in turns [s]."""
    for call in calls.values():
        call()
    times: dict[str, list[float]] = {name: [] for name in calls}
    for i in range(rounds):
        names = list(calls)
        for name in names[i % len(names) :] + names[: i % len(names)]:
            begun = processor_time()
            calls[name]()
            times[name].append(processor_time() - begun)
    return {name: float(np.median(each)) for name, each in times.items()}


def about_core() -> script.Saved:
    """Return machine, load and the core."""
    known = {"headers": compiled().pinocchio, "simd": compiled().simd}
    return {**script.measured_on(), "core": known}


def source(command: str, saved: script.Saved) -> str:
    """Return what a table is of, with the core."""
    said = script.source(command, saved["machine"], script.OF_CORES)
    core, load = saved["core"], saved["load"]
    return f"{said}; headers {core['headers']}, {core['simd']}; load {load:.1f} when it began."


DT = contact_step.DT  # [s]


# --- core


ROBOTS = ("talos", "cassie", "solo12", "four_bar")
LEAST = 0.02  # what a turn takes, so that what a verb does once for all states is little [s]


@dataclass(frozen=True)
class Verb:
    """A verb on the states of a scene, processor time a state.

    Attributes
    ----------
    scene, verb : str
    bare, python, core, two, one : float
        Pinocchio's own calls without any proof, Python, the core by one thread and by two, and the
        core for one state after another, in a `Workspace` [us].
    error : float
        Largest difference between the core and Python, relative to the largest number.
    left : int
        States that the core left to Python.
    states : int
    """

    scene: str
    verb: str
    bare: float
    python: float
    core: float
    two: float
    one: float
    error: float
    left: int
    states: int


@dataclass(frozen=True)
class Steps:
    """A way to simulate Cassie."""

    engine: str
    name: str
    dt: float  # [s]
    rate: float  # steps a second of processor time [1/s]
    violation: float  # the largest gap [m]
    error: float  # how far the ends are from the true motion [m, rad]


def bare_calls(scene: cp.Scene, states: tuple[np.ndarray, ...], *, slopes: bool) -> None:
    """Call what Pinocchio has for the states, one after the other."""
    workspace = cp.dynamics.workspace.workspace_for(scene, None, None)
    workspace.acceleration(*(x[0] for x in states))
    model, data, settings = workspace.model, workspace.data, workspace.proximal_settings
    models, datas = workspace.constraint_models, workspace.constraint_datas
    for state in zip(*states, strict=True):
        pin.constraintDynamics(model, data, *state, models, datas, settings)
        if slopes:
            pin.computeConstraintDynamicsDerivatives(model, data, models, datas, settings)


def one_by_one(workspace: cp.Workspace, states: tuple[np.ndarray, ...], *, slopes: bool) -> None:
    """Ask a workspace for the states, one after the other."""
    for state in zip(*states, strict=True):
        if slopes:
            found = workspace.derivatives(*state)
            _ = found.da_dq, found.da_dv, found.da_dtau
        else:
            workspace.solve(*state)


def again_and_again(
    scene: cp.Scene, states: tuple[np.ndarray, ...], *, slopes: bool
) -> tuple[np.ndarray, ...]:
    """Return the states so many times that Pinocchio's calls take `LEAST` for all of them."""
    bare_calls(scene, states, slopes=slopes)
    begun = processor_time()
    bare_calls(scene, states, slopes=slopes)
    times = max(1, round(LEAST / (processor_time() - begun)))
    return tuple(np.tile(x, (times, 1)) for x in states)


def verbs(label: str, scene: cp.Scene, count: int, rounds: int) -> list[Verb]:
    """Measure both verbs on closed, moving states under motor torques."""
    rng = np.random.default_rng(0)
    some = [(*scene.sample(rng), motor_torque(scene.robot, rng)) for _ in range(count)]
    states = tuple(np.array(x) for x in zip(*some, strict=True))
    found, core = [], cp.Workspace(scene, engine="core")
    for verb, call, names in (
        ("solve", cp.solve_batch, ("a", "lam")),
        ("derivatives", cp.simulation.derivatives_batch, BLOCKS),
    ):
        few = tuple(x[: count if verb == "solve" else count // 4] for x in states)
        many = again_and_again(scene, few, slopes=verb == "derivatives")
        run, long_run = partial(call, scene, *few), partial(call, scene, *many)
        times = turns(
            {
                "bare": partial(bare_calls, scene, many, slopes=verb == "derivatives"),
                "python": run,
                "core": partial(long_run, executor=cp.Native(threads=1)),
                "two": partial(long_run, executor=cp.Native(threads=2)),
                "one": partial(one_by_one, core, many, slopes=verb == "derivatives"),
            },
            rounds,
        )
        one, two = run(), run(executor=cp.Native(threads=1))
        error = max(
            float(np.abs(getattr(one, x) - getattr(two, x)).max(initial=0.0))
            / max(1.0, float(np.abs(getattr(one, x)).max(initial=0.0)))
            for x in names
        )
        taken = {name: len((few if name == "python" else many)[0]) for name in times}
        per = {name: 1e6 * time / taken[name] for name, time in times.items()}
        found.append(
            Verb(label, verb, **per, error=error, left=left(scene, few), states=len(few[0]))
        )
    return found


def left(scene: cp.Scene, states: tuple[np.ndarray, ...]) -> int:
    """Return how many states the core leaves to Python."""
    core, count, nv = cp.Workspace(scene).compiled, len(states[0]), scene.robot.nv
    outputs = {
        "a": np.zeros((count, nv)), "lam": np.zeros((count, scene.rows)),
        "residuals": np.zeros((count, 5)), "statuses": np.zeros(count, np.int8),
        "iterations": np.zeros(count, np.int32), "solve_times": np.zeros(count),
    }  # fmt: skip
    return len(core.solve(states, outputs, accuracy=None, threads=1))  # type: ignore[arg-type]


def motions(count: int, rounds: int) -> list[Steps]:
    """Measure motions of Cassie: Python, the core, and MuJoCo where it is installed."""
    batch.MOTIONS = count
    cassie = cp.load_robot("cassie")
    scene = cp.Scene(cassie, cassie.loops)
    true = batch.judge_ours(
        scene, cp.RungeKutta4(), cp.simulation.PostStabilization(), batch.FINE[0]
    )[1]
    calls: dict[str, Callable[[], Any]] = {}
    about: dict[str, tuple[str, str, float, Callable[[], Any]]] = {}
    middle = cp.simulation.LinearlyImplicitMidpoint()
    for integrator, gain, dt in (
        (cp.SemiImplicitEuler(), 0.3, 1e-3), (middle, 0.1, 1e-3), (middle, 0.1, 5e-3),
    ):  # fmt: skip
        for drift in (cp.Baumgarte.critical(gain / dt), cp.simulation.PostStabilization()):
            judge = partial(batch.judge_ours, scene, integrator, drift, dt)
            for engine, executor in (("Python", None), ("core", cp.Native(threads=1))):
                name = f"{integrator.title}, {drift.title}"
                key = f"{engine} {name} {dt}"
                calls[key] = partial(batch.ours, scene, integrator, drift, dt, executor)
                about[key] = engine, name, dt, judge
    if importlib.util.find_spec("mujoco"):
        for integrator, setting, dt in (
            ("Euler", "solref .002, solimp .9999", 1e-3), ("Euler", "default", 2e-3),
        ):  # fmt: skip
            key = f"mujoco {integrator} {setting} {dt}"
            calls[key] = partial(batch.theirs, scene, setting, integrator, dt, 1)
            judge = partial(batch.judge_theirs, scene, setting, integrator, dt)
            about[key] = "mujoco.rollout", f"{integrator}, {setting}", dt, judge
    times = turns(calls, rounds)
    found = []
    for key, (engine, name, dt, judge) in about.items():
        gap, ends = judge()
        rate = count * batch.DURATION / dt / times[key]
        error = batch.apart(scene, ends, true)
        found.append(Steps(engine, name, dt, rate, gap, error))
    return found


def memory() -> float:
    """Return what a thread of the core takes on Cassie [MB]."""
    cassie = cp.load_robot("cassie")
    scene = cp.Scene(cassie, cassie.loops)
    q, v = (np.tile(x, (64, 1)) for x in scene.state())
    cp.simulate_batch(scene, q, v, duration=1e-3, executor=cp.Native(threads=1))
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    cp.simulate_batch(scene, q, v, duration=1e-3, executor=cp.Native(threads=33))
    return (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 32 / 1024


def core(given: Namespace) -> script.Saved:
    """Measure answers, motions and memory."""
    about, (count, moved) = about_core(), (40, 2) if given.quick else (400, 8)
    taken = memory()  # first: it looks at the most that was ever taken
    rows = [
        asdict(row)
        for name in ROBOTS
        for label, scene in standard_scenes(cp.load_robot(name)).items()
        if scene.rows
        for row in verbs(label, scene, count, given.rounds)
    ]
    moving = [asdict(row) for row in motions(moved, given.rounds)]
    return {**about, "verbs": rows, "motions": moving, "memory": taken}


def verbs_table(saved: script.Saved) -> str:
    """Return what a state takes."""
    lines = [
        "| scene | verb | Pinocchio's calls [us] | Python [us] | core [us] | x Python | x calls | "
        "2 threads, work | one by one [us] | x calls | difference | left |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    lines += [
        f"| {row.scene} | {row.verb} | {row.bare:.1f} | {row.python:.1f} | {row.core:.1f} | "
        f"{row.python / row.core:.1f} | {row.core / row.bare:.2f} | {row.two / row.core:.2f} | "
        f"{row.one:.1f} | {row.one / row.bare:.2f} | {row.error:.0e} | {row.left} of {row.states} |"
        for row in (Verb(**each) for each in saved["verbs"])
    ]
    return "\n".join([*lines, "", source("native core", saved)])


def motions_table(saved: script.Saved) -> str:
    """Return what a step takes."""
    rows = [Steps(**each) for each in saved["motions"]]
    python = {(row.name, row.dt): row.rate for row in rows if row.engine == "Python"}
    base = next((row.rate for row in rows if "mujoco" in row.engine), None)
    lines = [
        "| Cassie on its loops | dt [ms] | steps a second a core | x Python | x mujoco, Euler 1 ms "
        "| simulated [s/s] | gap [m] | error [m, rad] |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        ours = python.get((row.name, row.dt))
        times = f"{row.rate / ours:.2f}" if ours else ""
        beside = f"{row.rate / base:.2f}" if base else ""
        lines.append(
            f"| {row.engine}, {row.name} | {1e3 * row.dt:g} | {row.rate:.0f} | {times} | {beside} "
            f"| {row.rate * row.dt:.1f} | {row.violation:.0e} | {row.error:.0e} |"
        )
    took = f"A thread takes {saved['memory']:.1f} MB."
    return "\n".join([*lines, "", took, source("native core", saved)])


# --- contact


STEPPED, STEPPING = 8, 0.2  # motions, [s]


@dataclass(frozen=True)
class Stepped:
    """A way to step.

    Attributes
    ----------
    motion, engine : str
    rate : float
        Steps a second of processor time [1/s].
    deepest : float
        Of all feet, in every step [m].
    carried : float
        How far a foot is moved that has to stand, at most [m]; NaN where feet slide.
    """

    motion: str
    engine: str
    rate: float
    deepest: float
    carried: float


@dataclass(frozen=True)
class Start:
    """Where motions begin: a scene, its states, and the torques applied."""

    scene: cp.Scene
    Q: Array
    V: Array
    tau: Array
    stands: bool


def start(speed: float, friction: float) -> Start:
    """Return Solo12 on its feet, pushed aside with some speed [m/s], each motion a little apart."""
    solo = contact_step.Scene("solo12", "4 points", push=0.0, friction=friction, settled=10)
    q, _, tau = solo.states[0]
    Q, V = np.tile(q, (STEPPED, 1)), np.zeros((STEPPED, solo.scene.robot.nv))
    V[:, 0] = speed + np.linspace(0.0, 0.01, STEPPED)
    if not speed:  # feet that touch are at rest
        V[:] = 0.0
    return Start(solo.scene, Q, V, tau, speed == 0.0)


def ours(begin: Start, executor: Any, record: int | None = None) -> cp.simulation.BatchTrajectory:
    """Return the motions by this library."""
    found = cp.simulate_batch(
        begin.scene, begin.Q, begin.V, begin.tau, duration=STEPPING, dt=DT, record=record,
        executor=executor,
    )  # fmt: skip
    assert found.ok, found.counts
    return found


class Rollout:
    """The same motions by `mujoco.rollout`."""

    def __init__(self, begin: Start) -> None:
        import mujoco
        from mujoco.rollout import Rollout as Pool

        self.model, self.bridge = contact_step.mujoco_twin(begin.scene)
        self._data, self._pool = mujoco.MjData(self.model), Pool(nthread=0)
        self._physics = mujoco.mjtState.mjSTATE_FULLPHYSICS
        self._applied = int(mujoco.mjtState.mjSTATE_QFRC_APPLIED)
        self._steps, self._begin = round(STEPPING / DT), begin
        starts, torque = [], self.bridge.torque_to_mujoco(begin.Q[0], begin.tau)
        for q, v in zip(begin.Q, begin.V, strict=True):
            self._data.qpos[:], self._data.qvel[:] = self.bridge.to_mujoco(q, v)
            state = np.zeros(mujoco.mj_stateSize(self.model, self._physics))
            mujoco.mj_getState(self.model, self._data, state, self._physics)
            starts.append(state)
        self._starts = np.array(starts)
        self._torques = np.tile(torque, (STEPPED, self._steps, 1))

    def __call__(self) -> Array:
        """Return the states of all motions in every step."""
        states, _ = self._pool.rollout(
            self.model, [self._data], self._starts, self._torques, nstep=self._steps,
            control_spec=self._applied,
        )  # fmt: skip
        return np.asarray(states)

    def configurations(self) -> Array:
        """Return q of all motions in every step, as Pinocchio has it (motions, steps, nq)."""
        import mujoco

        states = self()
        Q = np.zeros((*states.shape[:2], self._begin.scene.robot.nq))
        for at in np.ndindex(*states.shape[:2]):
            mujoco.mj_setState(self.model, self._data, states[at], self._physics)
            Q[at] = self.bridge.from_mujoco(self._data.qpos, self._data.qvel)[0]
        return Q


def feet(begin: Start, Q: Array) -> tuple[float, float]:
    """Return how deep feet go, and how far they are carried (nan if they slide)."""
    model = begin.scene.robot.model
    data = model.createData()
    frames = [model.getFrameId(contact.frame) for contact in begin.scene.contacts]

    def places(q: Array) -> Array:
        pin.framesForwardKinematics(model, data, q)
        return np.array([data.oMf[frame].translation for frame in frames])

    now = np.array([[places(q) for q in motion] for motion in Q])
    first = np.array([places(q) for q in begin.Q])
    deepest = max(0.0, -float(now[..., 2].min()))
    carried = float(np.abs(now - first[:, None])[..., :2].max()) if begin.stands else float("nan")
    return deepest, carried


def contact(given: Namespace) -> script.Saved:
    """Measure both motions by every engine."""
    about, rows, rounds = about_core(), [], 3 if given.quick else 15
    for motion, speed, friction in (("stands", 0.0, 0.7), ("slides", 1.0, 0.3)):
        begin = start(speed, friction)
        core = cp.Native(threads=1)
        calls: dict[str, Callable[[], Any]] = {
            "Python": partial(ours, begin, None),
            "core": partial(ours, begin, core),
        }
        feet_of = {
            "Python": lambda b=begin: feet(b, ours(b, None, 1).samples.q),
            "core": lambda b=begin, c=core: feet(b, ours(b, c, 1).samples.q),
        }
        if importlib.util.find_spec("mujoco"):
            theirs = Rollout(begin)
            calls["mujoco.rollout"] = theirs
            feet_of["mujoco.rollout"] = lambda b=begin, r=theirs: feet(b, r.configurations())
        times = turns(calls, rounds)
        steps = STEPPED * STEPPING / DT
        rows += [
            asdict(Stepped(motion, engine, steps / times[engine], *feet_of[engine]()))
            for engine in calls
        ]
    return {**about, "rows": rows}


def contact_table(saved: script.Saved) -> str:
    """Return a row a motion and engine."""
    rows = [Stepped(**each) for each in saved["rows"]]
    rates = {(row.motion, row.engine): row.rate for row in rows}
    lines = [
        "| Solo12, 1 ms | by | steps a second a core | x Python | x mujoco | deepest [m] | "
        "carried [m] |",
        "|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        python, theirs = (rates.get((row.motion, by)) for by in ("Python", "mujoco.rollout"))
        beside = f"{row.rate / theirs:.2f}" if theirs else ""
        carried = "" if np.isnan(row.carried) else f"{row.carried:.0e}"
        lines.append(
            f"| {row.motion} | {row.engine} | {row.rate:.0f} | {row.rate / (python or 1):.1f} | "
            f"{beside} | {row.deepest:.0e} | {carried} |"
        )
    return "\n".join([*lines, "", source("native contact", saved)])


# --- gradients


BY = cp.StewartTrinkle(contact=SemismoothNewton())
STEP_BLOCKS = ("dq_dq", "dq_dv", "dq_dtau", "dv_dq", "dv_dv", "dv_dtau")


@dataclass(frozen=True)
class Differentiated:
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
    for block in STEP_BLOCKS:
        one, two = getattr(found, block), getattr(wanted, block)
        sizes = np.abs(two).max(axis=(1, 2))
        worst = max(worst, float((np.abs(one - two).max(axis=(1, 2)) / sizes).max()))
    return worst


def left_to_python(at: States) -> int:
    """Return how many steps the core leaves."""
    from condyn_pin.dynamics.workspace import workspace_for
    from condyn_pin.gradients.routes.active_set import ActiveSet
    from condyn_pin.gradients.routes.batch import DifferentiatedRows, output_kinds
    from condyn_pin.stepping.batch import SteppedRows

    count = len(at.Q)
    kinds = {name: kind.times(count) for name, kind in output_kinds(at.scene, ()).items()}
    outputs = {name: np.zeros(kind.shape, kind.dtype) for name, kind in kinds.items()}
    steps = SteppedRows(tuple(at.scene.contacts), DT, BY)
    rows = DifferentiatedRows(steps, ActiveSet(), ())
    inputs = {"q0": at.Q, "v0": at.V, "tau0": at.TAU}
    workspace = workspace_for(at.scene.bilateral, None, None)
    return len(rows.core(workspace, inputs, outputs, 1)[0])


SUNK = 1e-4  # how deep contacts are where steps begin: no gap is about to open [m]


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


def gradients(given: Namespace) -> script.Saved:
    """Measure every scene."""
    rounds, count = (3, 100) if given.quick else (9, 2000)
    about, rows, core = about_core(), [], cp.Native(threads=1)
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
        row = Differentiated(name, *sizes, *spent, wrong, left_to_python(at), count)
        rows.append(asdict(row))
    return {**about, "rows": rows}


def gradients_table(saved: script.Saved) -> str:
    """Return a row a scene."""
    lines = [
        "| a step of 1 ms, `ActiveSet` | dof | rows | step [us] | and derivatives [us] | "
        "derivatives alone [us] | Python, both [us] | x Python | error | left |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for each in saved["rows"]:
        row = Differentiated(**each)
        lines.append(
            f"| {row.scene} | {row.nv} | {row.rows} | {1e6 * row.step:.1f} | "
            f"{1e6 * row.both:.1f} | {1e6 * (row.both - row.step):.1f} | "
            f"{1e6 * row.python:.0f} | {row.python / row.both:.0f} | {row.error:.0e} | "
            f"{row.left} of {row.count} |"
        )
    return "\n".join([*lines, "", source("native gradients", saved)])


def _rounds(parser: ArgumentParser) -> None:
    parser.add_argument("--rounds", type=int, default=7)


SUBJECTS = [
    Table(
        "native core",
        "answers, derivatives and motions",
        core,
        lambda saved: f"{verbs_table(saved)}\n\n{motions_table(saved)}",
        pages=lambda saved: {
            script.RESULTS_PAGE: {
                "core-verbs": verbs_table(saved),
                "core-motions": motions_table(saved),
            }
        },
        quick="few states; nothing is written",
        options=_rounds,
    ),
    Table(
        "native contact",
        "steps with contacts",
        contact,
        contact_table,
        pages=lambda saved: {script.RESULTS_PAGE: {"core-contact": contact_table(saved)}},
        quick="few rounds; nothing is written",
    ),
    Table(
        "native gradients",
        "derivatives of steps",
        gradients,
        gradients_table,
        pages=lambda saved: {script.RESULTS_PAGE: {"core-gradients": gradients_table(saved)}},
        quick="few rounds; nothing is written",
    ),
]


if __name__ == "__main__":
    sys.exit(script.main(__doc__, SUBJECTS))
