"""Control ticks by the compiled core: the answers of Python, which does what the core leaves.

A table of laws has every kind of task, cone, limit, motor and driven row. `test_native.py` has the
border of the core.
"""

from __future__ import annotations

import functools
import pickle
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from numpy.typing import NDArray
from own_task import own_task, still
from shared import robot
from test_control_swing import two_masses
from test_driven_control import carried

import condyn_pin as cp
from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin.constraints import Coupling, Driven, HeldJoint, KnifeEdge, Polynomial, Sine
from condyn_pin.contact import FrictionCone, WrenchCone
from condyn_pin.control import (
    TASKS,
    Actuation,
    AngularMomentum,
    CapturePoint,
    CenterOfMass,
    ContactForce,
    Controller,
    ControlLimits,
    ControlStatus,
    FrameTask,
    Hierarchy,
    JointTask,
    Orientation,
    Posture,
    minimum_jerk,
)
from condyn_pin.errors import UnsupportedBackend
from condyn_pin.mechanism import anchored, project_velocity, without

# The core has Pinocchio's headers in it; that scenes cross from either version: test_native.py.
pytestmark = [pytest.mark.native, pytest.mark.once]
pytest.importorskip("proxsuite")

Array = NDArray[np.float64]
IN_CORE = ("compiled core",)
HAND = "gripper_left_base_link"
PATH = Sine(0.2, 0.8, 0.4)
OCTAGON = FrictionCone(0.6, sides=8)
BASES = {"solo12": "base_link", "cassie": "pelvis", "talos": "base_link"}
CONES = {"solo12": OCTAGON, "cassie": WrenchCone(0.6), "talos": WrenchCone(0.5)}

# Programs with one answer, whose equations are far from dependent, to rounding. The feet and loops
# of Cassie leave equations with a singular value of 7e-7 of the largest: Python's own answer moves
# by 1e-7 of the largest torque if v changes in its last digit (accelerations by 1e-9).
SAME = {"solo12": 1e-9, "talos": 1e-9, "cassie": 1e-5}


@functools.cache
def standing(name: str) -> cp.Scene:
    """A robot on its feet; Cassie's are lines, and her springs are locked."""
    variant = {"feet": "lines", "springs": "locked"} if name == "cassie" else None
    made = cp.load_robot(name, variant=variant) if variant else robot(name)
    return cp.Scene(made, [*made.loops, *made.contacts])


def swinging() -> cp.Scene:
    """Cassie on points, with springs that swing and rows that are redundant."""
    cassie = robot("cassie")
    return cp.Scene(cassie, [*cassie.loops, *cassie.contacts])


def tasks_of(name: str, **com) -> list:
    mass = CenterOfMass(kp=20, weight=100, **com)
    return [mass, Orientation(BASES[name], weight=50), Posture(weight=0.1)]


def pair(scene, tasks, cones, **options) -> tuple[Controller, Controller]:
    """Return a controller in Python, and the same in the core."""
    made = functools.partial(Controller, scene, tasks, cones=cones, **options)
    return made(), made(engine="core")


def states_of(name: str, count: int) -> list[tuple[Array, Array]]:
    """Return states that move; edges lie in the floor only where the robot stands."""
    scene, rng = standing(name), np.random.default_rng(0)
    q0, _ = scene.state()
    found = [scene.sample(rng, spread=0.02, speed=0.5) for _ in range(count)]
    if name == "cassie":
        found = [(q0, project_velocity(scene, q0, v)) for _, v in found]
    return found


def moving(scene: cp.Scene, speed: float, count: int, seed: int = 7) -> list[tuple[Array, Array]]:
    """Return states about where it stands, with rows that keep their places."""
    q, _ = scene.state()
    wishes = speed * np.random.default_rng(seed).normal(size=(count, scene.robot.nv))
    return [(q, project_velocity(scene, q, wish)) for wish in wishes]


def assert_same(python, core, accuracy: float = 1e-9, of_v: float = 1e-9) -> None:
    """Every number of two answers; which rows are active has no one answer where many meet."""
    assert core.path == IN_CORE, core
    assert python.status is core.status is ControlStatus.OK
    assert core.residuals.kkt <= tolerances.KKT
    mass = python.scene.robot.mass * 9.81
    for mine, yours, size in (
        (core.a, python.a, 9.81), (core.tau, python.tau, mass), (core.lam, python.lam, mass),
        (core.rigid, python.rigid, mass),
    ):  # fmt: skip
        assert mine.shape == yours.shape
        largest = max(size, np.abs(yours).max(initial=0.0))
        assert np.abs(mine - yours).max(initial=0.0) <= accuracy * largest
    assert set(core.errors) == set(python.errors)
    for name, error in python.errors.items():
        assert np.allclose(core.errors[name], error, rtol=0, atol=1e2 * accuracy * mass), name
    assert core.q is not python.q
    assert (np.array_equal(core.q, python.q), core.t) == (True, python.t)
    assert np.abs(core.v - python.v).max() <= of_v


# Laws, and their states


@dataclass
class Law:
    """A controller, and its ticks: q and v, and what else `solve` takes."""

    scene: cp.Scene
    tasks: list
    cones: object
    ticks: list
    options: dict = field(default_factory=dict)
    more: dict = field(default_factory=dict)
    accuracy: float = 1e-9
    of_v: float = 1e-9  # of speeds behind springs that are locked [rad/s]
    errors: dict = field(default_factory=dict)  # of tasks, at most
    active: bool = False  # some limits, at the last tick
    where_ok: bool = False  # an equation may ask for more than feet can give


def limits_of_joints() -> Iterator[Law]:
    scene = without(standing("talos"), ["left_sole_link"])
    wild = [*tasks_of("talos"), JointTask("leg_left_4_joint", a=-1e4, weight=1e3)]
    for limits in (
        ControlLimits(torque=False),
        ControlLimits(torque=False, acceleration=3.0),
        ControlLimits(acceleration=np.linspace(5.0, 50.0, 38)),
    ):
        active = limits != ControlLimits(torque=False)
        ticks, options = states_of("talos", 5), {"limits": limits}
        yield Law(scene, wild, CONES["talos"], ticks, options, active=active)


def every_kind_of_task() -> Iterator[Law]:
    """With references that are numbers, functions of t, and accelerations."""
    scene = standing("talos")
    (q, v), *_ = states_of("talos", 1)
    data = scene.robot.model.createData()
    com = np.array(pin.centerOfMass(scene.robot.model, data, q))
    pose = pin.SE3(pin.exp3(np.array([0.1, 0.2, -0.3])), np.array([0.3, 0.3, 1.0]))
    turn, still = pose.rotation, np.zeros(3)
    six, nv = np.arange(6) / 10, scene.robot.nv
    way = minimum_jerk(com, com + 0.01, 1.0)
    cases = [
        [CenterOfMass(reference=com + 0.01, kp=4.0, kd=1.0), CenterOfMass(a=(0, 0, 1.0), name="x")],
        [CenterOfMass(reference=way), FrameTask(HAND), FrameTask(HAND, of="pose")],
        [FrameTask(HAND, reference=pose, of="pose", kp=7.0), Orientation("base_link")],
        [FrameTask(HAND, reference=lambda t: (pose.translation, still + t, still - t))],
        [FrameTask(HAND, reference=lambda t: (pose, six * t, six), of="pose")],
        [FrameTask(HAND, a=(1.0, 2.0, 3.0)), Orientation(HAND, a=(1.0, 0.0, -1.0))],
        [Orientation(HAND, reference=turn), Orientation(BASES["talos"], kp=0.0, kd=3.0)],
        [Orientation(HAND, reference=lambda t: (turn, still + t, still + 1.0))],
        [JointTask("arm_left_4_joint", reference=-1.5), JointTask("arm_right_4_joint", a=2.0)],
        [JointTask("arm_left_4_joint", reference=lambda t: (-1.0, t, 1.0)), AngularMomentum()],
        [Posture(q), Posture("half_sitting", joints=["head_1_joint"], name="head")],
        [Posture(reference=lambda t: (q, np.full(nv, t), np.ones(nv)))],
        [AngularMomentum((0.1, 0.0, -0.1), k=2.0), CenterOfMass()],
        [AngularMomentum(lambda t: (still + t, still + 1.0))],
        [ContactForce("left_sole_link", (0.0, 10.0, 500.0), weight=1e-3), CenterOfMass()],
        [ContactForce("left_sole_link", lambda t: (0.0, t, 400.0)), Posture()],
        [CapturePoint(weight=10), CapturePoint(reference=com, k=1.0, name="slow")],
    ]  # fmt: skip
    missing = set(TASKS) - {type(task).__name__ for tasks in cases for task in tasks}
    assert not missing, f"add an example of {missing} to `cases`, if only for Python"
    for tasks in cases:
        rest = Posture(weight=1e-2, name="rest")
        ticks = [(q, v, 0.0), (q, v, 0.3)]
        yield Law(scene, [*tasks, rest], CONES["talos"], ticks, accuracy=1e-8)


def infinite_weights() -> Iterator[Law]:
    scene = without(standing("solo12"), ["FL_FOOT"])
    hard = [
        JointTask("FL_HAA", a=1.0, weight=np.inf),
        ContactForce("HL_FOOT", (0.0, 0.0, 5.0), weight=np.inf),
        FrameTask("base_link", a=(0.0, 0.0, 0.1), weight=np.inf),
    ]
    for tasks in ([hard[0]], hard[1:]):
        held, ticks = dict.fromkeys((task.name for task in tasks), 1e-9), states_of("solo12", 1)
        yield Law(scene, [*tasks, *tasks_of("solo12")[1:]], OCTAGON, ticks, errors=held)


def twenty_tasks() -> Iterator[Law]:
    scene = standing("solo12")
    tasks = [
        *(JointTask(joint, weight=0.1) for joint in scene.robot.joints[1:]),
        *(ContactForce(c.name, (0.0, 0.0, 6.0), weight=1e-3) for c in scene.constraints),
        CenterOfMass(weight=10), CapturePoint(weight=10), AngularMomentum(), Posture(weight=0.01),
    ]  # fmt: skip
    assert len(tasks) == 20
    yield Law(scene, tasks, OCTAGON, moving(scene, 0.2, 3), accuracy=1e-8)


def floors_that_slope() -> Iterator[Law]:
    """Also for edges that lie on them."""
    slope = (0.2, -0.1, 1.0)
    for name, cone in (
        ("solo12", FrictionCone(0.7, normal=slope, sides=6)),
        ("cassie", WrenchCone(0.7, normal=(0.0, 0.0, 2.0), pyramid="outer")),
    ):
        tasks = tasks_of(name, a=(2.0, 1.0, 0.0))
        yield Law(standing(name), tasks, cone, states_of(name, 3), accuracy=SAME[name])


def drift_gears_and_held_contacts() -> Iterator[Law]:
    """Beside passive torques."""
    scene = standing("solo12")
    held = dict.fromkeys(("FR_FOOT", "HL_FOOT", "HR_FOOT"), OCTAGON)
    geared = Actuation(scene.robot, ratios={"FL_KFE": 9.0})
    without_a_knee = Actuation(scene.robot, scene.robot.joints[1:3])
    passive = {"passive": np.linspace(-0.1, 0.1, 18)}
    for cones, options in (
        (OCTAGON, {"drift": cp.Baumgarte(20.0, 20.0)}),
        (held, {"actuation": geared}),
        (held, {"rigid": ["FL_KFE"], "actuation": without_a_knee}),
    ):
        ticks = states_of("solo12", 4)
        yield Law(scene, tasks_of("solo12"), cones, ticks, options, passive, 1e-8, where_ok=True)


def loops() -> Iterator[Law]:
    bar = cp.model.five_bar()
    scene, every = cp.Scene(bar, bar.loops), Actuation(bar, bar.joints)  # against each other
    yield Law(scene, [Posture(joints=bar.joints)], {}, [scene.state()], {"actuation": every})


def springs_of_cassie() -> Iterator[Law]:
    """At rest, and swinging: loops that hold, and loops that drift, anchored feet and not."""
    scene = swinging()
    made, (q, _) = scene.robot, scene.state()
    springs = [spring.joint for spring in made.springs]
    swing = [
        CapturePoint(weight=1000),
        Orientation("pelvis", kp=100, weight=0.3),
        Posture(weight=0.1),
    ]
    stand = {"drift": cp.Baumgarte.critical(10.0)}
    closed, rng = cp.Scene(made, made.loops), np.random.default_rng(3)
    for speed, open_by in ((0.0, 0.0), (0.1, 0.0), (0.3, 0.0), (0.1, 1e-4), (0.3, 1e-4)):
        v = project_velocity(closed, q, speed * rng.normal(size=made.nv))
        v = v + open_by * rng.normal(size=made.nv)
        how = {"ticks": [(q, v)], "more": {"passive": made.passive_torque(q, v)}, "accuracy": 1e-5}
        yield Law(scene, tasks_of("cassie"), OCTAGON, options={"rigid": springs}, **how)
        feet, cone = anchored(scene, q), FrictionCone(0.65, sides=8)
        yield Law(feet, swing, cone, options={"rigid": springs, **stand}, **how)


def springs_outside_of_loops() -> Iterator[Law]:
    """Also one that carries next to nothing: the momentum is that of the motor."""
    scene = two_masses()
    light = pin.Model(scene.robot.model)
    light.inertias[2] = pin.Inertia(1e-9, np.zeros(3), np.zeros((3, 3)))
    for made in (scene.robot, replace(scene.robot, model=light)):
        ticks = [(np.zeros(2), np.array([0.3, -2.0]))]
        tasks = [JointTask("motor", reference=0.3)]
        yield Law(cp.Scene(made), tasks, {}, ticks, {"rigid": ["load"]}, of_v=1e-14)


def forces_on_what_rolls() -> Iterator[Law]:
    """In its axes."""
    for name in ("rolling_ball", "rolling_disc"):
        made, rng = robot(name), np.random.default_rng(0)
        scene, every = cp.Scene(made, made.contacts), Actuation(made, made.joints)
        force = ContactForce(made.contacts[0].name, (1.0, 2.0, 20.0), weight=1e-2)
        options = {"actuation": every, "limits": ControlLimits(torque=False)}
        ticks = [scene.sample(rng, spread=0.3, speed=1.0) for _ in range(5)]
        tasks, errors = [force, Posture(joints=made.joints)], {force.name: 0.1}
        yield Law(scene, tasks, FrictionCone(0.8), ticks, options, errors=errors)


def one_motor_on_feet_that_are_held() -> Iterator[Law]:
    """No contact has a cone, so that there is nothing but what is eliminated."""
    scene = standing("solo12")
    one = {"actuation": Actuation(scene.robot, ["FL_HAA"])}
    yield Law(scene, [Posture()], {}, moving(scene, 0.2, 3), one, accuracy=1e-8)


def chain_of(joints: int, most: float) -> cp.Robot:
    made = cp.model.chain(joints)
    model = pin.Model(made.model)
    model.effortLimit = np.full(joints, most)
    return replace(made, model=model)


def chains_of_few_joints() -> Iterator[Law]:
    """Every joint has a motor: there are no equations at all, and limits are active."""
    for joints in (1, 2, 7):
        made = chain_of(joints, 5.0)
        scene, frame, every = cp.Scene(made), made.frames[-1], Actuation(made, made.joints)
        q, v = np.linspace(0.3, 0.9, joints), np.linspace(-0.5, 0.5, joints)
        for tasks in (
            [Posture(q + 1.0, kp=300.0)],
            [JointTask(made.joints[0], a=50.0)],
            [CenterOfMass(a=(0.0, 0.0, 30.0))],
            [AngularMomentum((1.0, 2.0, 3.0))],
            [FrameTask(frame), Orientation(frame)],
            [FrameTask(frame, of="pose", kp=0.0)],
        ):
            for limits in (ControlLimits(), ControlLimits(torque=False)):
                options = {"actuation": every, "limits": limits}
                # from nothing, and from the active set of the last
                yield Law(scene, tasks, {}, 2 * [(q, v)], options, accuracy=1e-8)


def more_equations_than_unknowns() -> Iterator[Law]:
    """Twenty tasks that are equations and say the same."""
    scene = cp.Scene(chain_of(2, np.inf))
    first, second = scene.robot.joints
    same = [JointTask(first, a=1.0, weight=np.inf, name=f"{i}") for i in range(20)]
    every = {"actuation": Actuation(scene.robot, (first, second))}
    ticks, errors = [(np.array([0.3, 0.2]), np.zeros(2))], {"0": 1e-9}
    yield Law(scene, [*same, Posture()], {}, ticks, every, errors=errors)


def driven(scene: cp.Scene, tasks: list, cones: object, accuracy: float = 1e-8, **options) -> Law:
    """Rows that follow their paths, at three times."""
    rng, ticks = np.random.default_rng(2), []
    for t in (0.0, 0.3, 1.1):
        q, v = scene.at(t).state()
        ticks.append((q, v + 0.1 * rng.normal(size=len(v)), t))
    return Law(scene, tasks, cones, ticks, options, accuracy=accuracy)


def cart() -> Iterator[Law]:
    scene = cp.Scene(carried(effort=30.0), [Driven(HeldJoint("cart"), PATH)])
    yield driven(scene, [JointTask("arm", kp=100.0)], {})


def crank() -> Iterator[Law]:
    bar = cp.model.five_bar()
    first, second = bar.actuated
    home = float(cp.Scene(bar, bar.loops).state()[0][bar.index_q(first)])
    scene = cp.Scene(bar, [*bar.loops, Driven(HeldJoint(first, home), PATH)])
    yield driven(scene, [JointTask(second, kp=30.0)], {}, drift=cp.Baumgarte.critical(20.0))


def arms() -> Iterator[Law]:
    """A hand on a path, an elbow on another, two joints in step: feet press beside them."""
    talos = robot("talos")
    hand = Polynomial(((0.0, 0.1, 0, 0.2), (0, -0.2, 0.3, 0), (0.1, 0, 0, 0)))
    rows = [
        Driven(cp.Loop(HAND, "world"), hand),
        Driven(HeldJoint("arm_right_4_joint", -1.0), PATH),
        Driven(Coupling("head_1_joint", "head_2_joint", 1.5), Sine(0.1, 1.5)),
    ]
    scene = cp.Scene(talos, [*talos.contacts, *rows])
    tasks = [CenterOfMass(a=(0.2, 0, 0), weight=100), Orientation("base_link"), Posture(weight=0.1)]
    yield driven(scene, tasks, WrenchCone(0.5), drift=cp.Baumgarte(5.0, 5.0))


def hip() -> Iterator[Law]:
    scene = swinging()
    hip = Driven(HeldJoint("left-yaw-op", 0.0), PATH)
    springs = [spring.joint for spring in scene.robot.springs]
    scene = cp.Scene(scene.robot, [*scene.constraints, hip])
    tasks = [CenterOfMass(weight=100), *tasks_of("cassie")[1:]]
    yield driven(scene, tasks, OCTAGON, SAME["cassie"], rigid=springs)


def blade() -> Iterator[Law]:
    """A row without a position: it follows the rate of its path."""
    made = cp.model.free_box()
    pushed = Driven(KnifeEdge(made.frames[-1]), Polynomial((0.0, 0.3, 0.0, 0.4)))
    options = {"actuation": Actuation(made, made.joints), "drift": cp.Baumgarte(5.0, 5.0)}
    yield driven(cp.Scene(made, [pushed]), [Posture(joints=made.joints)], {}, **options)


LAWS = (
    limits_of_joints, every_kind_of_task, infinite_weights, twenty_tasks, floors_that_slope,
    drift_gears_and_held_contacts, loops, springs_of_cassie, springs_outside_of_loops,
    forces_on_what_rolls, one_motor_on_feet_that_are_held, chains_of_few_joints,
    more_equations_than_unknowns, cart, crank, arms, hip, blade,
)  # fmt: skip


@pytest.mark.parametrize("laws", LAWS, ids=lambda laws: laws.__name__)
def test_ticks(laws: Callable[[], Iterator[Law]]) -> None:
    for law in laws():
        python, core = pair(law.scene, law.tasks, law.cones, **law.options)
        locked = core._program.rigid
        for tick in law.ticks:
            mine, yours = python.solve(*tick, **law.more), core.solve(*tick, **law.more)
            if law.where_ok and not mine.status.ok:
                continue
            assert_same(mine, yours, law.accuracy, law.of_v)
            assert np.abs(locked @ yours.v).max(initial=0.0) <= min(1e-12, law.of_v / 10)
            for name, most in law.errors.items():
                assert np.abs(yours.errors[name]).max() < most, name
        assert yours.active or not law.active


@pytest.mark.parametrize("name", SAME)
def test_random_states_are_answered_as_by_python(name):
    """With limits at work, from one active set to the next."""
    for push in (0.0, 6.0, -9.0):
        tasks = tasks_of(name) if not push else tasks_of(name, a=(push, 0.0, -push / 3))
        python, core = pair(standing(name), tasks, CONES[name])
        answers = [(python.solve(q, v), core.solve(q, v)) for q, v in states_of(name, 12)]
        for answer in answers:
            assert_same(*answer, SAME[name])
        assert sum(bool(core.active) for _, core in answers) >= 12 * bool(push and name != "cassie")


@pytest.mark.parametrize("name", ["solo12", "talos"])
@pytest.mark.parametrize("speed", [0.05, 2.0], ids=["within the support", "drawn to its edge"])
def test_capture_points_return_as_in_python(name, speed):
    """Where the pressure is within the support it is a centre of mass with these gains."""
    scene, cone = standing(name), CONES[name]
    q, _ = scene.state()
    still = np.zeros(scene.robot.nv)
    now = cp.control.balance(scene, q, still, still, np.zeros(scene.rows))
    rest = [Orientation("base_link", weight=0.3), Posture(weight=0.1)]
    drawn = 0
    for away, k, beyond, weight in (
        ((0.0, 0.0, 0.0), 4.0, 0.2, 100.0),
        ((0.01, -0.02, 0.03), 0.5, 0.0, 1.0),
        ((0.0, 0.0, 0.0), 0, 0.1, np.inf),
    ):
        place = now.com + away
        omega = float(np.sqrt(9.81 / (place[2] - now.polygon.plane.origin[2])))
        task = CapturePoint(reference=place, k=k, beyond=beyond, weight=weight)
        python, core = pair(scene, [task, *rest], cone)
        gains = {"kp": k * omega**2, "kd": (k + 1) * omega}
        plain = CenterOfMass(reference=place, weight=weight, **gains, name="plain")
        plain = Controller(scene, [plain, *rest], cones=cone)
        for q, v in moving(scene, speed, 6):
            answer = python.solve(q, v)
            if answer.status.ok:  # an equation may ask for more than the feet can give
                assert_same(answer, core.solve(q, v), SAME[name])
                drawn += np.abs(plain.solve(q, v).a - answer.a).max() > 1e-3
    assert (drawn > 3) == (speed == 2.0)


def test_the_proof_is_that_of_newton_and_euler():
    scene, (q, v) = standing("talos"), states_of("talos", 1)[0]
    out = Controller(scene, tasks_of("talos"), cones=CONES["talos"], engine="core").solve(q, v)
    forward = cp.solve(scene, q, v, out.tau)
    assert out.path == IN_CORE
    assert np.abs(forward.a - out.a).max() < 1e-9 * np.abs(out.a).max()
    shared = 1e-7 * np.abs(out.lam).max()  # by six and six
    assert np.abs(forward.lam - out.lam).max() < shared
    assert out.residuals.dynamics < 1e-9
    assert out.residuals.constraints < 1e-10
    assert out.margins.keys() == {each.name for each in scene.constraints}


def test_a_tick_begins_from_the_active_set_of_the_last():
    tasks = tasks_of("solo12", a=(6.0, 0.0, 0.0))
    python, core = pair(standing("solo12"), tasks, OCTAGON)
    q, v = states_of("solo12", 1)[0]
    first, again = core.solve(q, v), core.solve(q, v)
    assert first.active == again.active == python.solve(q, v).active != ()
    assert first.iterations > again.iterations == 0


@pytest.mark.long
def test_contacts_are_switched():
    scene = standing("solo12")
    python, core = pair(scene, tasks_of("solo12"), OCTAGON)
    lifts = [*tasks_of("solo12"), FrameTask("FL_FOOT", a=(0.0, 0.0, 2.0))]
    for number, (q, v) in enumerate(states_of("solo12", 12)):
        now = without(scene, ["FL_FOOT"]) if number // 3 % 2 else scene
        tasks = lifts if now is not scene else None
        assert_same(python.use(now, tasks).solve(q, v), core.use(now, tasks).solve(q, v))


@pytest.mark.long
def test_nothing_is_locked_that_does_not_swing():
    (*_, law) = springs_of_cassie()
    core = Controller(law.scene, law.tasks, cones=law.cones, engine="core", **law.options)
    (q, v), *_ = moving(law.scene, 0.1, 1)
    v[core._program.rigid.argmax(axis=1)] = 0.0
    out = core.solve(q, v)
    assert out.path == IN_CORE
    assert (out.v == v).all()


# What contradicts itself, cannot move, or is left to Python


@pytest.mark.long
def test_a_spring_that_loops_turn_is_left_to_python():
    """To lock what loops move contradicts the speed of the motor: rows that do not agree."""
    bar = cp.model.four_bar()
    scene = cp.Scene(bar, bar.loops)
    q, v = scene.state()
    crank, *others = bar.joints
    v = project_velocity(scene, q, np.ones(bar.nv))
    options = {"actuation": Actuation(bar, [crank]), "rigid": [others[-1]]}
    python, core = pair(scene, [JointTask(crank)], {}, **options)
    mine, yours = python.solve(q, v), core.solve(q, v)
    assert yours.path == mine.path != IN_CORE
    assert (yours.v == mine.v).all()


def test_what_leaves_nothing_to_eliminate_is_done_by_python():
    """Every joint held, and a motor that moves nothing: no rank, no unknowns."""
    q, v = np.array([0.1, 0.2]), np.zeros(2)
    for held in (("cart", "arm"), ("arm",)):
        scene = cp.Scene(carried(), [HeldJoint(joint) for joint in held])
        options = {"actuation": Actuation(scene.robot, ["arm"])}
        python, core = pair(scene, [Posture(joints=["arm"])], {}, **options)
        mine, yours = python.solve(q, v), core.solve(q, v)
        assert (mine.path, mine.status) == (yours.path, yours.status)
        assert yours.path != IN_CORE
        assert np.array_equal(mine.tau, yours.tau, equal_nan=True)


def test_what_contradicts_itself_is_told_as_by_python():
    scene, (q, v) = standing("solo12"), states_of("solo12", 1)[0]
    falls = [CenterOfMass(a=(0.0, 0.0, -15.0), weight=np.inf), Posture()]
    python, core = pair(scene, falls, OCTAGON)
    mine, yours = python.solve(q, v), core.solve(q, v)
    assert mine.status is yours.status is ControlStatus.INFEASIBLE
    assert str(mine.infeasible) == str(yours.infeasible)
    assert yours.path[-1] == "elastic program"
    assert np.isnan(yours.tau).all()
    stands = core.use(scene, tasks_of("solo12"))
    assert_same(python.use(scene, tasks_of("solo12")).solve(q, v), stands.solve(q, v))


@pytest.mark.long
@pytest.mark.parametrize("seed", range(6))
def test_what_loops_hold_still_is_not_moved_by_what_rounding_leaves_of_it(seed):
    """Motors would take 1e17 N m; a task or a path that loops have decided is named."""
    made, rng = chain_of(6, np.inf), np.random.default_rng(seed)
    first, second, *_ = made.joints
    q, v = rng.normal(size=(2, 6))
    tip, whole = cp.Loop("joint4_tip", "world"), [Posture(joints=made.joints)]
    scene = cp.Scene(made, [tip, HeldJoint(first, 0.3), HeldJoint(second, 0.3)])
    for motors in ([first], [first, second], [first, made.joints[5]]):
        python, core = pair(scene, whole, {}, actuation=Actuation(made, motors))
        mine, yours = python.solve(q, v), core.solve(q, v)
        assert mine.status is yours.status is ControlStatus.OK
        assert max(np.abs(mine.tau[:2]).max(), np.abs(yours.tau[:2]).max()) < 1e-9
        assert np.abs(mine.a - yours.a).max() < 1e-9 * max(9.81, np.abs(mine.a).max())
    fast = Driven(HeldJoint(first), Polynomial((0.0, 0.0, 15.0)))
    wished = [JointTask(first, a=1.0, weight=np.inf), *whole]
    limits = ControlLimits(acceleration=20.0)
    for held, tasks, limit in ((HeldJoint(first), wished, None), (fast, whole, limits)):
        options = {"actuation": Actuation(made, made.joints), "limits": limit}
        python, core = pair(cp.Scene(made, [tip, held]), tasks, {}, **options)
        mine, yours = python.solve(q, 0 * v), core.solve(q, 0 * v)
        assert mine.status is yours.status is ControlStatus.INFEASIBLE
        assert str(mine.infeasible) == str(yours.infeasible)


@pytest.mark.long
def test_a_foot_that_others_hold_is_held():
    """Its rows over what is left to move are rounding, and their forces anything."""
    solo = robot("solo12")
    leg = [HeldJoint(joint) for joint in ("FL_HAA", "FL_HFE", "FL_KFE")]
    base = cp.Loop("base_link", "world", "weld")
    foot = next(contact for contact in solo.contacts if contact.name == "FL_FOOT")
    python, core = pair(
        cp.Scene(solo, [foot, base, *leg]), [Posture(weight=1.0)], {"FL_FOOT": OCTAGON}
    )
    q, v = standing("solo12").state()
    mine, yours = python.solve(q, v), core.solve(q, v)
    assert mine.status is yours.status is ControlStatus.OK
    assert np.abs(mine.a - yours.a).max() < 1e-6


def test_what_it_does_not_take_is_refused_by_name_or_done_by_python(monkeypatch):
    monkeypatch.delenv("CONDYN_ENGINE")
    with own_task(still, "m/s^2") as Own:
        scene, (q, v) = standing("solo12"), states_of("solo12", 1)[0]
        held = dict.fromkeys(("FR_FOOT", "HL_FOOT", "HR_FOOT"), OCTAGON)
        stand, ahead = tasks_of("solo12"), ControlLimits(dt=0.05)
        for tasks, cones, limits, reason in (
            ([Own(), Posture()], OCTAGON, None, "task 'Own': it has no rows for this Own"),
            ([ContactForce("FL_FOOT")], held, None, "contact that has no cone"),
            (Hierarchy(stand[:1], stand[1:]), OCTAGON, None, "levels of a Hierarchy"),
            (stand, OCTAGON, ahead, "does not stop joints at their ends"),
        ):
            options = {"cones": cones, "limits": limits}
            with pytest.raises(UnsupportedBackend, match=reason):
                Controller(scene, tasks, **options, engine="core")
            either = Controller(scene, tasks, **options, engine="auto")
            if "no cone" not in reason:
                out = Controller(scene, tasks, **options).solve(q, v)
                same = either.solve(q, v)
                assert np.allclose(same.tau, out.tau, rtol=0, atol=1e-8)
                assert same.path == out.path


def test_bad_input_is_named_and_nan_is_never_ok():
    scene, (q, v) = standing("solo12"), states_of("solo12", 1)[0]
    for controller in pair(scene, tasks_of("solo12"), OCTAGON):
        for wrong, words in (
            ((q[:5], v), "q has shape"),
            ((q, v * np.nan), "v.*finite"),
            ((q, v + 1e200), "overflows"),
            ((q, v, np.inf), "t.*finite"),
            ((2 * q, v), "quaternion"),
        ):
            with pytest.raises(cp.InvalidArgument, match=words):
                controller.solve(*wrong)
        with pytest.raises(cp.InvalidArgument, match="passive has shape"):
            controller.solve(q, v, passive=[1.0])
    with pytest.raises(cp.InvalidArgument, match="engine = 'yes'"):
        Controller(scene, tasks_of("solo12"), cones=OCTAGON, engine="yes")
    lost = CenterOfMass(reference=lambda t: (q[:3] * np.nan, q[:3], q[:3]), name="lost")
    for controller in pair(scene, [lost], OCTAGON):
        with pytest.raises(cp.InvalidArgument, match=r"lost: reference\(0.3\)"):
            controller.solve(q, v, 0.3)
    path = Driven(HeldJoint("cart"), lambda t: (0.0, 0.0, 0.0 if t < 5 else np.nan))
    for law in pair(cp.Scene(carried(), [path]), [JointTask("arm")], {}):
        assert law.solve([0.0, 0.1], [0.0, 0.0], 0.2).status.ok
        with pytest.raises(cp.InvalidArgument, match="cart"):
            law.solve([0.0, 0.1], [0.0, 0.0], 6.0)


@pytest.mark.long
def test_answers_are_the_callers_own_and_controllers_are_pickled():
    (q, v), (q2, v2) = states_of("solo12", 2)
    core = Controller(standing("solo12"), tasks_of("solo12"), cones=OCTAGON, engine="core")
    first = core.solve(q, v)
    tau, forces = first.tau.copy(), first.lam.copy()
    core.solve(q2, v2)
    assert np.array_equal(first.tau, tau)
    assert np.array_equal(first.lam, forces)
    copy = pickle.loads(pickle.dumps(core))
    assert copy.solve(q, v).path == IN_CORE
    assert np.allclose(copy.solve(q, v).tau, tau, rtol=0, atol=1e-12)
