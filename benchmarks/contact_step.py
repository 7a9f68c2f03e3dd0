"""What a step with contacts takes: beside its parts, beside a plain script, and beside MuJoCo.

    python benchmarks/contact_step.py [--quick]

Pinocchio 4, whose ADMM is timed. All candidates of a scene are timed in one process, interleaved,
at the same states of one motion. The plain script has Pinocchio's terms, LAPACK and ADMM, and
nothing else: no proof, no loops, no stops, no choice of contacts, and axes of the base that turn
within a step only after it (1e-4 m/s here). MuJoCo steps the same robot with a ball in each foot.
"""

from __future__ import annotations

import os
import sys
from argparse import Namespace
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import script
from scipy.linalg.lapack import dpotrf, dtrtrs
from script import Table

import condyn_pin as cp
from condyn_pin._core import _pin, tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.arrays import Array
from condyn_pin._core.linalg import factorise
from condyn_pin._core.threads import one_blas_thread
from condyn_pin._core.timing import Call, State, Times, interleaved
from condyn_pin.contact import ADMM, ContactProblem, SemismoothNewton
from condyn_pin.contact.condense import condense
from condyn_pin.contact.problem import normalised
from condyn_pin.contact.residuals import natural_residual
from condyn_pin.contact.solution import attempt_contact
from condyn_pin.contact.solvers.pgs import padded
from condyn_pin.model import together
from condyn_pin.simulation.plan import plan
from condyn_pin.simulation.run import HybridPhase
from condyn_pin.simulation.system import System
from condyn_pin.stepping.contact_steps import ContactSteps

DT, FRICTION = 1e-3, 0.7  # [s], [1]
REPEATS = 5  # few calls a sample: a busy machine interrupts long ones
RADIUS, SUNK = 0.01, 1e-4  # of the balls in MuJoCo's feet, and how deep they are in its floor [m]
SETTLED = 100  # steps before the first state


@dataclass(frozen=True)
class Row:
    """A scene: medians [us], medians of ratios within a round, and errors."""

    scene: str
    contacts: str
    step: float  # [us]
    recorded: float  # a step of `simulate` that keeps its sample [us]
    terms: float  # M, h, J_b, gamma, gaps and J_c [us]
    condense: float  # [us]
    bare: float  # ADMM [us]
    to_parts: float  # step / (terms + condense + bare)
    to_bare: float  # ADMM of this library / bare
    script: float | None  # the plain script [us]
    to_script: float | None
    mujoco: float | None  # mj_step [us]
    to_mujoco: float | None
    iterations: float  # of ADMM, mean
    natural: float  # residual, the worst
    error: float  # of v+ against Newton's method to rounding, relative to g dt, the worst


@dataclass(frozen=True)
class Islands:
    """One contact problem of several robots, solved apart and as a whole."""

    robots: int
    rows: int
    apart: float  # [us]
    whole: float  # [us]
    ratio: float  # whole / apart
    natural: float  # residual of what was solved apart
    difference: float  # of the impulses, relative to the largest


class Scene:
    """A robot on its feet that holds its posture, pushed aside: what is timed, and where."""

    def __init__(
        self, name: str, contacts: str, push: float, friction: float = FRICTION,
        settled: int = SETTLED, **options: Any,
    ) -> None:  # fmt: skip
        robot = cp.load_robot(name, **options)
        self.name, self.contacts, self.friction = name, contacts, friction
        self.scene = cp.Scene(robot, robot.loops, contacts=robot.frictional_contacts(friction))
        q, v = self.scene.state()
        q = q.copy()
        q[2] -= min(cp.dynamics.contact_gaps(self.scene, q).values())
        held = cp.Scene(robot, (*robot.loops, *robot.contacts))
        self.tau = np.array(cp.inverse_dynamics(held, q, v, np.zeros(robot.nv)).tau)
        self.system = System(
            cp.Workspace(self.scene.bilateral), self.tau, contacts=self.scene.contact_bounds
        )
        self.steps = ContactSteps(cp.StewartTrinkle(), self.system, DT)
        v = v.copy()
        v[0] = push
        self.states: list[State] = []
        for k in range(2 * settled):
            q, v, _ = self.steps.step(0.0, q, v)
            if k >= settled and k % (settled // 10) == 0:
                self.states.append((q, v, self.tau))

    def problem(self, state: State) -> ContactProblem:
        """Return the contact problem of the step from a state."""
        return self.steps.pose(0.0, *state[:2]).problem

    def recorded(self) -> Call:
        """Return a step as `simulate` takes it, its sample kept."""
        q, v, _ = self.states[0]
        planned = plan(
            self.scene, self.tau, duration=DT, dt=DT, integrator=cp.StewartTrinkle(), drift=None,
            solver=None, record=1,
        )  # fmt: skip
        phase = HybridPhase(self.scene, planned)
        phase.begin(0.0, q, v)

        def step(q: Array, v: Array, tau: Array) -> None:
            phase.step(0.0, q, v, 0)
            phase.recorder.rows.clear()

        return step


def parts(scene: Scene) -> dict[str, Call]:
    """Return what a step is made of: terms, condensation, and ADMM bare and as it is here."""
    system, candidates = scene.system, scene.system.contacts
    equations, data = system.equations, system.equations.data
    problems = {id(state[0]): scene.problem(state) for state in scene.states}
    poses = ((id(q), scene.steps.pose(0.0, q, v)) for q, v, _ in scene.states)
    rows = {key: posed.J[posed.chosen.rows] for key, posed in poses}
    small = {key: padded(normalised(problem)[0]) for key, problem in problems.items()}
    solver = ADMM()

    def terms(q: Array, v: Array, tau: Array) -> None:
        equations.parts(q, v)
        candidates.evaluate(data, q)

    def condensed(q: Array, v: Array, tau: Array) -> None:
        M, J_b, p = known[id(q)]
        factors = factorise(M, J_b, tolerances.RANK)
        now = condense(factors, rows[id(q)], v, p, np.zeros(len(J_b)))
        _ = now.G, now.contact_velocities

    known = {}
    for q, v, tau in scene.states:
        M, h, J_b, _ = equations.parts(q, v)
        known[id(q)] = M, J_b, DT * (tau - h)
    return {
        "terms": terms,
        "condense": condensed,
        "bare": lambda q, v, tau: bare_admm(small[id(q)].G, small[id(q)].g, small[id(q)].friction),
        "ADMM": lambda q, v, tau: solver.attempt(problems[id(q)]),
    }


def bare_admm(G: Array, g: Array, friction: Array) -> Array:
    """Return what Pinocchio's ADMM answers, as a script calls it; sets and settings are kept."""
    models, datas = _pin._sets(friction, np.zeros(0))
    settings = _pin._admm_settings(True, 0.25 * ADMM.tolerance, 1000, ADMM.anderson)
    result = pin.ADMMSolverResult()
    solver, operator = pin.ADMMConstraintSolver(len(g)), pin.DelassusOperatorDense(G)
    solver.solve(operator, g, models, datas, settings, result)
    return np.asarray(result.retrieveConstraintImpulses())


class PlainScript:
    """A step of points on the floor, as one writes it by hand, without loops and without proof."""

    def __init__(self, scene: Scene) -> None:
        self.model = scene.scene.robot.model
        self.data = self.model.createData()
        contacts = scene.scene.contacts
        self.frames = [self.model.getFrameId(contact.frame) for contact in contacts]
        self.friction = np.array([contact.friction for contact in contacts])

    def step(self, q: Array, v: Array, tau: Array) -> tuple[Array, Array]:
        """Return q and v after a step."""
        model, data = self.model, self.data
        M, h = pin.crba(model, data, q), pin.nonLinearEffects(model, data, q, v)
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        J = np.vstack(
            [
                pin.getFrameJacobian(model, data, frame, pin.LOCAL_WORLD_ALIGNED)[:3]
                for frame in self.frames
            ]
        )
        gaps = self.heights()
        pin.framesForwardKinematics(model, data, pin.integrate(model, q, DT * v))
        bends = self.heights() - gaps - DT * J[2::3].dot(v)
        U = dpotrf(M.T)[0]
        X = dtrtrs(U, J.T, trans=1)[0]
        w = v.dot(U.T) + dtrtrs(U, DT * (tau - h), trans=1)[0]
        G, g = X.T.dot(X), w.dot(X)
        g[2::3] += (bends + np.where(gaps > 0, gaps, 0.2 * gaps)) / DT
        small, speed = 1.0 / np.mean(G.diagonal()), np.abs(g).max()
        lam = bare_admm(small * G, g / speed, self.friction) * (small * speed)
        v1 = dtrtrs(U, X.dot(lam) + w)[0]
        return pin.integrate(model, q, DT * v1), v1

    def heights(self) -> Array:
        """Return how high the points are [m]."""
        return np.array([self.data.oMf[frame].translation[2] for frame in self.frames])


def mujoco_twin(scene: cp.Scene) -> tuple[Any, cp.study.MujocoBridge]:
    """Return MuJoCo's model of a robot of points on the floor, and the bridge to it."""
    import mujoco

    robot = scene.robot
    spec = mujoco.MjSpec.from_string(robot.to_mjcf())
    for contact in scene.contacts:
        site = spec.site(contact.frame)
        ball = {"type": mujoco.mjtGeom.mjGEOM_SPHERE, "size": [RADIUS, 0, 0]}
        site.parent.add_geom(pos=site.pos, **ball)
    spec.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_PLANE, size=[10, 10, 1], pos=[0, 0, SUNK - RADIUS]
    )
    for geom in spec.geoms:
        geom.friction[0], geom.condim = scene.contacts[0].friction, 3
        floor = geom.type == mujoco.mjtGeom.mjGEOM_PLANE
        geom.contype, geom.conaffinity = (1, 0) if floor else (0, 1)
    spec.option.timestep, spec.option.cone = DT, mujoco.mjtCone.mjCONE_ELLIPTIC
    model = spec.compile()
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_LIMIT
    return model, cp.study.MujocoBridge(robot, model)


def mujoco_step(scene: Scene) -> Call:
    """Return MuJoCo's step of the same robot, put back at the state now and then."""
    import mujoco

    model, bridge = mujoco_twin(scene.scene)
    data, calls = mujoco.MjData(model), 0
    known = {id(state[0]): bridge.to_mujoco(*state[:2]) for state in scene.states}
    data.qfrc_applied[:] = bridge.torque_to_mujoco(scene.states[0][0], scene.tau)

    def step(q: Array, v: Array, tau: Array) -> None:
        nonlocal calls
        if calls % (REPEATS + 1) == 0:
            data.qpos[:], data.qvel[:] = known[id(q)]
        calls += 1
        mujoco.mj_step(model, data)

    for state in scene.states:
        step(*state)
        if data.ncon != len(scene.scene.contacts):
            raise SystemExit(f"{scene.name}: {data.ncon} contacts in MuJoCo")
    calls = 0
    return step


def errors(scene: Scene) -> tuple[float, float, float]:
    """Return iterations of ADMM, the worst residual, and the worst error of v+ over g dt."""
    exact = ContactSteps(cp.StewartTrinkle(contact=SemismoothNewton()), scene.system, DT)
    iterations, natural, error = [], 0.0, 0.0
    for q, v, _ in scene.states:
        found = scene.steps.step(0.0, q, v)[1]
        iterations.append(scene.steps.last.attempt.iterations)
        natural = max(natural, scene.steps.last.natural)
        off = np.abs(found - exact.step(0.0, q, v)[1]).max()
        error = max(error, float(off) / (pin.Model.gravity981[2] * -DT))
    return float(np.mean(iterations)), natural, error


@one_blas_thread
def measured(scene: Scene, rounds: int, *, floor: bool) -> Row:
    """Return the row of a scene; `floor` says whether script and MuJoCo take it."""
    calls: dict[str, Call] = {
        "step": lambda q, v, tau: scene.steps.step(0.0, q, v),
        "recorded": scene.recorded(),
        **parts(scene),
    }
    if floor:
        script = PlainScript(scene)
        calls |= {"script": script.step, "mujoco": mujoco_step(scene)}
        for q, v, tau in scene.states:
            np.testing.assert_allclose(script.step(q, v, tau)[1], scene.steps.step(0.0, q, v)[1],
                                       atol=1e-3)  # fmt: skip
    times = interleaved(calls, scene.states, rounds=rounds, repeats=REPEATS)
    in_parts = np.sum([times[name].samples for name in ("terms", "condense", "bare")], axis=0)
    iterations, natural, error = errors(scene)
    step = times["step"]
    return Row(
        scene.name, scene.contacts, step=step.median, recorded=times["recorded"].median,
        terms=times["terms"].median, condense=times["condense"].median, bare=times["bare"].median,
        to_parts=step.ratio(Times(tuple(in_parts))), to_bare=times["ADMM"].ratio(times["bare"]),
        script=times["script"].median if floor else None,
        to_script=step.ratio(times["script"]) if floor else None,
        mujoco=times["mujoco"].median if floor else None,
        to_mujoco=step.ratio(times["mujoco"]) if floor else None,
        iterations=iterations, natural=natural, error=error,
    )  # fmt: skip


@one_blas_thread
def islands(robots: int, rounds: int) -> Islands:
    """Return what it saves to solve robots apart that do not touch each other."""
    one = sliding()
    solo = one.scene.robot
    crowd = together({f"robot {i}": solo for i in range(robots)})
    scene = cp.Scene(crowd, contacts=crowd.frictional_contacts(one.friction))
    tau = np.tile(one.tau, robots)
    system = System(cp.Workspace(scene.bilateral), tau, contacts=scene.contact_bounds)
    steps = ContactSteps(cp.StewartTrinkle(), system, DT)
    states = [tuple(np.tile(x, robots) for x in state) for state in one.states]
    problems = {id(q): steps.pose(0.0, q, v).problem for q, v, _ in states}
    solver, accuracy = ADMM(), tolerances.CONTACT_SOLVED
    calls: dict[str, Callable[..., Any]] = {
        "apart": lambda q, v, tau: attempt_contact(problems[id(q)], solver, None, accuracy),
        "whole": lambda q, v, tau: whole(problems[id(q)], solver),
    }
    times = interleaved(calls, states, rounds=rounds, repeats=2)
    natural, difference = 0.0, 0.0
    for q, v, tau in states:
        found, left = calls["apart"](q, v, tau)
        lam = calls["whole"](q, v, tau)[0].lam
        natural = max(natural, left)
        difference = max(difference, float(np.abs(found.lam - lam).max() / np.abs(lam).max()))
    rows = next(iter(problems.values())).rows
    return Islands(
        robots, rows, times["apart"].median, times["whole"].median,
        times["whole"].ratio(times["apart"]), natural, difference,
    )  # fmt: skip


def whole(problem: ContactProblem, solver: ADMM) -> tuple[Any, float]:
    """Return an answer to a problem as one, with its residual."""
    found = solver.attempt(problem)
    return found, natural_residual(problem, found.lam)


def sliding() -> Scene:
    """Return Solo12 while it slides on all feet."""
    return Scene("solo12", "4 points that slide", push=0.5, friction=0.3, settled=40)


def measure(given: Namespace) -> script.Saved:
    """Measure all scenes."""
    import mujoco

    about, rounds = script.measured_on(mujoco=mujoco.__version__), 40 if given.quick else 400
    locked = {"feet": "points", "springs": "locked"}
    scenes = (
        Scene("solo12", "4 points", push=0.2),
        sliding(),
        Scene("talos", "8 corners", push=0.0),
        Scene("cassie", "loops, 4 points", push=0.0, variant=locked),
    )
    # MuJoCo's robot hops where it slides, and touches nothing then
    rows = [asdict(measured(scene, rounds, floor=scene is scenes[0])) for scene in scenes]
    return {**about, "rows": rows, "islands": asdict(islands(8, rounds // 4))}


def table(saved: script.Saved) -> str:
    """Return a row a scene, and what the columns are."""
    crowd = Islands(**saved["islands"])
    lines = [
        "| scene | step [us] | in `simulate`, kept | terms | condense | ADMM, bare | x the three | "
        "ADMM here, x bare | plain script [us] | x | `mj_step` [us] | x | iterations | residual | "
        "error |",
        "|" + 15 * "---|",
    ]
    for row in (Row(**each) for each in saved["rows"]):
        cells = (
            f"{row.scene}, {row.contacts}",
            *(f"{x:.0f}" for x in (row.step, row.recorded, row.terms, row.condense, row.bare)),
            f"{row.to_parts:.2f}",
            f"{row.to_bare:.2f}",
            _cell(row.script, ".0f"),
            _cell(row.to_script, ".2f"),
            _cell(row.mujoco, ".1f"),
            _cell(row.to_mujoco, ".1f"),
            f"{row.iterations:.0f}",
            f"{row.natural:.0e}",
            f"{row.error:.0e}",
        )
        lines.append("| " + " | ".join(cells) + " |")
    lines += [
        "",
        f"Terms: M, h, J, gaps and rows of contacts; condense: G and the free velocity, loops "
        f"eliminated. What sticks is answered by one linear system (1 iteration), and ADMM is not "
        f"asked. Error: of v+ against Newton's method to rounding, over g dt. "
        f"{crowd.robots} Solo12 that slide in one scene ({crowd.rows} rows): their contact problem "
        f"is solved in {crowd.apart:.0f} us, robot by robot, in {crowd.whole:.0f} us as a whole, "
        f"{crowd.ratio:.1f} times as long; impulses differ by {crowd.difference:.0e} of the "
        "largest.",
        f"{script.source('contact_step', saved['machine'])}; MuJoCo {saved['machine']['mujoco']}.",
    ]
    return "\n".join(lines)


def _cell(value: float | None, form: str) -> str:
    return "" if value is None else format(value, form)


SUBJECTS = [
    Table(
        "contact_step",
        "time of a step with contacts, part by part",
        measure,
        table,
        pages=lambda saved: {script.RESULTS_PAGE: {"contact_step": table(saved)}},
        quick="few rounds; nothing is written",
    )
]


if __name__ == "__main__":
    sys.exit(script.main(__doc__, SUBJECTS))
