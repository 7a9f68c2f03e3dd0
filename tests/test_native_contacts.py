"""Steps with contacts by the compiled core, their derivatives and motions: those of Python.

A table of states has every kind of contact and of what constrains bodies beside it; each verb goes
through it. `test_native.py` has the border of the core.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import combinations_with_replacement, pairwise
from typing import NamedTuple

import numpy as np
import pytest
from contact_problems import on_a_rough_floor
from numpy.testing import assert_allclose, assert_array_equal
from shared import HEADERS, all_scenes, robot, short_lever
from test_contact_pairs import above, near, placed, scene_of
from test_driven_contacts import FRICTION, WALL, driven_bar, pushed, pushing
from test_meeting_derivatives import assert_differences
from test_native_batches import chain, sprung, with_springs
from test_nonholonomic import cart

import condyn_pin as cp
from condyn_pin._core._pin import pin
from condyn_pin._core.tolerances import CONTACT_SOLVED, MOST_FRICTION
from condyn_pin.constraints import (
    Ball,
    Box,
    Capsule,
    Convex,
    Coupling,
    Driven,
    FrictionalContact,
    HeldJoint,
    JointFriction,
    JointLimit,
    KnifeEdge,
    LineContact,
    PlanarContact,
    Plane,
    Point,
    Polynomial,
    RollingBall,
    Sine,
)
from condyn_pin.constraints.contacts.candidates import Candidates
from condyn_pin.contact import ADMM, SemismoothNewton, natural_residual
from condyn_pin.gradients import BatchStepDerivatives, step_derivatives_batch
from condyn_pin.gradients.routes import batch as slopes
from condyn_pin.model import SpringDamper, free_box, together
from condyn_pin.simulation.batch import motions
from condyn_pin.stepping import BatchStep, contact_problem, step_batch
from condyn_pin.stepping import batch as steps
from condyn_pin.stepping.batch import ERRORS, StepPlan, step_plan

pytestmark = pytest.mark.native

# Both end Newton's method at rounding; what is left is that of M, h and J, and of their products.
EXACT = cp.StewartTrinkle(contact=SemismoothNewton())
ROUNDED = 1e-12
# Motions carry rounding on, step by step, and impacts make it larger.
MOVED = 1e-9
DT = 1e-3
ABOUT = {"dt": DT, "integrator": EXACT}
CORE = {"executor": cp.Native(threads=1)} if HEADERS else {}


class Start(NamedTuple):
    """Where a motion begins, or states, and what acts on them."""

    scene: cp.Scene
    q: np.ndarray
    v: np.ndarray
    tau: np.ndarray


def at_rest(scene: cp.Scene, q: object, v: object = None, tau: object = None) -> Start:
    nv = scene.robot.nv
    v, tau = (np.zeros(nv) if x is None else np.array(x, float) for x in (v, tau))
    return Start(scene, np.array(q, float), v, tau)


def thrown(scene: cp.Scene, q: np.ndarray, v: object, tau: object = None) -> Start:
    """With the velocity nearest to v that rolls, and follows paths."""
    now = scene.at(0.0) if scene.is_driven else scene
    return at_rest(scene, q, cp.mechanism.project_velocity(now, q, np.array(v, float)), tau)


def along(start: Start, duration: float) -> list[Start]:
    """States along a motion of Python and beside it, a group for each time that a scene has."""
    scene = start.scene
    run = cp.simulate(*start, duration=duration, **ABOUT)
    assert run.status.ok, run.reason
    places = np.linspace(0, len(run.t) - 1, 40).astype(int)
    V = run.v[places] + np.random.default_rng(0).normal(scale=0.02, size=(40, scene.robot.nv))
    V[::2] = run.v[places[::2]]
    if not scene.is_driven:
        return [Start(scene, run.q[places], V, start.tau)]
    return [
        Start(scene.at(run.t[k]), run.q[k][None], v[None], start.tau)
        for k, v in zip(places, V, strict=True)
    ]


# What Python does for the core, and where answers are the same


@contextmanager
def by_python(monkeypatch: pytest.MonkeyPatch, owner: object, name: str) -> Iterator[list[object]]:
    """Calls of a function of Python."""
    calls: list[object] = []
    function = getattr(owner, name)

    def counted(*args: object, **kwargs: object) -> object:
        calls.append(args)
        return function(*args, **kwargs)

    with monkeypatch.context() as held:
        held.setattr(owner, name, counted)
        yield calls


def steps_of(group: Start, monkeypatch: pytest.MonkeyPatch, **how: object) -> tuple:
    """Steps by the core and by Python, and how many of the first are Python's too."""
    wanted = step_batch(*group, **(ABOUT | how))
    with by_python(monkeypatch, steps, "step") as calls:
        found = step_batch(*group, **(ABOUT | how), **CORE)
    return found, wanted, len(calls)


def slopes_of(group: Start, monkeypatch: pytest.MonkeyPatch, **how: object) -> tuple:
    """Derivatives of steps, likewise."""
    wanted = step_derivatives_batch(*group, **(ABOUT | how))
    with by_python(monkeypatch, slopes.DifferentiatedRows, "row") as calls:
        found = step_derivatives_batch(*group, **(ABOUT | how), **CORE)
    return found, wanted, len(calls)


def assert_same_steps(
    found: BatchStep, wanted: BatchStep, *, rounded: float = ROUNDED, unique: bool = True,
    floor: float = 0.0,
) -> None:  # fmt: skip
    """Velocities relative to the largest of a state, or 1; forces to the largest of all states.

    Or of forces to a `floor`, if it is larger. These, and the work of them, are looked at if they
    are `unique`.
    """
    assert_array_equal(found.statuses, wanted.statuses)
    assert_array_equal(found.codes, wanted.codes)
    assert_allclose(found.q, wanted.q, rtol=0, atol=rounded)
    for one, two in zip(found.v, wanted.v, strict=True):
        assert_allclose(one, two, rtol=0, atol=rounded * max(1.0, np.abs(two).max()))
    natural, momentum, constraint, *gaps = found.errors.T[:5]
    assert natural.max() <= (ROUNDED if rounded == ROUNDED else CONTACT_SOLVED)
    assert momentum.max() <= ROUNDED
    assert_allclose(constraint, wanted.errors[:, 2], rtol=0, atol=rounded)
    assert_allclose(gaps, wanted.errors.T[3:5], rtol=0, atol=ROUNDED)
    if unique:
        size = np.abs(wanted.lam).max(initial=floor)
        assert_allclose(found.lam, wanted.lam, rtol=0, atol=rounded * size)
        assert_allclose(found.errors[:, 5:], wanted.errors[:, 5:], rtol=0, atol=rounded)


def assert_same_slopes(
    found: BatchStepDerivatives, wanted: BatchStepDerivatives, rounded: float = 1e-9,
    floor: float = 0.0,
) -> None:  # fmt: skip
    """Relative to the largest entry by q, by v, by tau, and by friction and tau.

    Or to a `floor`, by tau DT of it, if it is larger: a block may be rounding alone.
    """
    assert_array_equal(found.codes, wanted.codes)
    assert_array_equal(found.one_sided, wanted.one_sided)
    assert_allclose(found.margins, wanted.margins, rtol=1e-6, atol=1e-12)
    assert found.parameters == wanted.parameters
    at = found.columns
    for name in ("dq", "dv"):
        for one, two in zip(getattr(found, name), getattr(wanted, name), strict=True):
            by_q, by_v, by_tau, by_friction = (
                np.abs(two[:, part]).max(initial=least)
                for part, least in (
                    (at.q, floor), (at.v, floor), (at.tau, floor * DT), (at.friction, 0.0),
                )
            )  # fmt: skip
            for part, size in (
                (at.q, by_q), (at.v, by_v), (at.tau, by_tau), (at.friction, by_friction + by_tau),
            ):  # fmt: skip
                assert_allclose(one[:, part], two[:, part], rtol=0, atol=rounded * size)
            assert not one[:, at.restitution].any()
            assert not one[:, at.solref].any()


def assert_same_motions(
    start: Start, duration: float, monkeypatch: pytest.MonkeyPatch, *, record: int = 7,
    unique: bool = True, left: int = 0,
) -> None:  # fmt: skip
    """Three at once; `left` steps of them at most are Python's."""
    scene, q, v, tau = start
    about = {"duration": duration, "record": record, **ABOUT}
    V = np.tile(v, (3, 1)) * np.array([[1.0], [0.99], [1.02]])
    if scene.is_driven:  # they begin as the path does: Python moves one, for all
        V = np.tile(v, (3, 1))
    state = np.tile(q, (3, 1)), V, tau
    first = slice(1 if scene.is_driven else None)
    wanted = cp.simulate_batch(scene, state[0][first], V[first], tau, **about)
    assert wanted.ok
    with by_python(monkeypatch, motions.ContactSteps, "step") as calls:
        found = cp.simulate_batch(scene, *state, **about, **CORE)
    assert len(calls) <= left
    assert (found.statuses == wanted.statuses).all()
    assert_same_samples(found, wanted, *(("lam", "contact") if unique else ()))
    last = cp.simulate_batch(scene, *state, **(about | {"record": None}), **CORE)
    assert_allclose(last.q, np.broadcast_to(wanted.q, last.q.shape), rtol=0, atol=MOVED)
    for part in ("contact", "correction", "algorithmic") if unique else ():
        one, two = (getattr(x[0].energy, part) for x in (found, wanted))
        assert_allclose(one, two, rtol=0, atol=MOVED)


def assert_same_samples(
    found: cp.simulation.BatchTrajectory, wanted: cp.simulation.BatchTrajectory, *more: str
) -> None:
    for name in ("t", "q", "v", *more):
        one, two = np.broadcast_arrays(*(getattr(x.samples, name) for x in (found, wanted)))
        assert_allclose(one, two, rtol=0, atol=MOVED * max(1.0, np.abs(two).max()), err_msg=name)
    one, two = np.broadcast_arrays(found.samples.a, wanted.samples.a)
    assert_allclose(one, two, rtol=0, atol=MOVED / DT)
    for name in ("violation", "constraint_velocity", "energy_error"):
        one, two = np.broadcast_arrays(getattr(found, name), getattr(wanted, name))
        assert_allclose(one, two, rtol=0, atol=MOVED, err_msg=name)


# Starts and states: feet, stops, dry friction, loops, springs


def on_feet(its: str | cp.Robot, friction: float) -> Start:
    """A robot on its feet, with the torques that hold it."""
    its = robot(its) if isinstance(its, str) else its
    scene = cp.Scene(its, its.loops, contacts=its.frictional_contacts(friction))
    q, v = (x.copy() for x in scene.state())
    q[2] -= min(cp.dynamics.contact_gaps(scene, q).values())
    held = cp.Scene(its, (*its.loops, *its.contacts))
    return Start(scene, q, v, np.array(cp.inverse_dynamics(held, q, v, np.zeros(its.nv)).tau))


def solo(how: str) -> Start:
    scene, q, v, tau = on_feet("solo12", friction=0.3 if how == "slides" else 0.7)
    if how == "slides":
        v[:2] = 1.5, 0.4
    if how == "falls":
        q[2] += 0.15
        v[:6] = 0.4, 0.1, 0.0, 1.0, 0.5, 0.2
        tau *= 0.0
    v[6:] += np.random.default_rng(0).normal(scale=0.05, size=12)
    return Start(scene, q, v, tau)


def stands() -> Start:
    return solo("stands")


def slides() -> Start:
    return solo("slides")


def falls() -> Start:
    return solo("falls")


def many(start: Start, V: np.ndarray, lower: float = 0.0) -> Start:
    """States of one configuration, moved into the floor, or out of it."""
    q = start.q.copy()
    q[2] -= lower
    return Start(start.scene, np.tile(q, (len(V), 1)), np.array(V), start.tau)


def normal(seed: int, scale: float, count: int, nv: int) -> np.ndarray:
    return np.random.default_rng(seed).normal(scale=scale, size=(count, nv))


def at_stops() -> Start:
    """Ranges of joints that end near q, dry friction of some; springs and damping."""
    start = on_feet("solo12", friction=0.5)
    its = start.scene.robot
    model = pin.Model(its.model)
    model.lowerPositionLimit[7:] = start.q[7:] - 1e-4
    model.upperPositionLimit[7:] = start.q[7:] + 1e-4
    model.damping[6:] = 0.01
    joints = list(model.names)[2:]
    more = [JointLimit(joint) for joint in joints[:6]]
    more += [JointFriction(joint, 0.05) for joint in joints[3:]]
    springs = [cp.model.Spring(joint, stiffness=3.0, reference=0.1) for joint in joints[:4]]
    held = replace(its, model=model, springs=springs)
    scene = cp.Scene(held, contacts=(*start.scene.contacts, *more))
    return many(start._replace(scene=scene), normal(2, 0.5, 20, its.nv))


def in_the_air() -> Start:
    return many(on_feet("solo12", friction=0.7), normal(5, 1.0, 5, 18), lower=-0.5)


def walking() -> Start:
    """Solo12 with springs on its feet, that stands, slides and falls."""
    start = many(on_feet("solo12", friction=0.5), normal(4, 0.3, 20, 18))
    start.q[10:, 2] += np.random.default_rng(4).uniform(-1e-4, 5e-3, size=10)
    start.v[:4] *= 1e-2
    return start._replace(scene=sprung(start.scene))


def springs_in_the_air() -> Start:
    start = walking()
    start.q[:, 2] += 0.5
    return start


def foot_on_a_leg() -> Start:
    """Contacts between legs tie what the tree of joints does not."""
    start = on_feet("solo12", friction=0.7)
    model, frames = start.scene.robot.model, ("FL_FOOT", "HR_LOWER_LEG")
    data = model.createData()
    pin.framesForwardKinematics(model, data, start.q)
    foot, leg = (data.oMf[model.getFrameId(frame)] for frame in frames)
    above = float(leg.actInv(foot).translation[1])  # of the foot over the plane of the leg [m]
    plate = Plane((0.0, 1.0, 0.0), height=above - 0.01 + 1e-4)
    on_leg = FrictionalContact(
        frames[0], Ball(0.01), on=frames[1], on_shape=plate, friction=0.5, name="on leg"
    )
    scene = cp.Scene(start.scene.robot, contacts=(*start.scene.contacts, on_leg))
    return many(start._replace(scene=scene), normal(7, 0.1, 6, model.nv))


def soles() -> Start:
    """Of Talos, whose corners share the load."""
    start = on_feet("talos", friction=0.7)
    V = normal(6, 1e-3, 3, start.scene.robot.nv)
    V[0] = 0.0
    return many(start, V)


@functools.cache
def cassie() -> Start:
    its = cp.load_robot("cassie", variant={"feet": "points", "springs": "locked"})
    return on_feet(its, friction=0.7)


def loops(springs: bool = False) -> Start:
    """Cassie stands, and then falls under some torques."""
    start = cassie()
    scene, q, v, tau = start._replace(scene=sprung(start.scene) if springs else start.scene)
    rng, states = np.random.default_rng(3), [(q, v)]
    for _ in range(2):
        other = tau + 5.0 * rng.normal(size=len(tau))
        moved = cp.simulate(scene, q, v, other, duration=0.02, dt=DT)
        states += [*zip(moved.q[10:], moved.v[10:], strict=True)]
    Q, V = (np.array(x) for x in zip(*states, strict=True))
    return Start(scene, Q, V, tau)


def loops_with_springs() -> Start:
    return loops(springs=True)


def loops_in_the_air() -> Start:
    start = cassie()
    q = start.q.copy()
    q[2] += 0.5
    closed = cp.Scene(start.scene.robot, start.scene.robot.loops)
    V = [cp.mechanism.project_velocity(closed, q, v) for v in normal(4, 0.5, 4, len(start.v))]
    return many(start, V, lower=-0.5)


def strut() -> Start:
    """Loops are closed along springs that are part of M, as they turn: 1e-7 here."""
    strut = SpringDamper("crank_tip", "rocker_tip", 2e5, 50.0, 0.5)
    scene = with_springs(all_scenes()["four_bar loops"], strut)
    q, _ = scene.state()
    v = cp.mechanism.project_velocity(scene, q, np.full(scene.robot.nv, 5.0))
    return Start(scene, q[None], v[None], np.zeros(len(v)))


def branches() -> Start:
    """Ball joints, springs that join branches, and stops."""
    made = chain().robot
    scene = cp.Scene(made, contacts=[JointFriction("branch", 0.1)])
    rng, free = np.random.default_rng(8), pin.neutral(made.model)
    Q = [pin.integrate(made.model, free, rng.uniform(-1, 1, made.nv)) for _ in range(6)]
    return Start(scene, np.array(Q), rng.normal(size=(6, made.nv)), np.zeros(made.nv))


def a_foot_held() -> Start:
    """Beside feet that are not."""
    start = on_feet("solo12", friction=0.5)
    its = start.scene.robot
    rest = cp.Scene(its, its.contacts[:1])
    v = cp.impact(rest, start.q, normal(5, 0.2, 1, its.nv)[0]).v
    scene = cp.Scene(its, its.contacts[:1], contacts=start.scene.contacts[1:])
    return Start(scene, start.q, v, start.tau)


# Starts: shapes that meet


def cradle() -> Start:
    """Three pendulums that swing into each other."""
    model, at = pin.Model(), pin.SE3(np.eye(3), np.array([0.0, 0.0, -0.5]))
    for i in range(3):
        pivot = pin.SE3(np.eye(3), np.array([0.2002 * i, 0.0, 0.0]))
        joint = model.addJoint(0, pin.JointModelRY(), pivot, f"pivot {i}")
        model.appendBodyToJoint(joint, pin.Inertia.FromSphere(1.0, 0.1), at)
        model.addFrame(pin.Frame(f"bob {i}", joint, 0, at, pin.FrameType.OP_FRAME))
    contacts = [
        FrictionalContact(
            f"bob {i + 1}", Ball(0.1), on=f"bob {i}", on_shape=Ball(0.1), friction=0.2
        )
        for i in range(2)
    ]
    scene = cp.Scene(cp.Robot("cradle", model), contacts=contacts)
    return at_rest(scene, [0.1, 0.0, 0.0], [-1.5, 0.0, 0.2])


def gripper() -> Start:
    """Two fingers that close on a box, one harder than the other, and lift it from the floor."""
    model = pin.Model()
    lift = model.addJoint(0, pin.JointModelPZ(), pin.SE3.Identity(), "lift")
    palm, finger = (pin.Inertia.FromBox(m, 0.02, 0.04, 0.06) for m in (0.5, 0.2))
    model.appendBodyToJoint(lift, palm, pin.SE3.Identity())
    for name, x in (("left", -0.063), ("right", 0.063)):
        at = pin.SE3(np.eye(3), np.array([x, 0.0, 0.05]))
        joint = model.addJoint(lift, pin.JointModelPX(), at, name)
        model.appendBodyToJoint(joint, finger, pin.SE3.Identity())
        model.addFrame(pin.Frame(f"{name} pad", joint, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    thing = free_box(mass=0.3, size=(0.1, 0.1, 0.1))
    robot = together({"hand": cp.Robot("hand", model), "thing": thing})
    half, pad = Box(0.05, 0.05, 0.05), Box(0.01, 0.02, 0.03)
    contacts = [FrictionalContact("thing/box", half, friction=0.5)]
    contacts += [
        FrictionalContact(f"hand/{side} pad", pad, on="thing/box", on_shape=half, friction=0.8)
        for side in ("left", "right")
    ]
    q = pin.neutral(robot.model)
    q[5] = 0.05
    tau = np.zeros(robot.nv)
    tau[:3] = 1.2 * 9.81 + 1.5, 12.0, -11.0
    return at_rest(cp.Scene(robot, contacts=contacts), q, None, tau)


def kick() -> Start:
    """Talos, which stands, and a box that slides against its toes."""
    talos, q, v, tau = on_feet("talos", friction=0.5)
    robot = together({"talos": talos.robot, "thing": free_box(mass=2.0)})
    half = Box(0.1, 0.1, 0.1)
    foot = {"shape": Box(0.0965, 0.062, 0.02), "offset": (0.0, 0.0, 0.02), "friction": 0.4}
    soles = [
        FrictionalContact(
            f"talos/{side}_sole_link", on="thing/box", on_shape=half, name=f"{side} toe", **foot
        )
        for side in ("left", "right")
    ]
    floor = FrictionalContact("thing/box", half, friction=0.3)
    scene = cp.Scene(robot, contacts=[*robot.frictional_contacts(0.5), floor, *soles])
    data = talos.robot.model.createData()
    pin.framesForwardKinematics(talos.robot.model, data, q)
    sole = data.oMf[talos.robot.model.getFrameId("left_sole_link")].translation
    box = [sole[0] + 0.0965 + 0.102, 0.0, 0.1, 0.0, 0.0, 0.0, 1.0]
    moving = [-1.0, 0.0, 0.0, 0.0, 0.0, 0.3]
    return at_rest(scene, [*q, *box], [*v, *moving], [*tau, *np.zeros(6)])


def tower() -> Start:
    """Three boxes on each other on the floor, the lowest one pushed."""
    names = ("low", "middle", "high")
    robot = together({name: free_box(size=(0.2, 0.2, 0.1)) for name in names})
    half = Box(0.1, 0.1, 0.05)
    contacts = [FrictionalContact("low/box", half, friction=0.3)]
    contacts += [
        FrictionalContact(f"{high}/box", half, on=f"{low}/box", on_shape=half, friction=0.4)
        for low, high in pairwise(names)
    ]
    q, v = pin.neutral(robot.model), np.zeros(18)
    q[2::7] = 0.05, 0.15, 0.2502
    v[0], v[17] = 1.0, 0.5
    return at_rest(cp.Scene(robot, contacts=contacts), q, v)


def heap() -> Start:
    """A ball and a capsule that fall on a box."""
    robot = together({name: free_box(size=(0.2, 0.2, 0.1)) for name in ("box", "ball", "rod")})
    half = Box(0.1, 0.1, 0.05)
    on_box = {"on": "box/box", "on_shape": half, "friction": 0.5}
    contacts = [
        FrictionalContact("box/box", half, friction=0.5),
        FrictionalContact("ball/box", Ball(0.05), **on_box),
        FrictionalContact("rod/box", Capsule(0.03, 0.06), **on_box),
        FrictionalContact(
            "rod/box", Capsule(0.03, 0.06), on="ball/box", on_shape=Ball(0.05), friction=0.2,
            name="rod on ball",
        ),
    ]  # fmt: skip
    q, v = pin.neutral(robot.model), np.zeros(18)
    q[:3], q[7:10], q[14:17] = (0.0, 0.0, 0.05), (-0.06, 0.0, 0.151), (0.09, 0.01, 0.145)
    q[17:21] = 0.0, np.sin(0.7), 0.0, np.cos(0.7)
    v[6], v[12] = 0.5, -0.5
    return at_rest(cp.Scene(robot, contacts=contacts), q, v)


def shin_on_a_step() -> Start:
    """Solo12 falls on its feet, with a shin on an obstacle of the world."""
    solo = cp.load_robot("solo12")
    q = np.array(cp.Scene(solo).state()[0])
    q[2] += 0.02
    data = solo.model.createData()
    pin.framesForwardKinematics(solo.model, data, q)
    x, y, z = data.oMf[solo.model.getFrameId("FL_FOOT")].translation
    solo = solo.with_frame("step", "universe", (x, y, z - 0.087))
    obstacle = FrictionalContact(
        "FL_FOOT", Capsule(0.02, 0.05), on="step", on_shape=Box(0.04, 0.3, 0.03), friction=0.5,
        name="obstacle",
    )  # fmt: skip
    feet = solo.frictional_contacts(0.6)[1:]
    return at_rest(cp.Scene(solo, contacts=[*feet, obstacle]), q)


# Starts: what rolls, and blades


def wall(frame: str, x: float, radius: float) -> FrictionalContact:
    """A wall across the way at x [m] against a ball about a frame."""
    plane = Plane(normal=(-1.0, 0.2, 0.0), height=-x)
    return FrictionalContact(frame, Ball(radius), on=plane, friction=0.3, name="wall")


def ball() -> Start:
    robot = cp.model.rolling_ball()
    scene = cp.Scene(robot, robot.contacts, contacts=[wall("centre", 0.13, 0.1)])
    return thrown(scene, scene.state()[0], [1.0, 0.3, 0.0, -3.0, 10.0, 2.0], [2.0, 0, 0, 0, 0, 0])


def disc() -> Start:
    robot = cp.model.rolling_disc()
    scene = cp.Scene(robot, robot.contacts, contacts=[wall("centre", 0.13, 0.1)])
    return thrown(scene, robot.postures["leaning"], [0.5, 0.0, 0.0, 0.2, 5.0, 1.0])


def unicycle() -> Start:
    """With a heading that turns; a motor goes on while it is at the wall."""
    robot = cp.model.unicycle()
    scene = cp.Scene(robot, robot.contacts, contacts=[wall("wheel", 0.32, 0.3)])
    return thrown(scene, np.zeros(4), [0.6, 0.0, 0.5, 2.0], [0.0, 0.0, 0.02, 0.3])


def wagon() -> Start:
    """Two wheels and a caster, whose rows are redundant."""
    bare = cart()
    contacts = [wall("left_wheel", 0.45, 0.2), JointFriction("left", 0.1)]
    scene = cp.Scene(bare.robot, bare.constraints, contacts=contacts)
    v, tau = np.zeros((2, scene.robot.nv))
    v[[0, 5]], tau[6:8] = (0.8, 0.4), 0.5
    return thrown(scene, scene.robot.postures["standing"], v, tau)


def blade() -> Start:
    """A body that slides on a ball along a knife edge, which has no place."""
    floor = FrictionalContact("box", Ball(0.05), friction=0.1, name="floor")
    box = free_box(size=(0.2, 0.2, 0.1))
    scene = cp.Scene(box, [KnifeEdge("box", axis="y")], contacts=[floor])
    q = pin.neutral(box.model)
    q[2] = 0.0502
    return thrown(scene, q, [1.0, 0.5, 0.0, 0.2, 0.1, 3.0])


def beside_feet(*held: object) -> Start:
    """Solo12, a front foot or two held; hind feet stand, slide and open."""
    scene, q, _, tau = on_feet("solo12", friction=0.4)
    v = np.random.default_rng(5).normal(scale=0.6, size=scene.robot.nv)
    beside = cp.Scene(scene.robot, held, contacts=scene.contacts[2:])
    return thrown(beside, q, v, tau)


def rolling_foot() -> Start:
    """On a plane through where its motion begins."""
    return beside_feet(RollingBall("FL_FOOT", 0.0165))


def flat_foot() -> Start:
    return beside_feet(PlanarContact("FR_FOOT"))


def foot_on_an_edge() -> Start:
    return beside_feet(LineContact("FL_FOOT"))


# Starts: driven rows


def plate() -> Start:
    """It overtakes a box, pushes it, and leaves it to slide on."""
    path = Polynomial((0.0, 0.6, 0.8, -1.6))
    return at_rest(pushing(path), [0.0, 0.05, 0.0], [0.6, 0.0, 0.0])


def motor() -> Start:
    """Along the driven row G is zero, and the contact slides there all the same."""
    floor = FrictionalContact("box_frame", friction=FRICTION)
    driven = Driven(HeldJoint("along"), Sine(0.05, 4.0))
    scene = cp.Scene(pushed(), [driven], contacts=[floor])
    return at_rest(scene, np.zeros(3), [0.0, 0.4 * np.pi, 0.0])


def crank() -> Start:
    """A loop beside a drive, and dry friction that turns."""
    scene = driven_bar(Sine(0.4, 0.7))
    return at_rest(scene, *scene.state())


def knees() -> Start:
    """Solo12 on its feet, knees geared and bent: feet stand, slide and open."""
    scene, q, v, tau = on_feet("solo12", friction=0.4)
    at = q[scene.robot.model.joints[scene.robot.model.getJointId("HL_KFE")].idx_q]
    geared = Driven(Coupling("FL_KFE", "FR_KFE", 1.0), Sine(0.05, 4.0))
    held = Driven(HeldJoint("HL_KFE", at), Sine(-0.05, 5.0))
    scene = cp.Scene(scene.robot, [geared, held], contacts=scene.contacts)
    return thrown(scene, q, v, tau)


def piston() -> Start:
    """A body on a ball that falls on the floor, dragged to and fro by a rod."""
    box = free_box(size=(0.2, 0.2, 0.1)).with_frame("hook", "box", (-0.1, 0.02, 0.03))
    rod = cp.Loop("hook", "world", "rod", length=0.32)
    floor = FrictionalContact("box", Ball(0.05), friction=0.4)
    scene = cp.Scene(box, [Driven(rod, Sine(0.02, 5.0))], contacts=[floor])
    q = pin.neutral(box.model)
    q[:3] = 0.1 + np.sqrt(0.32**2 - 0.02**2 - 0.085**2), 0.0, 0.055
    return thrown(scene, q, np.zeros(6))


def belt() -> Start:
    """A ball on a belt that speeds up, thrown against a wall."""
    ball = cp.model.rolling_ball()
    path = Polynomial(((0.0, 0.0, 1.0), (0.0, 0.1, 0.0), (0.0, 0.0, 0.0)))
    rolls = Driven(RollingBall("centre", 0.1, height=0.0), path)
    away = Plane(normal=(-1.0, 0.2, 0.0), height=-0.12)
    wall = FrictionalContact("centre", Ball(0.1), on=away, friction=0.3, name="wall")
    scene = cp.Scene(ball, [rolls], contacts=[wall])
    q, _ = scene.at(0.0).state()
    return thrown(scene, q, [0.4, 0.1, 0, 0, 4.0, 0.3])


# The table


@dataclass(frozen=True)
class Case:
    """States, or a start and how long it moves [s]; what they go through, and how near they are.

    Where bodies stand, derivatives are of states that are `lower` [m]: a gap of zero is a kink.
    """

    make: Callable[[], Start]
    duration: float = 0.0
    modes: frozenset[int] = frozenset()
    unique: bool = True  # of forces: at a wall what rolls is held by both
    # to Python, of steps and of derivatives: where rank or modes leave a doubt
    left: tuple[float, float] = (0, 0)
    rounded: float = ROUNDED
    of_slopes: float = 1e-9
    lower: float = 0.0
    # of forces and of derivatives: those that are smaller may be rounding alone
    floors: tuple[float, float] = (0.0, 0.0)


ANY = (np.inf, np.inf)
ALL, NEVER_STICKS, IN_THE_AIR = frozenset({0, 1, 2}), frozenset({0, 2}), frozenset({0})
CASES = {
    case.make.__name__: case
    for case in (
        Case(stands, 0.1, frozenset({1}), lower=1e-4),
        Case(slides, 0.1, frozenset({2}), lower=1e-4),
        Case(falls, 0.3, ALL, lower=1e-4),
        Case(at_stops, modes=ALL, left=ANY, rounded=1e-11, lower=1e-4),
        Case(in_the_air, modes=IN_THE_AIR),
        Case(walking, modes=ALL, lower=1e-4),
        Case(springs_in_the_air, modes=IN_THE_AIR),
        Case(foot_on_a_leg, modes=ALL, lower=1e-4),
        Case(soles, modes=frozenset({1}), unique=False, rounded=1e-10, of_slopes=1e-8, lower=1e-4),
        # loops as they are there: 1 / 1.3e-5; those that fall close by factors of where they end
        Case(loops, left=(0, 2), rounded=1e-10, of_slopes=1e-8, lower=1e-4),
        Case(loops_with_springs, left=(0, 2), rounded=1e-10, of_slopes=1e-8, lower=1e-4),
        Case(loops_in_the_air, modes=IN_THE_AIR, rounded=1e-10, of_slopes=1e-8),
        Case(strut),
        Case(branches),
        Case(a_foot_held, 0.03, lower=1e-4),
        Case(ball, 0.2, frozenset({0, 1}), unique=False),
        Case(disc, 0.2, NEVER_STICKS, unique=False),
        Case(unicycle, 0.3, ALL, unique=False, floors=(0.0, 1.0)),
        Case(wagon, 0.2, NEVER_STICKS, unique=False, left=(2, 2)),
        Case(blade, 0.2, NEVER_STICKS),
        Case(rolling_foot, 0.1, NEVER_STICKS),
        Case(flat_foot, 0.05, frozenset({2})),
        Case(foot_on_an_edge, 0.1, NEVER_STICKS),
        Case(plate, 0.4, ALL, floors=(0.0, 1.0)),
        Case(motor, 0.2, frozenset({2})),
        Case(crank, 0.4, frozenset({2}), floors=(0.0, 1.0)),
        Case(knees, 0.1, ALL),
        Case(piston, 0.2, ALL),
        Case(belt, 0.2, NEVER_STICKS, floors=(1.0, 0.0)),
    )
}


@functools.cache
def groups_of(label: str) -> list[Start]:
    case = CASES[label]
    return along(case.make(), case.duration) if case.duration else [case.make()]


@pytest.mark.parametrize("label", CASES)
def test_steps_and_their_derivatives(label, monkeypatch):
    case, modes, acted, left = CASES[label], set(), False, np.zeros(2, int)
    for group in groups_of(label):
        found, wanted, count = steps_of(group, monkeypatch)
        assert wanted.ok
        about = {"rounded": case.rounded, "unique": case.unique, "floor": case.floors[0]}
        assert_same_steps(found, wanted, **about)
        modes |= set(np.unique(found.codes).tolist())
        acted |= found.codes.any(axis=0)
        if label == "loops":
            assert found.errors[:, ERRORS.index("violation")].max() <= 1e-12
        left[0] += count
        q = group.q.copy()
        q[:, 2] -= case.lower
        found, wanted, count = slopes_of(group._replace(q=q), monkeypatch)
        assert wanted.ok
        assert_same_slopes(found, wanted, case.of_slopes, case.floors[1])
        left[1] += count
        if label == "in_the_air":
            assert_allclose(found.dq, wanted.dq, rtol=0, atol=1e-12)
            assert_allclose(found.dv, wanted.dv, rtol=0, atol=1e-9)
        if label == "strut":
            assert found.step.errors[0, 6] != 0.0  # what moving q back has brought
    assert (left <= case.left).all()
    assert case.modes <= modes
    if case.modes == IN_THE_AIR:
        assert modes == IN_THE_AIR
    elif case.unique:  # else some corners carry nothing
        assert acted.all()


@pytest.mark.parametrize("label", [label for label, case in CASES.items() if case.duration])
def test_motions(label, monkeypatch):
    """Also where the last sample is that of a step that is not taken."""
    case = CASES[label]
    about = {"unique": case.unique, "left": 20 * case.left[0]}  # of 600
    assert_same_motions(case.make(), case.duration, monkeypatch, record=7, **about)
    assert_same_motions(case.make(), case.duration / 2, monkeypatch, record=10, **about)


@pytest.mark.long
def test_motions_on_feet_with_springs(monkeypatch):
    scene, Q, V, tau = walking()
    assert_same_motions(Start(scene, Q[0], V[0], tau), 0.05, monkeypatch, record=4)


# Shapes that meet


SHAPES = {
    "point": Point(),
    "ball": Ball(0.1),
    "capsule": Capsule(0.05, 0.3),
    "box": Box(0.2, 0.15, 0.1),
    "wedge": Convex(((0, 0, 0.1), (0.1, 0, -0.05), (-0.06, 0.08, -0.05), (-0.06, -0.08, -0.04))),
}
COMBINATIONS = [
    pair for pair in combinations_with_replacement(SHAPES, 2) if pair != ("point", "point")
]


def pairs_of(one: object, two: object, gaps: tuple[float, ...], each: int, speed: float) -> Start:
    """Two bodies in the air at any angle."""
    scene, rng = scene_of(one, two), np.random.default_rng(3)
    pin.seed(5)
    Q = np.array([near(one, two, rng, gap) for gap in gaps for _ in range(each)])
    return Start(scene, Q, rng.normal(scale=speed, size=(len(Q), 12)), np.zeros(12))


@pytest.mark.parametrize(("one", "two"), COMBINATIONS)
def test_two_bodies_in_the_air(one, two, monkeypatch):
    """Near each other, far away, and a little into each other: steps and their derivatives."""
    for names in {(one, two), (two, one)}:
        shapes = (SHAPES[name] for name in names)
        group = pairs_of(*shapes, (5e-4, 1e-4, 2e-3, -1e-5, 0.3), 3, speed=0.5)
        found, wanted, left = steps_of(group, monkeypatch)
        assert left <= 1  # Newton's method has no answer of one rod that is in a box
        assert_same_steps(found, wanted)
        assert found.codes.any()
        found, wanted, left = slopes_of(group, monkeypatch)
        assert left <= 1
        assert_same_slopes(found, wanted)


@pytest.mark.long
def test_long_steps_end_where_shapes_meet_there(monkeypatch):
    """A rod that turns by a radian within a step meets a box in other points at its end."""
    group = pairs_of(SHAPES["capsule"], SHAPES["box"], (1e-2,), 30, speed=8.0)
    found, wanted, _ = steps_of(group, monkeypatch, dt=2e-2)
    assert_array_equal(found.statuses, wanted.statuses)
    assert_allclose(found.v, wanted.v, rtol=0, atol=1e-9)
    assert found.codes.any()


def test_derivatives_of_points_in_doubt_are_left_to_python(monkeypatch):
    """A point on a wire, whose normal turns by any angle at once."""
    scene = scene_of(SHAPES["point"], Capsule(1e-10, 0.3))
    Q = np.array([placed(above(0.05, x=x)) for x in (1.5e-10, 1e-5)])
    V = np.tile([-0.3, 0.1, -0.4, *np.zeros(9)], (2, 1))
    found, wanted, left = slopes_of(Start(scene, Q, V, np.zeros(12)), monkeypatch)
    assert found.codes.all()
    assert left == 1
    assert_array_equal(found.dv[0], wanted.dv[0])
    assert_same_slopes(found, wanted)


# How long each moves [s], its modes, and at most how many are left to Python: of steps of a motion,
# and of 40 derivatives. Python has more ways than Newton's method to answer contacts that share a
# load; which steps take them hangs on rounding. Where most do, motions are not compared.
MEETING = {
    cradle: (0.2, {0, 2}, 0, 0), gripper: (0.1, {0, 1}, 10, 30),
    shin_on_a_step: (0.15, {0, 2}, 10, 5), heap: (0.15, {0, 1, 2}, 5, 20),
    kick: (0.05, {0, 1, 2}, None, 30), tower: (0.02, {0, 1, 2}, None, 38),
}  # fmt: skip
each_meeting = pytest.mark.parametrize("make", MEETING, ids=lambda make: make.__name__)
meeting = functools.cache(lambda make: along(make(), MEETING[make][0])[0])


@each_meeting
def test_steps_of_shapes_that_meet(make, monkeypatch):
    """Where redundant contacts slide and turn, Coulomb's law has several answers: Python's rule."""
    group, modes = meeting(make), MEETING[make][1]
    with by_python(monkeypatch, steps, "step") as calls:
        found = step_batch(*group, dt=DT, **CORE)
    several = 0
    for q, v in zip(group.q, group.v, strict=True):
        notices = cp.step(group.scene, q, v, group.tau, dt=DT).notices
        several += any("not determined by Coulomb's law" in notice for notice in notices)
    # where contacts share a load some take more ways than the core has: which do hangs on rounding
    assert several <= len(calls) <= several + len(group.q) // 10
    assert found.ok
    assert found.errors[:, 1].max() <= 1e-12  # of the balance of momentum
    assert modes <= set(np.unique(found.codes).tolist())
    names = Candidates(group.scene.robot.model, group.scene.contact_bounds).names
    for q, v, lam in zip(group.q, group.v, found.lam, strict=True):
        problem = contact_problem(group.scene, q, v, group.tau, dt=DT)
        of_each = dict(zip(names, lam.reshape(-1, 3), strict=True))
        impulses = np.concatenate([np.zeros(0), *(of_each.pop(name) for name in problem.names)])
        assert natural_residual(problem, impulses) <= CONTACT_SOLVED
        assert not any(map(np.any, of_each.values()))
    if make is cradle:  # nothing is redundant
        found, wanted, left = steps_of(group, monkeypatch)
        assert left == 0
        assert_same_steps(found, wanted)


@pytest.mark.once
@each_meeting
def test_derivatives_of_shapes_that_meet(make, monkeypatch):
    """Where redundant contacts slide the law has several answers: equal ones are compared."""
    group = beside(make)
    found, wanted, left = slopes_of(group, monkeypatch)
    assert left <= MEETING[make][3]
    assert_array_equal(found.failed, wanted.failed)
    off = np.abs(found.step.lam - wanted.step.lam).max(axis=1)
    same = off <= 1e-9 * np.abs(wanted.step.lam).max(axis=1)
    same &= (found.codes == wanted.codes).all(axis=1)  # rounding chooses where a contact is on edge
    same[wanted.failed] = False
    assert np.count_nonzero(same) >= 20
    for name in ("dq", "dv"):
        one, two = getattr(found, name)[same], getattr(wanted, name)[same]
        sizes = np.abs(two).max(axis=(1, 2))
        assert (np.abs(one - two).max(axis=(1, 2)) <= 1e-9 * sizes).all()
    assert np.count_nonzero(found.codes[same].any(axis=1)) >= 10
    if make is cradle:
        assert assert_differences(group.scene, group.q[::4], group.v[::4], **CORE) >= 5


def beside(make: Callable[[], Start]) -> Start:
    """States near a motion: in the motion itself gaps of zero are kinks."""
    group = meeting(make)
    model, moves = group.scene.robot.model, normal(4, 2e-4, *group.v.shape)
    Q = [pin.integrate(model, q, move) for q, move in zip(group.q, moves, strict=True)]
    return group._replace(q=np.array(Q))


@pytest.mark.parametrize("make", [cradle, gripper, shin_on_a_step, heap], ids=lambda x: x.__name__)
def test_motions_of_shapes_that_meet(make, monkeypatch):
    """Forces of flat contacts may be shared in many ways: velocities are compared."""
    duration, _, left, _ = MEETING[make]
    assert_same_motions(make(), duration, monkeypatch, unique=make is cradle, left=left)


def boxes() -> Start:
    """A box over a slanted plane, a ball and a capsule over the floor, and how they move."""
    bodies = together({name: free_box(size=(0.2, 0.1, 0.1)) for name in ("box", "ball", "rod")})
    slope = Plane((0.3, 0.1, 1.0))
    contacts = [
        FrictionalContact("box/box", Box(0.1, 0.05, 0.05), on=slope, friction=0.4),
        FrictionalContact("ball/box", Ball(0.05), friction=0.4),
        FrictionalContact("rod/box", Capsule(0.05, 0.05), friction=0.0),
    ]
    scene, rng = cp.Scene(bodies, contacts=contacts), np.random.default_rng(1)
    Q = np.tile(pin.neutral(scene.robot.model), (40, 1))
    for place in range(3):
        Q[:, 7 * place : 7 * place + 3] = rng.uniform(-0.02, 0.02, size=(40, 3))
        Q[:, 7 * place] += place
        Q[:, 7 * place + 2] += rng.uniform(0.05, 0.15, size=40)
        turn = rng.normal(size=(40, 4))
        Q[:, 7 * place + 3 : 7 * place + 7] = turn / np.linalg.norm(turn, axis=1)[:, None]
    return Start(scene, Q, rng.normal(scale=2.0, size=(40, 18)), np.zeros(18))


def test_balls_capsules_and_boxes_over_planes(monkeypatch):
    group = boxes()
    found, wanted, _ = steps_of(group, monkeypatch, dt=5e-3)
    assert_array_equal(found.statuses, wanted.statuses)
    assert_allclose(found.v, wanted.v, rtol=0, atol=1e-9)
    assert set(np.unique(found.codes)) >= {0, 1, 2}
    fine = Start(group.scene, group.q[:20], 0.5 * group.v[:20], group.tau)
    found, wanted, _ = slopes_of(fine, monkeypatch, dt=2e-3)
    assert wanted.ok
    assert_same_slopes(found, wanted)
    assert set(np.unique(found.codes)) >= {0, 1, 2}


# What laws, methods and starts are special


def only_the_core(monkeypatch: pytest.MonkeyPatch) -> None:
    """Python takes no step of a batch."""

    def none(*_: object, **__: object) -> None:
        raise AssertionError("a step was left to Python")

    monkeypatch.setattr(steps, "step", none)
    monkeypatch.setattr(motions, "follow", none)
    monkeypatch.setattr(slopes.DifferentiatedRows, "row", none)


@pytest.mark.parametrize("how", ["stands", "slides", "walking"])
def test_the_core_leaves_nothing_that_stands_or_slides(how, monkeypatch):
    only_the_core(monkeypatch)
    (group,) = groups_of(how)
    for by in (cp.StewartTrinkle(contact=ADMM()), EXACT):
        assert step_batch(*group, dt=DT, integrator=by, **CORE).ok
        assert step_derivatives_batch(*group, dt=DT, integrator=by, **CORE).ok
        first = Start(group.scene, group.q[:3], group.v[:3], group.tau)
        assert cp.simulate_batch(*first, duration=0.02, dt=DT, integrator=by, **CORE).ok


def test_quaternions_that_are_off_are_normalised_as_in_python(monkeypatch):
    (group,) = groups_of("slides")
    q = group.q.copy()
    q[1::2, 3:7] *= 1.0 + 1e-7  # a step from such a q as it is would be off by as much
    starts = q.copy()
    found, wanted, _ = steps_of(group._replace(q=q), monkeypatch)
    assert_same_steps(found, wanted)
    assert_array_equal(q, starts)


@pytest.mark.long
@pytest.mark.parametrize("how", ["stands", "slides", "falls"])
def test_by_default_it_is_as_near_to_the_answer_as_python(how):
    """Python's ADMM leaves up to 1e-8 of what slides, and the core begins with Newton's method."""
    (group,) = groups_of(how)
    exact, wanted = step_batch(*group, **ABOUT), step_batch(*group, dt=DT)
    found = step_batch(*group, dt=DT, **CORE)
    assert_same_steps(found, exact)
    assert found.natural.max() <= max(wanted.natural.max(), 1e-13)


@pytest.mark.long
def test_what_sticks_is_judged_by_its_velocity_too(monkeypatch):
    """Friction makes a thousand times too much of its slip."""
    scene, *state = on_a_rough_floor("talos", MOST_FRICTION)
    wanted = step_batch(scene, *(x[None] for x in state), dt=DT)
    only_the_core(monkeypatch)
    found = step_batch(scene, *(x[None] for x in state), dt=DT, **CORE)
    assert_array_equal(found.codes, wanted.codes)
    assert_allclose(found.v, wanted.v, rtol=0, atol=1e-10)
    assert 1e-10 < found.natural.max() < 1e-9  # what is left of the slip, and not a thousand times


def assert_as_near_as_residuals(found: BatchStep, wanted: BatchStep) -> None:
    assert wanted.ok
    assert_array_equal(found.statuses, wanted.statuses)
    left = 100 * np.maximum(found.natural, wanted.natural) + ROUNDED
    size = max(1.0, np.abs(wanted.v).max())
    assert (np.abs(found.v - wanted.v).max(axis=1) <= left * size).all()
    assert max(found.natural.max(), wanted.natural.max()) <= CONTACT_SOLVED


# Nothing reaches a tolerance of zero: Newton's method ends each step.
ALTERNATING = [
    ADMM(anderson=0), ADMM(anderson=2), ADMM(tolerance=1e-10), ADMM(tolerance=1e-5),
    ADMM(polish=True), ADMM(max_iterations=5), ADMM(max_iterations=999), ADMM(tolerance=0.0),
]  # fmt: skip


@pytest.mark.once  # two solvers of one G and g
@pytest.mark.parametrize("contact", ALTERNATING, ids=repr)
def test_alternating_directions(contact, monkeypatch):
    """Iteration by iteration, and what is tried where they fail.

    Few stall until the iterations end, and some are led ahead by nearly singular memories: these
    carry rounding on, and are as near as their residuals. Stops and dry friction are beside feet.
    """
    by = cp.StewartTrinkle(contact=contact)
    for how in ("stands", "slides", "falls", "at_stops"):
        (group,) = groups_of(how)
        found, wanted, _ = steps_of(group, monkeypatch, integrator=by)
        assert_as_near_as_residuals(found, wanted)
        iterates = not (contact.polish or contact.tolerance > 1e-8 or contact.max_iterations < 9)
        iterates &= contact.tolerance > 0.0
        if pin.__version__ == HEADERS and how != "at_stops" and contact.tolerance > 0.0:
            # another version has another iteration
            assert np.median(np.abs(found.v - wanted.v).max(axis=1)) <= ROUNDED
            assert np.median(np.abs(found.natural - wanted.natural)) <= ROUNDED
            slides = 2 in np.unique(found.codes)
            assert not (slides and iterates) or found.natural.max() > 1e-12  # none is polished


@pytest.mark.long
@pytest.mark.parametrize("contact", [ADMM(), ADMM(anderson=0), ADMM(polish=True)], ids=repr)
def test_alternating_directions_of_islands(contact, monkeypatch):
    """Three bodies apart: each by itself."""
    by = {"dt": 5e-3, "integrator": cp.StewartTrinkle(contact=contact)}
    found, wanted, _ = steps_of(boxes(), monkeypatch, **by)
    fine = wanted.statuses == 0
    assert fine.mean() > 0.8
    assert_array_equal(found.statuses, wanted.statuses)
    if contact.polish:
        assert_allclose(found.v[fine], wanted.v[fine], rtol=0, atol=1e-9)


def test_a_step_that_is_hard_is_left_to_python(monkeypatch):
    """One in which soles contradict each other by their gaps; the motion goes on in the core."""
    scene, q, v, tau = on_feet("talos", friction=0.7)
    v[0] = 0.2
    about = {"duration": 0.03, "dt": DT, "record": 4}
    wanted = cp.simulate_batch(scene, q[None], v[None], tau, **about)
    only_the_core(monkeypatch)
    with by_python(monkeypatch, motions.ContactSteps, "step") as taken:
        found = cp.simulate_batch(scene, q[None], v[None], tau, **about, **CORE)
    assert 0 < len(taken) < 15
    assert_array_equal(found.statuses, wanted.statuses)
    assert_allclose(found.samples.t, wanted.samples.t, rtol=0, atol=1e-15)
    assert_allclose(found.samples.v, wanted.samples.v, rtol=0, atol=1e-6)
    assert_allclose(found.energy_error, wanted.energy_error, rtol=1e-4)
    assert found.samples.contact[..., 0].max() <= CONTACT_SOLVED


def test_what_the_core_leaves_of_a_motion_is_taken_by_python(monkeypatch):
    """A step in between: the motion goes on in the core, with the work that the drive did."""
    scene, q, v, tau = knees()
    about = {"duration": 0.1, "record": 7, **ABOUT}
    wanted = cp.simulate_batch(scene, q[None], v[None], tau, **about)

    def short(*about: object) -> StepPlan:  # Newton's method ends early, most often at no answer
        plan = step_plan(*about)
        return plan._replace(method=plan.method._replace(steps=5), solved=1e-12)

    monkeypatch.setattr(motions, "step_plan", short)
    with by_python(monkeypatch, motions.ContactSteps, "step") as taken:
        found = cp.simulate_batch(scene, q[None], v[None], tau, **about, **CORE)
    assert 5 < len(taken) < 95
    assert_same_samples(found, wanted, "lam", "contact")


@pytest.mark.long
def test_samples_behind_steps_of_python_have_their_energies(monkeypatch):
    """Where the core takes no step, every one is left to Python."""

    class Idle:
        def simulate(self, **_: object) -> None:
            """Take none."""

    scene, Q, V, tau = walking()
    about = {"duration": 0.02, "dt": DT, "record": 1}
    wanted = cp.simulate_batch(scene, Q[:1], V[:1], tau, **about)
    monkeypatch.setattr(motions, "contacts_of", lambda *_: Idle())
    found = cp.simulate_batch(scene, Q[:1], V[:1], tau, **about, **CORE)
    assert np.ptp(wanted[0].energy.springs) > 1e-4
    assert wanted[0].energy.damping[-1] < -1e-4
    assert_allclose(found.v, wanted.v, rtol=0, atol=1e-12)
    assert_allclose(found.energy_error, wanted.energy_error, rtol=0, atol=1e-12)


def test_a_foot_that_is_held_is_anchored_where_each_motion_begins(monkeypatch):
    """And nowhere in steps that follow."""
    scene, q, v, tau = a_foot_held()
    moved = q.copy()
    moved[0] += 0.1
    found, wanted, _ = steps_of(Start(scene, moved[None], v[None], tau), monkeypatch)
    assert_same_steps(found, wanted)
    two = np.array([q, moved]), np.array([v, v])
    how = {"duration": 0.03, "record": 10, **ABOUT}
    found, wanted = (cp.simulate_batch(scene, *two, tau, **how, **by) for by in (CORE, {}))
    assert wanted.ok
    assert_same_samples(found, wanted)
    assert_allclose(found.violation, wanted.violation, rtol=0, atol=1e-12)


@pytest.mark.long
@pytest.mark.parametrize("corners", [slice(0, 8), slice(1, 4), slice(5, 8), slice(2, 6)])
@pytest.mark.parametrize("soles", [1, 2])
def test_corners_beside_soles_that_constraints_hold(soles, corners, monkeypatch):
    """Without a redundant row the factors of the constraints read what nobody had set."""
    its = robot("talos")
    feet = its.frictional_contacts(friction=0.7)[corners]
    scene = cp.Scene(its, its.contacts[:soles], contacts=feet)
    q, _ = scene.state(on_ground=False)
    V = [cp.mechanism.project_velocity(scene, q, v) for v in normal(0, 1.0, 3, its.nv)]
    group = Start(scene, np.tile(q, (3, 1)), np.array(V), np.zeros(its.nv))
    found, wanted, _ = steps_of(group, monkeypatch)
    assert_same_steps(found, wanted, rounded=1e-10)
    assert found.errors[:, 2].max() <= 1e-11


@pytest.mark.parametrize("r", [1e-6, 2e-11])
def test_impulses_that_rounding_balances_are_not_ok_here_either(r):
    """A thousandth of 8e12 N s is rounding: where a step is ok, momentum balances."""
    scene = short_lever(r)
    q, v = scene.state()
    q[2] = -1e-6
    batch = step_batch(scene, [q, q], [v, v], dt=DT, **CORE)
    ok = np.delete(np.arange(2), batch.failed)
    assert len(ok) == 2 or r < 1e-6
    assert (batch.errors[ok, ERRORS.index("dynamics_error")] < 1e-9).all()


@pytest.mark.long
def test_steps_that_may_have_several_motions_are_pythons():
    """A box that slides and spins, one in a slot, and a ball that walls press from both sides."""
    cube = Box(0.1, 0.1, 0.1)
    floor = FrictionalContact("box", cube, friction=0.5, name="floor")
    walls = [
        FrictionalContact("box", cube, on=Plane((s, 0, 0), -0.1), friction=0.2, name=name)
        for s, name in ((1, "left"), (-1, "right"))
    ]
    tight = [replace(each, on=replace(each.on, height=-0.1 + 2e-3)) for each in walls]
    for contacts in ([floor], [*walls, floor], tight):
        scene = cp.Scene(free_box(), contacts=contacts)
        q, v = scene.state()
        v[1], v[5] = 1.0, 2.0 if contacts == [floor] else 0.0
        ended = step_batch(scene, [q], [v], dt=DT, **CORE)
        alone = cp.step(scene, q, v, dt=DT)
        assert_array_equal(ended.v[0], alone.v)
        assert_array_equal(ended.q[0], alone.q)


@pytest.mark.parametrize("rest", [0.0, 0.5])
def test_where_the_ends_of_a_spring_coincide_nothing_pulls(rest, monkeypatch):
    boxes = together({name: free_box(size=(0.2, 0.1, 0.1)) for name in "ab"})
    floor = FrictionalContact("a/box", Ball(0.1), friction=0.5)
    scene = cp.Scene(boxes, contacts=[floor])
    scene = with_springs(scene, SpringDamper("a/box", "b/box", 100.0, 3.0, rest))
    q, v = pin.neutral(boxes.model)[None], normal(0, 1.0, 1, boxes.nv)
    group = Start(scene, q, v, np.zeros_like(v))
    found, wanted, left = steps_of(group, monkeypatch)
    assert left == 0
    assert_same_steps(found, wanted)
    found, wanted, _ = slopes_of(group, monkeypatch)
    assert_array_equal(found.dv, wanted.dv)  # of Python: there are none
    for by in (cp.SemiImplicitEuler(), cp.simulation.LinearlyImplicitMidpoint(), cp.RungeKutta4()):
        free = replace(scene, contacts=())
        how = {"duration": 0.02, "dt": 2e-4, "integrator": by}
        found, wanted = (cp.simulate_batch(free, q, v, **how, **core) for core in (CORE, {}))
        assert_allclose(found.v, wanted.v, rtol=0, atol=MOVED * max(1.0, np.abs(wanted.v).max()))


def test_derivatives_of_long_steps_are_left_to_python(monkeypatch):
    """One that is taken again, with contacts as they are where its path ends."""
    scene, q, v, _ = on_feet("solo12", friction=0.7)
    q[2] += 1e-3
    v[:6] = 0.0, 0.0, -2.0, 3.0, 3.0, 0.0
    group = Start(scene, q[None], v[None], np.zeros(len(v)))
    found, wanted, _ = slopes_of(group, monkeypatch, dt=2e-2)
    assert_array_equal(found.dv, wanted.dv)


@pytest.mark.parametrize("speed", [0.0, 0.1])
def test_dry_friction_of_zero_holds_nothing(speed, monkeypatch):
    """At rest it was taken to stick: v+ had no slope by torques."""
    scene = cp.Scene(robot("four_bar"), contacts=[JointFriction("crank", torque=0.0)])
    group = Start(scene, np.zeros((1, 3)), np.full((1, 3), speed), np.zeros(3))
    found, wanted, _ = slopes_of(group, monkeypatch, integrator=cp.StewartTrinkle())
    assert np.abs(wanted.dv_dtau).max() > DT
    assert_same_slopes(found, wanted)
    for name in ("dv_dq", "dv_dv", "dv_dtau"):
        assert_allclose(getattr(found, name), getattr(wanted, name), rtol=1e-9, atol=1e-12)


# Paths of driven rows


@pytest.mark.long
def test_steps_of_other_times_are_of_these():
    """One core after the other, with memory of the same scene."""
    scene = plate().scene
    q, v = np.array([[0.0, 0.0, 0.0]]), np.array([[0.6, 0.6, 0.0]])
    for t in (0.0, 0.2, 0.1, 0.0):
        found, wanted = (step_batch(scene.at(t), q, v, **ABOUT, **by) for by in (CORE, {}))
        assert_same_steps(found, wanted)


def test_paths_into_a_wall_that_end_or_lead_out_of_reach_end_as_in_python():
    def ends(t):
        if t > 0.05:
            raise cp.InvalidArgument("no path from here")
        return np.array([0.3 * t, 0.3, 0.0])

    bar = cp.model.four_bar()
    crank, rocker = bar.model.names[1], bar.model.names[-1]
    held = Driven(HeldJoint(rocker, float(bar.postures["open"][-1])), Polynomial((0.0, 0.6, 400.0)))
    turned = cp.Scene(bar, [*bar.loops, held], contacts=[JointFriction(crank, 0.5)])
    walled = pushing(Polynomial((0.0, 1.0)), WALL)
    into = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])
    for scene, state in (
        (driven_bar(ends), None), (turned, None), (walled, into),
    ):  # fmt: skip
        q, v = state or scene.at(0.0).state()
        about = {"duration": 0.2, **ABOUT}
        found, wanted = (
            cp.simulate_batch(scene, q[None], v[None], **about, **by) for by in (CORE, {})
        )
        assert not wanted.ok
        assert list(found.reasons) == list(wanted.reasons)
        assert_allclose(found.t, wanted.t, rtol=0, atol=1e-12)
    assert "neither can move away" in found.reasons[0]
    near_it = np.array([[0.0999, 0.0, 1.0]])
    assert not step_batch(walled.at(0.0999), near_it, into[1][None], **ABOUT, **CORE).ok
