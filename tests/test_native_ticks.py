"""Compiled control ticks: capture points, springs that are locked, driven rows, scenes of any size.

Each answer is that of Python. Without the core these tests are left out; where CI=true they fail.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from shared import robot
from test_control_swing import two_masses
from test_driven_control import carried
from test_native_control import HAND, IN_CORE, OCTAGON, SAME, assert_same, pair

import condyn_pin as cp
from condyn_pin._core._pin import pin
from condyn_pin._core.compiled import compiled_tick
from condyn_pin.constraints import Coupling, Driven, HeldJoint, KnifeEdge, Polynomial, Sine
from condyn_pin.contact import FrictionCone, WrenchCone
from condyn_pin.control import (
    Actuation,
    AngularMomentum,
    CapturePoint,
    CenterOfMass,
    ContactForce,
    Controller,
    ControlLimits,
    ControlStatus,
    FrameTask,
    JointTask,
    Orientation,
    Posture,
    compiled,
)
from condyn_pin.mechanism import anchored, project_velocity

# The core has Pinocchio's headers in it; that scenes cross from either version: test_native.py.
pytestmark = [pytest.mark.native, pytest.mark.once]
pytest.importorskip("proxsuite")

Array = NDArray[np.float64]
PATH = Sine(0.2, 0.8, 0.4)


def standing(name: str) -> cp.Scene:
    made = robot(name)
    return cp.Scene(made, [*made.loops, *made.contacts])


def states_of(scene: cp.Scene, speed: float, count: int) -> list[tuple[Array, Array]]:
    """Return states about where it stands, with rows that keep their places."""
    q, _ = scene.state()
    wishes = speed * np.random.default_rng(7).normal(size=(count, scene.robot.nv))
    return [(q, project_velocity(scene, q, wish)) for wish in wishes]


@pytest.mark.parametrize("name", ["solo12", "talos"])
@pytest.mark.parametrize("speed", [0.05, 2.0], ids=["within the support", "drawn to its edge"])
def test_capture_points_return_as_in_python(name, speed):
    """Where the pressure is within the support it is a centre of mass with these gains."""
    scene, cone = standing(name), {"solo12": OCTAGON, "talos": WrenchCone(0.5)}[name]
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
        for q, v in states_of(scene, speed, 6):
            answer = python.solve(q, v)
            if answer.status.ok:  # an equation may ask for more than the feet can give
                assert_same(answer, core.solve(q, v), SAME[name])
                drawn += np.abs(plain.solve(q, v).a - answer.a).max() > 1e-3
    assert (drawn > 3) == (speed == 2.0)


def swinging_cassie(native: bool, **options) -> tuple[Controller, Array]:
    """Return a controller of all that `benchmarks/standing.py` has, and where it stands."""
    scene = standing("cassie")
    q, _ = scene.state()
    springs = [spring.joint for spring in scene.robot.springs]
    tasks = [
        CapturePoint(weight=1000),
        Orientation("pelvis", kp=100, weight=0.3),
        Posture(weight=0.1),
    ]
    made = Controller(
        anchored(scene, q), tasks, cones=FrictionCone(0.65, sides=8), rigid=springs,
        drift=cp.Baumgarte.critical(10.0), native=native, **options,
    )  # fmt: skip
    return made, q


@pytest.mark.parametrize("open_by", [0.0, 1e-4], ids=["loops hold", "loops drift"])
def test_springs_of_cassie_are_locked_in_the_core(open_by):
    """As she stands in `benchmarks/standing.py`: one compiled tick, from the v that is measured."""
    (python, q), (core, _) = swinging_cassie(False), swinging_cassie(True)
    made, rng = python.scene.robot, np.random.default_rng(3)
    loops = cp.Scene(made, made.loops)
    springs = python._program.rigid
    for speed in (0.1, 0.1, 0.3, 0.3):
        v = project_velocity(loops, q, speed * rng.normal(size=made.nv))
        v = v + open_by * rng.normal(size=made.nv)
        passive = made.passive_torque(q, v)
        mine, yours = python.solve(q, v, passive=passive), core.solve(q, v, passive=passive)
        assert_same(mine, yours, SAME["cassie"])
        assert np.abs(springs @ v).max() > 1e-3
        assert np.abs(yours.v - mine.v).max() < 1e-9
        assert np.abs(springs @ yours.v).max() < 1e-12


def test_nothing_is_locked_that_does_not_swing():
    core, q = swinging_cassie(True)
    wish = 0.1 * np.random.default_rng(5).normal(size=core.scene.robot.nv)
    v = project_velocity(core.scene, q, wish)
    v[core._program.rigid.argmax(axis=1)] = 0.0
    out = core.solve(q, v)
    assert out.path == IN_CORE
    assert (out.v == v).all()


def test_springs_outside_of_loops_are_locked_too():
    """Also one that carries next to nothing: the momentum is that of the motor."""
    scene = two_masses()
    light = pin.Model(scene.robot.model)
    light.inertias[2] = pin.Inertia(1e-9, np.zeros(3), np.zeros((3, 3)))
    light = replace(scene.robot, model=light)
    q, v = np.zeros(2), np.array([0.3, -2.0])
    for each in (scene.robot, light):
        tasks = [JointTask("motor", reference=0.3)]
        python, core = pair(cp.Scene(each), tasks, {}, rigid=["load"])
        mine, yours = python.solve(q, v), core.solve(q, v)
        assert_same(mine, yours)
        assert yours.v == pytest.approx(mine.v, abs=1e-14)
        assert yours.v[1] == pytest.approx(0, abs=1e-15)


def test_a_spring_that_loops_turn_is_left_to_python():
    """To lock what loops move contradicts the speed of the motor: rows that do not agree."""
    bar = cp.model.four_bar()
    scene = cp.Scene(bar, bar.loops)
    q, v = scene.state()
    crank, *others = bar.joints
    v = project_velocity(scene, q, np.ones(bar.nv))
    rigid = [others[-1]]
    python, core = pair(
        scene, [JointTask(crank)], {}, actuation=Actuation(bar, [crank]), rigid=rigid
    )
    mine, yours = python.solve(q, v), core.solve(q, v)
    assert yours.path == mine.path != IN_CORE
    assert (yours.v == mine.v).all()


def cart():
    scene = cp.Scene(carried(effort=30.0), [Driven(HeldJoint("cart"), PATH)])
    return scene, [JointTask("arm", kp=100.0)], {}, {}


def crank():
    bar = cp.model.five_bar()
    first, second = bar.actuated
    home = float(cp.Scene(bar, bar.loops).state()[0][bar.index_q(first)])
    scene = cp.Scene(bar, [*bar.loops, Driven(HeldJoint(first, home), PATH)])
    return scene, [JointTask(second, kp=30.0)], {}, {"drift": cp.Baumgarte.critical(20.0)}


def arms():
    """A hand on a path, an elbow on another, two joints in step: feet press beside them."""
    talos = robot("talos")
    hand = Polynomial(((0.0, 0.1, 0, 0.2), (0, -0.2, 0.3, 0), (0.1, 0, 0, 0)))
    driven = [
        Driven(cp.Loop(HAND, "world"), hand),
        Driven(HeldJoint("arm_right_4_joint", -1.0), PATH),
        Driven(Coupling("head_1_joint", "head_2_joint", 1.5), Sine(0.1, 1.5)),
    ]
    scene = cp.Scene(talos, [*talos.contacts, *driven])
    tasks = [CenterOfMass(a=(0.2, 0, 0), weight=100), Orientation("base_link"), Posture(weight=0.1)]
    return scene, tasks, WrenchCone(0.5), {"drift": cp.Baumgarte(5.0, 5.0)}


def hip():
    cassie = robot("cassie")
    hip = Driven(HeldJoint("left-yaw-op", 0.0), PATH)
    scene = cp.Scene(cassie, [*cassie.loops, *cassie.contacts, hip])
    tasks = [CenterOfMass(weight=100), Orientation("pelvis", weight=50), Posture(weight=0.1)]
    return scene, tasks, OCTAGON, {"rigid": [spring.joint for spring in cassie.springs]}


def blade():
    """A row without a position: it follows the rate of its path."""
    made = cp.model.free_box()
    pushed = Driven(KnifeEdge(made.frames[-1]), Polynomial((0.0, 0.3, 0.0, 0.4)))
    tasks = [Posture(joints=made.joints)]
    options = {"actuation": Actuation(made, made.joints), "drift": cp.Baumgarte(5.0, 5.0)}
    return cp.Scene(made, [pushed]), tasks, {}, options


@pytest.mark.parametrize("made", [cart, crank, arms, hip, blade], ids=lambda made: made.__name__)
def test_driven_rows_follow_their_paths_as_in_python(made):
    scene, tasks, cones, options = made()
    python, core = pair(scene, tasks, cones, **options)
    rng = np.random.default_rng(2)
    driven = core._program.equations.driven
    assert len(driven)
    before = None
    for t in (0.0, 0.3, 1.1):
        q, v = scene.at(t).state()
        v = v + 0.1 * rng.normal(size=len(v))
        mine, yours = python.solve(q, v, t), core.solve(q, v, t)
        assert_same(mine, yours, SAME["cassie"] if made is hip else 1e-8)
        assert before is None or np.abs(before - yours.a).max() > 1e-3
        before = yours.a


def test_a_path_that_is_no_number_is_named():
    path = Driven(HeldJoint("cart"), lambda t: (0.0, 0.0, 0.0 if t < 5 else np.nan))
    for law in pair(cp.Scene(carried(), [path]), [JointTask("arm")], {}):
        assert law.solve([0.0, 0.1], [0.0, 0.0], 0.2).status.ok
        with pytest.raises(cp.InvalidArgument, match="cart"):
            law.solve([0.0, 0.1], [0.0, 0.0], 6.0)


def chain_of(joints: int, most: float) -> cp.Robot:
    made = cp.model.chain(joints)
    model = pin.Model(made.model)
    model.effortLimit = np.full(joints, most)
    return replace(made, model=model)


@pytest.mark.parametrize("joints", [1, 2, 7])
def test_robots_of_few_joints_without_constraints(joints):
    """Every joint has a motor: there are no equations at all, and limits are active."""
    made = chain_of(joints, 5.0)
    scene, frame = cp.Scene(made), made.frames[-1]
    q, v = np.linspace(0.3, 0.9, joints), np.linspace(-0.5, 0.5, joints)
    every = Actuation(made, made.joints)
    for tasks in (
        [Posture(q + 1.0, kp=300.0)],
        [JointTask(made.joints[0], a=50.0)],
        [CenterOfMass(a=(0.0, 0.0, 30.0))],
        [AngularMomentum((1.0, 2.0, 3.0))],
        [FrameTask(frame), Orientation(frame)],
        [FrameTask(frame, of="pose", kp=0.0)],
    ):
        for limits in (ControlLimits(), ControlLimits(torque=False)):
            python, core = pair(scene, tasks, {}, actuation=every, limits=limits)
            for _ in range(2):  # from nothing, and from the active set of the last
                assert_same(python.solve(q, v), core.solve(q, v), 1e-8)


def test_twenty_tasks_at_once():
    scene = standing("solo12")
    ends = ("FL_FOOT", "FR_FOOT", "HL_FOOT", "HR_FOOT")
    joints = scene.robot.joints[1:]
    tasks = [
        *(JointTask(joint, weight=0.1) for joint in joints),
        *(ContactForce(foot, (0.0, 0.0, 6.0), weight=1e-3) for foot in ends),
        CenterOfMass(weight=10), CapturePoint(weight=10), AngularMomentum(), Posture(weight=0.01),
    ]  # fmt: skip
    assert len(tasks) == 20
    python, core = pair(scene, tasks, OCTAGON)
    for q, v in states_of(scene, 0.2, 3):
        assert_same(python.solve(q, v), core.solve(q, v), 1e-8)


def test_more_equations_than_unknowns():
    """Twenty tasks that are equations and say the same."""
    scene = cp.Scene(chain_of(2, np.inf))
    first, second = scene.robot.joints
    same = [JointTask(first, a=1.0, weight=np.inf, name=f"{i}") for i in range(20)]
    every = Actuation(scene.robot, (first, second))
    python, core = pair(scene, [*same, Posture()], {}, actuation=every)
    q, v = np.array([0.3, 0.2]), np.zeros(2)
    mine, yours = python.solve(q, v), core.solve(q, v)
    assert_same(mine, yours)
    assert yours.a[0] == pytest.approx(1.0, abs=1e-9)


def test_what_leaves_nothing_to_eliminate_is_done_by_python():
    """Every joint held, and a motor that moves nothing: no rank, no unknowns."""
    made = carried()
    q, v = np.array([0.1, 0.2]), np.zeros(2)
    for held, motors in ((("cart", "arm"), ["arm"]), (("arm",), ["arm"])):
        scene = cp.Scene(made, [HeldJoint(joint) for joint in held])
        options = {"actuation": Actuation(made, motors)}
        python, core = pair(scene, [Posture(joints=motors)], {}, **options)
        mine, yours = python.solve(q, v), core.solve(q, v)
        assert (mine.path, mine.status) == (yours.path, yours.status)
        assert yours.path != IN_CORE
        assert np.array_equal(mine.tau, yours.tau, equal_nan=True)


@pytest.mark.parametrize("seed", range(6))
def test_motors_that_loops_hold_still_give_nothing(seed):
    """What is left of them by rounding is no way to move: it would take 1e17 N m."""
    made, rng = chain_of(6, np.inf), np.random.default_rng(seed)
    first, second, *_ = made.joints
    pin_of = cp.Loop("joint4_tip", "world")
    scene = cp.Scene(made, [pin_of, HeldJoint(first, 0.3), HeldJoint(second, 0.3)])
    q, v = rng.normal(size=(2, 6))
    for motors in ([first], [first, second], [first, made.joints[5]]):
        every = Actuation(made, motors)
        python, core = pair(scene, [Posture(joints=made.joints)], {}, actuation=every)
        mine, yours = python.solve(q, v), core.solve(q, v)
        assert mine.status is yours.status is ControlStatus.OK
        assert max(np.abs(mine.tau[:2]).max(), np.abs(yours.tau[:2]).max()) < 1e-9
        assert np.abs(mine.a - yours.a).max() < 1e-9 * max(9.81, np.abs(mine.a).max())


@pytest.mark.parametrize("seed", range(6))
def test_what_cannot_move_is_not_moved_by_what_rounding_leaves_of_it(seed):
    """A task, a limit and a foot that loops have decided: named as by Python, or nothing to do."""
    made, rng = chain_of(6, np.inf), np.random.default_rng(seed)
    first = made.joints[0]
    q, v = rng.normal(size=(2, 6))
    tip = cp.Loop("joint4_tip", "world")
    fast = Driven(HeldJoint(first), Polynomial((0.0, 0.0, 15.0)))
    whole = [Posture(joints=made.joints)]
    wished = [JointTask(first, a=1.0, weight=np.inf), *whole]
    limits = ControlLimits(acceleration=20.0)
    for held, tasks, limit in ((HeldJoint(first), wished, None), (fast, whole, limits)):
        options = {"actuation": Actuation(made, made.joints), "limits": limit}
        python, core = pair(cp.Scene(made, [tip, held]), tasks, {}, **options)
        mine, yours = python.solve(q, 0 * v), core.solve(q, 0 * v)
        assert mine.status is yours.status is ControlStatus.INFEASIBLE
        assert str(mine.infeasible) == str(yours.infeasible)


def test_a_foot_that_others_hold_is_held():
    """Its rows over what is left to move are rounding, and their forces anything."""
    solo = robot("solo12")
    leg = [HeldJoint(joint) for joint in ("FL_HAA", "FL_HFE", "FL_KFE")]
    base = cp.Loop("base_link", "world", "weld")
    foot = next(contact for contact in solo.contacts if contact.name == "FL_FOOT")
    scene = cp.Scene(solo, [foot, base, *leg])
    python, core = pair(scene, [Posture(weight=1.0)], {"FL_FOOT": OCTAGON})
    q, v = standing("solo12").state()
    mine, yours = python.solve(q, v), core.solve(q, v)
    assert mine.status is yours.status is ControlStatus.OK
    assert np.abs(mine.a - yours.a).max() < 1e-6


def test_one_motor_on_feet_that_are_held():
    """No contact has a cone, so that there is nothing but what is eliminated."""
    scene = standing("solo12")
    one = Actuation(scene.robot, ["FL_HAA"])
    python, core = pair(scene, [Posture()], {}, actuation=one)
    for q, v in states_of(scene, 0.2, 3):
        assert_same(python.solve(q, v), core.solve(q, v), 1e-8)


def test_numbers_that_do_not_fit_are_refused_at_the_border():
    """What would be read or written beyond the end of an array never gets that far."""
    scene = standing("solo12")
    knee = scene.state()[0][scene.robot.index_q("FL_KFE")] - PATH(0.0)[0][0]
    driven = Driven(HeldJoint("FL_KFE", float(knee)), PATH)
    scene = cp.Scene(scene.robot, [*scene.constraints, driven])
    controller = Controller(
        scene, [CapturePoint(), Posture()], cones={c.name: OCTAGON for c in scene.constraints[:4]},
        native=True,
    )  # fmt: skip
    arrays = compiled.of_program(controller._program, 1e-8)
    whole = compiled_tick().Tick(**arrays)
    of_x = arrays["tasks"].copy()
    of_x[0, 4] = 6  # half an edge
    no_edge = arrays["tasks"].copy()
    no_edge[0, 4] = 3
    floating = arrays["of_tasks"].copy()
    floating[0, 13] = 0.0  # omega
    for wrong, words in (
        ({"tasks": of_x}, "support of a task"),
        ({"tasks": no_edge}, "support of a task"),
        ({"of_tasks": floating}, "support of a task"),
        ({"driven": [scene.rows]}, "rows that are driven"),
        ({"driven": [-1]}, "rows that are driven"),
        ({"motors": []}, "motors"),
    ):
        with pytest.raises(ValueError, match=words):
            compiled_tick().Tick(**(arrays | wrong))
    q, v = scene.at(0.0).state()
    numbers = controller._tick._references.at(0.0)
    sides = np.zeros(len(controller.rows), np.int8)
    out = np.zeros(controller._tick._size)
    whole.solve(q, v, 0 * v, numbers, sides, out)
    for given in (
        (q[1:], v, 0 * v, numbers, sides, out),
        (q, v, 0 * v, numbers[:-1], sides, out),
        (q, v, 0 * v, numbers[:-3], sides, out),
        (q, v, 0 * v, numbers, sides[1:], out),
        (q, v, 0 * v, numbers, sides, out[len(v) :]),
    ):
        with pytest.raises(ValueError, match="does not fit"):
            whole.solve(*(np.ascontiguousarray(each) for each in given))
