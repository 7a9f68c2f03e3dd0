"""Control ticks by the compiled core: the answers of Python, which does what the core leaves.

Without the core these tests are left out; where CI=true they fail.
"""

from __future__ import annotations

import functools
import pickle

import numpy as np
import pytest
from own_task import own_task, still
from shared import robot

import condyn_pin as cp
from condyn_pin._core import tolerances
from condyn_pin._core._pin import pin
from condyn_pin._core.compiled import compiled_tick
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
    compiled,
    minimum_jerk,
)
from condyn_pin.errors import UnsupportedBackend
from condyn_pin.mechanism import project_velocity, without

# The core has Pinocchio's headers in it; that scenes cross from either version: test_native.py.
pytestmark = [pytest.mark.native, pytest.mark.once]
pytest.importorskip("proxsuite")

IN_CORE = ("compiled core",)
OCTAGON = FrictionCone(0.6, sides=8)
HAND = "gripper_left_base_link"

# Programs with one answer, whose equations are far from dependent, to rounding. The feet and loops
# of Cassie leave equations with a singular value of 7e-7 of the largest: Python's own answer moves
# by 1e-7 of the largest torque if v changes in its last digit (accelerations by 1e-9).
SAME = {"solo12": 1e-9, "talos": 1e-9, "cassie": 1e-5}


@functools.cache
def scene_of(name: str) -> cp.Scene:
    variant = {"feet": "lines", "springs": "locked"} if name == "cassie" else None
    made = cp.load_robot(name, variant=variant) if variant else robot(name)
    return cp.Scene(made, [*made.loops, *made.contacts])


BASES = {"solo12": "base_link", "cassie": "pelvis", "talos": "base_link"}
CONES = {"solo12": OCTAGON, "cassie": WrenchCone(0.6), "talos": WrenchCone(0.5)}


def tasks_of(name: str, **com) -> list:
    mass = CenterOfMass(kp=20, weight=100, **com)
    return [mass, Orientation(BASES[name], weight=50), Posture(weight=0.1)]


def pair(scene, tasks, cones, **options) -> tuple[Controller, Controller]:
    """Return a controller in Python, and the same in the core."""
    made = functools.partial(Controller, scene, tasks, cones=cones, **options)
    return made(), made(native=True)


def states_of(name: str, count: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return states that move; edges lie in the floor only where the robot stands."""
    scene, rng = scene_of(name), np.random.default_rng(0)
    q0, _ = scene.state()
    found = [scene.sample(rng, spread=0.02, speed=0.5) for _ in range(count)]
    if name == "cassie":
        found = [(q0, project_velocity(scene, q0, v)) for _, v in found]
    return found


def assert_same(python, core, accuracy: float = 1e-9) -> None:
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


@pytest.mark.parametrize("name", SAME)
@pytest.mark.parametrize("push", [0.0, 6.0, -9.0])
def test_random_states_are_answered_as_by_python(name, push):
    """With limits at work, from one active set to the next."""
    tasks = tasks_of(name) if not push else tasks_of(name, a=(push, 0.0, -push / 3))
    python, core = pair(scene_of(name), tasks, CONES[name])
    active = 0
    for q, v in states_of(name, 25):
        answer = core.solve(q, v)
        assert_same(python.solve(q, v), answer, SAME[name])
        active += bool(answer.active)
    assert active >= 25 * bool(push and name != "cassie")


def test_the_proof_is_that_of_newton_and_euler():
    scene, (q, v) = scene_of("talos"), states_of("talos", 1)[0]
    out = Controller(scene, tasks_of("talos"), cones=CONES["talos"], native=True).solve(q, v)
    forward = cp.solve(scene, q, v, out.tau)
    assert out.path == IN_CORE
    assert np.abs(forward.a - out.a).max() < 1e-9 * np.abs(out.a).max()
    assert (
        np.abs(forward.lam - out.lam).max() < 1e-7 * np.abs(out.lam).max()
    )  # shared by six and six
    assert out.residuals.dynamics < 1e-9
    assert out.residuals.constraints < 1e-10
    assert out.margins.keys() == {each.name for each in scene.constraints}


def test_a_tick_begins_from_the_active_set_of_the_last():
    scene, (q, v) = scene_of("solo12"), states_of("solo12", 1)[0]
    tasks = tasks_of("solo12", a=(6.0, 0.0, 0.0))
    python, core = pair(scene, tasks, OCTAGON)
    first, again = core.solve(q, v), core.solve(q, v)
    assert first.active == again.active == python.solve(q, v).active != ()
    assert first.iterations > again.iterations == 0


def test_every_kind_of_task_is_there():
    """With references that are numbers, functions of t, and accelerations."""
    scene = scene_of("talos")
    q, v = states_of("talos", 1)[0]
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
    in_core = {type(task).__name__ for tasks in cases for task in tasks}
    missing = set(TASKS) - in_core
    assert not missing, (
        f"{missing}: add an example to `cases`, even if the compiled core leaves the task to Python"
    )
    for tasks in cases:
        python, core = pair(scene, [*tasks, Posture(weight=1e-2, name="rest")], CONES["talos"])
        for t in (0.0, 0.3):
            assert_same(python.solve(q, v, t), core.solve(q, v, t), 1e-8)


def test_tasks_of_infinite_weight_are_equations():
    scene, (q, v) = scene_of("solo12"), states_of("solo12", 1)[0]
    hard = [
        JointTask("FL_HAA", a=1.0, weight=np.inf),
        ContactForce("HL_FOOT", (0.0, 0.0, 5.0), weight=np.inf),
        FrameTask("base_link", a=(0.0, 0.0, 0.1), weight=np.inf),
    ]
    for tasks in ([hard[0]], hard[1:]):
        free = without(scene, ["FL_FOOT"])
        python, core = pair(free, [*tasks, *tasks_of("solo12")[1:]], OCTAGON)
        out = core.solve(q, v)
        assert_same(python.solve(q, v), out)
        assert max(np.abs(out.errors[task.name]).max() for task in tasks) < 1e-9


@pytest.mark.parametrize(
    "limits",
    [
        ControlLimits(torque=False),
        ControlLimits(torque=False, acceleration=3.0),
        ControlLimits(acceleration=np.linspace(5.0, 50.0, 38)),
    ],
)
def test_limits_of_joints_hold(limits):
    scene = without(scene_of("talos"), ["left_sole_link"])
    wild = [*tasks_of("talos"), JointTask("leg_left_4_joint", a=-1e4, weight=1e3)]
    python, core = pair(scene, wild, CONES["talos"], limits=limits)
    for q, v in states_of("talos", 5):
        assert_same(python.solve(q, v), core.solve(q, v))
    assert core.solve(q, v).active or limits == ControlLimits(torque=False)


def test_contacts_are_switched():
    scene = scene_of("solo12")
    python, core = pair(scene, tasks_of("solo12"), OCTAGON)
    lifts = [*tasks_of("solo12"), FrameTask("FL_FOOT", a=(0.0, 0.0, 2.0))]
    for number, (q, v) in enumerate(states_of("solo12", 12)):
        now = without(scene, ["FL_FOOT"]) if number // 3 % 2 else scene
        tasks = lifts if now is not scene else None
        assert_same(python.use(now, tasks).solve(q, v), core.use(now, tasks).solve(q, v))


def test_floors_slope_and_edges_lie_on_them():
    slope = (0.2, -0.1, 1.0)
    for name, cone in (
        ("solo12", FrictionCone(0.7, normal=slope, sides=6)),
        ("cassie", WrenchCone(0.7, normal=(0.0, 0.0, 2.0), pyramid="outer")),
    ):
        python, core = pair(scene_of(name), tasks_of(name, a=(2.0, 1.0, 0.0)), cone)
        for q, v in states_of(name, 3):
            assert_same(python.solve(q, v), core.solve(q, v), SAME[name])


def test_drift_gears_passive_torques_and_held_contacts_count():
    scene = scene_of("solo12")
    passive = np.linspace(-0.1, 0.1, 18)
    held = dict.fromkeys(("FR_FOOT", "HL_FOOT", "HR_FOOT"), OCTAGON)
    for cones, options in (
        (OCTAGON, {"drift": cp.Baumgarte(20.0, 20.0)}),
        (held, {"actuation": Actuation(scene.robot, ratios={"FL_KFE": 9.0})}),
        (held, {"rigid": ["FL_KFE"], "actuation": Actuation(scene.robot, scene.robot.joints[1:3])}),
    ):
        python, core = pair(scene, tasks_of("solo12"), cones, **options)
        for q, v in states_of("solo12", 4):
            given = python.solve(q, v, passive=passive), core.solve(q, v, passive=passive)
            if given[0].status.ok:
                assert_same(*given, 1e-8)


def test_loops_motors_against_each_other_and_redundant_rows():
    bar = cp.model.five_bar()
    closed = cp.Scene(bar, bar.loops)
    every = Actuation(bar, bar.joints)
    python, core = pair(closed, [Posture(joints=bar.joints)], {}, actuation=every)
    q, v = closed.state()
    assert_same(python.solve(q, v), core.solve(q, v))

    cassie = robot("cassie")  # its feet are two points each, its loops have redundant rows
    standing = cp.Scene(cassie, [*cassie.loops, *cassie.contacts])
    springs = [spring.joint for spring in cassie.springs]
    python, core = pair(standing, tasks_of("cassie"), OCTAGON, rigid=springs)
    q, v = standing.state()
    passive = cassie.passive_torque(q, v)
    for speed in (0.0, 0.3):
        wish = speed * np.random.default_rng(3).normal(size=cassie.nv)
        v = project_velocity(cp.Scene(cassie, cassie.loops), q, wish)
        two = python.solve(q, v, passive=passive), core.solve(q, v, passive=passive)
        assert_same(*two, SAME["cassie"])
        assert two[1].rigid.shape == (len(springs),)


@pytest.mark.parametrize("name", ["rolling_ball", "rolling_disc"])
def test_forces_on_what_rolls_are_in_its_axes(name):
    made = robot(name)
    scene, cone = cp.Scene(made, made.contacts), FrictionCone(0.8)
    force = ContactForce(made.contacts[0].name, (1.0, 2.0, 20.0), weight=1e-2)
    python, core = pair(
        scene, [force, Posture(joints=made.joints)], cone,
        actuation=Actuation(made, made.joints), limits=ControlLimits(torque=False),
    )  # fmt: skip
    rng = np.random.default_rng(0)
    for _ in range(5):
        q, v = scene.sample(rng, spread=0.3, speed=1.0)
        out = core.solve(q, v)
        assert_same(python.solve(q, v), out)
        assert np.abs(out.errors[force.name]).max() < 0.1


def test_what_contradicts_itself_is_told_as_by_python():
    scene, (q, v) = scene_of("solo12"), states_of("solo12", 1)[0]
    falls = [CenterOfMass(a=(0.0, 0.0, -15.0), weight=np.inf), Posture()]
    python, core = pair(scene, falls, OCTAGON)
    two = python.solve(q, v), core.solve(q, v)
    assert two[0].status is two[1].status is ControlStatus.INFEASIBLE
    assert str(two[0].infeasible) == str(two[1].infeasible)
    assert two[1].path[-1] == "elastic program"
    assert np.isnan(two[1].tau).all()
    stands = core.use(scene, tasks_of("solo12"))
    assert_same(python.use(scene, tasks_of("solo12")).solve(q, v), stands.solve(q, v))


def test_what_it_does_not_take_is_refused_by_name_or_done_by_python():
    with own_task(still, "m/s^2") as Own:
        scene, (q, v) = scene_of("solo12"), states_of("solo12", 1)[0]
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
                Controller(scene, tasks, **options, native=True)
            either = Controller(scene, tasks, **options, native="where possible")
            if "no cone" not in reason:
                out = Controller(scene, tasks, **options).solve(q, v)
                same = either.solve(q, v)
                assert np.allclose(same.tau, out.tau, rtol=0, atol=1e-8)
                assert same.path == out.path


def test_bad_input_is_named_and_nan_is_never_ok():
    scene, (q, v) = scene_of("solo12"), states_of("solo12", 1)[0]
    for controller in pair(scene, tasks_of("solo12"), OCTAGON):
        for wrong, words in (
            (lambda c: c.solve(q[:5], v), "q has shape"),
            (lambda c: c.solve(q, v * np.nan), "v.*finite"),
            (lambda c: c.solve(q, v + 1e200), "overflows"),
            (lambda c: c.solve(q, v, np.inf), "t.*finite"),
            (lambda c: c.solve(q, v, passive=[1.0]), "passive has shape"),
            (lambda c: c.solve(2 * q, v), "quaternion"),
        ):
            with pytest.raises(cp.InvalidArgument, match=words):
                wrong(controller)
    with pytest.raises(cp.InvalidArgument, match="native = 'yes'"):
        Controller(scene, tasks_of("solo12"), cones=OCTAGON, native="yes")
    lost = CenterOfMass(reference=lambda t: (q[:3] * np.nan, q[:3], q[:3]), name="lost")
    for controller in pair(scene, [lost], OCTAGON):
        with pytest.raises(cp.InvalidArgument, match=r"lost: reference\(0.3\)"):
            controller.solve(q, v, 0.3)


def test_numbers_of_tasks_that_do_not_fit_are_refused_at_the_border():
    """What would be written beyond the end of a matrix never gets that far."""
    scene = scene_of("solo12")
    tasks = [*tasks_of("solo12"), JointTask("FL_HAA"), ContactForce("FL_FOOT", weight=1e-3)]
    controller = Controller(scene, tasks, cones=OCTAGON, native=True)
    arrays = compiled.of_program(controller._program, 1e-8)
    compiled_tick().Tick(**arrays)
    kind, size, at = 0, 1, 2  # columns
    for row, column, value in (
        *((i, kind, 99) for i in range(5)), *((i, size, 2) for i in range(5)),
        *((i, at, 99) for i in (1, 3, 4)),
    ):  # fmt: skip
        bad = arrays["tasks"].copy()
        bad[row, column] = value
        with pytest.raises(ValueError, match="task"):
            compiled_tick().Tick(**(arrays | {"tasks": bad}))
    apart = arrays | {"touching": [], "held": [*range(scene.rows)], "cones": np.zeros((0, 0))}
    with pytest.raises(ValueError, match="contact of a task"):
        compiled_tick().Tick(**apart)


def test_answers_are_the_callers_own_and_controllers_are_pickled():
    scene = scene_of("solo12")
    (q, v), (q2, v2) = states_of("solo12", 2)
    core = Controller(scene, tasks_of("solo12"), cones=OCTAGON, native=True)
    first = core.solve(q, v)
    tau, forces = first.tau.copy(), first.lam.copy()
    core.solve(q2, v2)
    assert np.array_equal(first.tau, tau)
    assert np.array_equal(first.lam, forces)
    copy = pickle.loads(pickle.dumps(core))
    assert copy.solve(q, v).path == IN_CORE
    assert np.allclose(copy.solve(q, v).tau, tau, rtol=0, atol=1e-12)
