"""Inverse kinematics with loops: closed forms, limits, levels of targets, and its proof."""

from __future__ import annotations

import math
import pickle
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import minimize

import condyn_pin as cp
from condyn_pin.control import (
    CenterOfMass,
    ContactForce,
    FrameTask,
    IKStatus,
    JointTask,
    Orientation,
    Posture,
    minimum_jerk,
)

pytest.importorskip("daqp")


def planar_arm(links: int = 3, reach: float = 0.5) -> cp.Robot:
    """A chain of hinges about z with links of one length, and a frame at its tip."""
    model = pin.Model()
    model.name = "planar arm"
    parent, place = 0, pin.SE3.Identity()
    for k in range(links):
        parent = model.addJoint(parent, pin.JointModelRZ(), place, f"joint{k + 1}")
        model.appendBodyToJoint(parent, pin.Inertia.Random(), pin.SE3.Identity())
        place = pin.SE3(np.eye(3), np.array([reach, 0.0, 0.0]))
        model.lowerPositionLimit[k], model.upperPositionLimit[k] = -3.0, 3.0
    model.addFrame(pin.Frame("tip", parent, place, pin.FrameType.OP_FRAME))
    return cp.Robot("planar arm", model)


def closed_states(scene: cp.Scene, count: int, spread: float) -> list[Any]:
    rng = np.random.default_rng(1)
    return [scene.sample(rng, spread=spread)[0] for _ in range(count)]


def test_platform_of_a_stewart_goes_where_it_is_sent() -> None:
    robot = cp.model.stewart()
    scene = cp.Scene(robot, robot.loops)
    for q in closed_states(scene, 8, 0.3):
        pose = robot.frame_pose(q, "platform")
        answer = cp.control.solve_ik(scene, [FrameTask("platform", reference=pose, of="pose")])
        there = robot.frame_pose(answer.q, "platform")
        assert answer.status.ok
        assert answer.assembly.closed
        assert answer.iterations <= 8
        assert np.linalg.norm(pin.log6(there.actInv(pose)).vector) < 1e-8


def test_motors_of_a_delta_are_those_of_its_closed_form() -> None:
    robot = cp.model.delta()
    scene = cp.Scene(robot, robot.loops)
    for q in closed_states(scene, 8, 0.2):
        p = robot.frame_pose(q, "platform_centre").translation
        answer = cp.solve_ik(scene, [FrameTask("platform_centre", reference=p)])
        motors = [answer.q[robot.index_q(f"motor{k}")] for k in (1, 2, 3)]
        np.testing.assert_allclose(motors, delta_motors(p), atol=1e-8)


def delta_motors(p: Any) -> list[float]:
    """Angles of the arms, the elbow below the base: |elbow - wrist| = 0.5 m."""
    base, top, arm, length = 0.2, 0.06, 0.25, 0.5
    angles = []
    for k in range(3):
        e = np.array([math.cos(2 * math.pi * k / 3), math.sin(2 * math.pi * k / 3), 0.0])
        w = p + (top - base) * e  # the wrist seen from the shoulder
        x, z = float(w @ e), float(w[2])
        # x cos(a) - z sin(a) = (arm^2 + |w|^2 - length^2) / (2 arm), and the outer one of the two
        share = (arm**2 + float(w @ w) - length**2) / (2 * arm * math.hypot(x, z))
        middle = math.atan2(-z, x)
        angles.append(min((middle + s * math.acos(share) for s in (1, -1)), key=abs))
    return angles


def test_feet_of_cassie_and_its_mass_go_where_they_are_sent() -> None:
    robot = cp.load_robot("cassie")
    ends = {"toe": [-0.052821, 0.092622, 0.0], "heel": [0.069746, -0.010224, 0.0]}
    for side in ("left", "right"):
        for end, at in ends.items():
            place = pin.SE3(np.eye(3), np.array(at))
            robot = robot.with_frame(f"{side}-{end}", f"{side}-foot", place)
    scene = cp.Scene(robot, robot.loops)
    q0, _ = scene.state("standing")
    springs = [spring.joint for spring in robot.springs]
    targets: list[Any] = []
    moved = {"left": ([0.15, 0.05, 0.02], 0.2), "right": ([-0.1, -0.03, 0.0], -0.1)}
    for side, (shift, yaw) in moved.items():
        points = [robot.frame_pose(q0, f"{side}-{end}").translation for end in ends]
        middle, turn = np.mean(points, axis=0), pin.exp3(np.array([0.0, 0.0, yaw]))
        for end, point in zip(ends, points, strict=True):
            reference = middle + shift + turn @ (point - middle)
            targets.append(FrameTask(f"{side}-{end}", reference=reference))
    over = np.mean([target.reference for target in targets], axis=0)
    targets.append(CenterOfMass(reference=over, axes="xy"))
    answer = cp.solve_ik(scene, targets, q0, fixed=springs)
    for target in targets[:-1]:
        there = robot.frame_pose(answer.q, target.frame).translation
        np.testing.assert_allclose(there, target.reference, atol=1e-8)
    np.testing.assert_allclose(robot.center_of_mass(answer.q)[:2], over[:2], atol=1e-8)
    for spring in springs:
        assert answer.q[robot.index_q(spring)] == q0[robot.index_q(spring)]
    nearer = cp.solve_ik(scene, targets, q0, fixed=springs, posture="standing")
    home = robot.postures["standing"]
    far, near = (np.linalg.norm(pin.difference(robot.model, home, a.q)) for a in (answer, nearer))
    assert nearer.status.ok
    assert near <= far


def test_limits_that_stop_a_platform_are_named() -> None:
    robot = cp.model.stewart()
    scene = cp.Scene(robot, robot.loops)
    q0, _ = scene.state()
    raised = robot.frame_pose(q0, "platform")
    raised.translation += [0.0, 0.0, 0.3]
    task = FrameTask("platform", reference=raised, of="pose")
    answer = cp.solve_ik(scene, [task], throw=False)
    assert answer.status is IKStatus.AT_LIMITS
    assert answer.status.word == "at_limits"
    assert answer.assembly.closed
    assert answer.at_limits
    assert all(name.startswith("leg") for name in answer.at_limits)
    assert answer.slope < 1e-6
    assert not answer.assembly.beyond_limits
    with pytest.raises(cp.errors.TargetsNotReached, match=r"leg1.*within_limits=False") as caught:
        cp.solve_ik(scene, [task])
    again = pickle.loads(pickle.dumps(caught.value))
    np.testing.assert_array_equal(again.answer.q, answer.q)
    assert cp.solve_ik(scene, [task], within_limits=False).status.ok


@pytest.mark.long
def test_what_is_out_of_reach_ends_where_the_arm_is_stretched() -> None:
    robot = planar_arm(2)
    answer = cp.solve_ik(
        cp.Scene(robot), [FrameTask("tip", reference=[3.0, 4.0, 0.0])], [0.3, 0.4], throw=False
    )
    assert answer.status is IKStatus.STATIONARY
    there = robot.frame_pose(answer.q, "tip").translation
    np.testing.assert_allclose(there, [0.6, 0.8, 0.0], atol=1e-6)
    np.testing.assert_allclose(answer.errors["tip position"], [2.4, 3.2, 0.0], atol=1e-6)


@pytest.mark.parametrize("lowest", [-3.0, 0.0])
def test_stretched_arm_bends_towards_a_target_along_it(lowest: float) -> None:
    """The gradient is zero there, and bending is the way; so it is where the elbow is at a stop."""
    robot = planar_arm(2).with_limits({"joint2": (lowest, 3.0)})
    task = FrameTask("tip", reference=[0.7, 0.0, 0.0])
    answer = cp.solve_ik(cp.Scene(robot), [task], [0.0, 0.0])
    assert abs(answer.q[1]) == pytest.approx(2.0 * math.acos(0.7), abs=1e-8)


@pytest.mark.long
def test_limit_that_is_not_in_the_way_is_no_reason() -> None:
    robot = planar_arm(3)
    tasks = [
        JointTask("joint1", reference=1.0, name="there"),
        JointTask("joint1", reference=0.0, name="here"),
    ]
    answer = cp.solve_ik(cp.Scene(robot), tasks, [0.2, 0.1, 3.0], throw=False)
    assert answer.at_limits == ("joint3",)
    assert answer.status is IKStatus.STATIONARY


@pytest.mark.long
@pytest.mark.parametrize("weight", [1e-300, 1e-12, 1e300])
def test_weights_count_by_their_ratios(weight: float) -> None:
    robot = planar_arm(2)
    task = FrameTask("tip", reference=[0.3, 0.6, 0.0], weight=weight)
    assert cp.solve_ik(cp.Scene(robot), [task], [0.3, 0.4]).status.ok


@pytest.mark.long
def test_weights_decide_between_targets_that_contradict() -> None:
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelPX(), pin.SE3.Identity(), "slide")
    model.appendBodyToJoint(joint, pin.Inertia.Random(), pin.SE3.Identity())
    robot = cp.Robot("slider", model)
    tasks = [
        JointTask("slide", reference=1.0, weight=3.0, name="there"),
        JointTask("slide", reference=0.0, weight=1.0, name="here"),
    ]
    answer = cp.solve_ik(cp.Scene(robot), tasks, throw=False)
    assert answer.status is IKStatus.STATIONARY
    assert answer.q[0] == pytest.approx(0.75, abs=1e-7)


def test_posture_decides_what_targets_leave_free() -> None:
    robot = planar_arm(3)
    scene, home = cp.Scene(robot), np.array([0.5, 0.2, 0.1])
    target = np.array([0.7, 0.6])
    task = FrameTask("tip", reference=[*target, 0.0], axes="xy")
    answer = cp.solve_ik(scene, [task], [0.1, 0.5, 0.5], posture=home)

    def miss(q: Any) -> Any:
        angles = np.cumsum(q)
        return 0.5 * np.array([np.cos(angles).sum(), np.sin(angles).sum()]) - target

    best = minimize(
        lambda q: float((q - home) @ (q - home)), answer.q + 0.05, method="SLSQP",
        constraints={"type": "eq", "fun": miss}, options={"ftol": 1e-14},
    )  # fmt: skip
    assert answer.status.ok
    np.testing.assert_allclose(answer.q, best.x, atol=1e-5)


def test_contacts_stay_and_references_are_those_of_the_time() -> None:
    robot = cp.load_robot("solo12")
    feet = ["FL_FOOT", "FR_FOOT", "HL_FOOT", "HR_FOOT"]
    scene = cp.Scene(robot, [cp.PointContact(foot) for foot in feet])
    q0, _ = scene.state("standing")
    high = robot.center_of_mass(q0)
    path = minimum_jerk(high, high - [0.0, 0.0, 0.04], 1.0)
    answer = cp.solve_ik(scene, [CenterOfMass(reference=path)], q0, t=0.5)
    np.testing.assert_allclose(robot.center_of_mass(answer.q), high - [0.0, 0.0, 0.02], atol=1e-8)
    for foot in feet:
        before, after = (robot.frame_pose(q, foot).translation for q in (q0, answer.q))
        np.testing.assert_allclose(after, before, atol=1e-9)


def test_orientation_and_posture_are_targets_too() -> None:
    robot = planar_arm(3)
    turn = pin.exp3(np.array([0.0, 0.0, 1.2]))
    tasks = [Orientation("tip", reference=turn), Posture([0.4, 0.0, 0.0], joints=["joint1"])]
    answer = cp.solve_ik(cp.Scene(robot), tasks, [0.0, 0.3, 0.3])
    assert answer.q[0] == pytest.approx(0.4, abs=1e-8)
    assert answer.q.sum() == pytest.approx(1.2, abs=1e-8)


def test_further_starts_find_what_the_first_does_not() -> None:
    robot = planar_arm(2).with_limits({"joint1": (-3.0, 3.0), "joint2": (0.0, 2.5)})
    scene, task = cp.Scene(robot), FrameTask("tip", reference=[0.0, 0.9, 0.0])
    start = [-2.9, 0.0]  # stretched the other way
    once = cp.solve_ik(scene, [task], start, throw=False)
    more = cp.solve_ik(scene, [task], start, attempts=30, throw=False)
    assert more.status.ok
    assert more.attempts >= once.attempts


def test_mistakes_are_named() -> None:
    robot = planar_arm(2)
    scene, task = cp.Scene(robot), FrameTask("tip", reference=[0.5, 0.5, 0.0])
    wrong: list[tuple[Any, dict[str, Any], str]] = [
        ([], {}, "targets: one at least"),
        (task, {}, "a list of tasks"),
        (None, {}, "targets = None: a list of tasks"),
        ([ContactForce("foot", reference=[0.0, 0.0, 1.0])], {}, "a task with a position"),
        ([FrameTask("tip", weight=math.inf)], {}, "weight = inf"),
        ([FrameTask("tip", weight=0.0)], {}, "weight = 0"),
        ([FrameTask("tip", a=[0.0, 0.0, 0.0])], {}, "a reference is needed"),
        ([task, task], {}, "two are named"),
        ([FrameTask("tip", axes="xq")], {}, "no axis named 'q'"),
        ([task], {"attempts": 0}, "attempts"),
        ([task], {"qp": "daqp"}, "qp = 'daqp'"),
        ([task], {"q0": [0.0]}, "q0"),
        ([task], {"posture": "lying"}, "lying"),
        ([task], {"fixed": ["elbow"]}, "elbow"),
    ]
    for targets, options, words in wrong:
        with pytest.raises(cp.CondynError, match=words):
            cp.solve_ik(scene, targets, **options)


# Sizes: of a micrometre and of a kilometre, of many bodies, and of what nobody reaches.


def arm(size: float) -> cp.Robot:
    """Three hinges, links of 0.3 times a size [m]."""
    model, parent = pin.Model(), 0
    for name, kind in (("yaw", pin.JointModelRZ()), ("one", pin.JointModelRY()),
                       ("two", pin.JointModelRY())):  # fmt: skip
        place = pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.3 * size]))
        parent = model.addJoint(parent, kind, place, name)
        model.appendBodyToJoint(parent, pin.Inertia.FromSphere(1.0, 0.1 * size), pin.SE3.Identity())
    tip = pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.4 * size]))
    model.addFrame(pin.Frame("tip", parent, 0, tip, pin.FrameType.OP_FRAME))
    return cp.Robot("arm", model)


def test_a_robot_of_any_size_ends_as_near_and_as_soon():
    found = {
        size: cp.solve_ik(
            cp.Scene(arm(size)),
            [cp.control.FrameTask("tip", reference=size * np.array([0.3, 0.2, 0.9]))],
            q0=[0.1, 0.2, 0.3],
        )
        for size in (1e-6, 1.0, 1e3)
    }
    assert {each.iterations for each in found.values()} == {found[1.0].iterations}
    for size, each in found.items():
        assert np.abs(each.errors["tip position"]).max() < 1e-9 * size
        assert each.q == pytest.approx(found[1.0].q, abs=1e-6)


@pytest.mark.parametrize("away", [1e12, 1e150])
def test_a_target_that_nobody_reaches_is_refused_by_name(away):
    task = cp.control.FrameTask("tip", reference=[away, 0.0, 0.0])
    with pytest.raises(cp.InvalidArgument, match=r"tip position: its target is 1e\+.* away"):
        cp.solve_ik(cp.Scene(arm(1.0)), [task], throw=False)


def test_turns_are_followed_as_they_are():
    """Quadratic from a third of a turn away: the slope of log3 is in the step."""
    model = pin.Model()
    j = model.addJoint(0, pin.JointModelSpherical(), pin.SE3.Identity(), "ball")
    model.appendBodyToJoint(j, pin.Inertia.FromSphere(1.0, 0.1), pin.SE3.Identity())
    turn = pin.exp3(np.array([0.25, 0.2, 0.1]))
    task = cp.control.Orientation("ball", reference=pin.Quaternion(turn).coeffs())
    found = cp.solve_ik(cp.Scene(cp.Robot("ball", model)), [task], q0=[0, 0, 0, 1.0])
    assert found.iterations <= 3


def test_many_bodies_that_nothing_holds_together():
    """As many as have memory for each tree; their centre of mass too."""
    model = pin.Model()
    for i in range(50):
        j = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), f"b{i}")
        model.appendBodyToJoint(j, pin.Inertia.FromSphere(1.0 + i, 0.1), pin.SE3.Identity())
    target = pin.SE3(pin.exp3(np.array([0.1, 0.2, 0.3])), np.array([0.3, 0.2, 0.1]))
    tasks = [
        cp.control.FrameTask("b7", of="pose", reference=pin.SE3ToXYZQUAT(target)),
        cp.control.CenterOfMass(reference=[0.1, -0.1, 0.2]),
    ]
    found = cp.solve_ik(cp.Scene(cp.Robot("bodies", model)), tasks)
    assert found.status.ok
    middles = found.q.reshape(50, 7)[:, :3]
    com = (1.0 + np.arange(50)) @ middles / np.sum(1.0 + np.arange(50))
    assert com == pytest.approx([0.1, -0.1, 0.2], abs=1e-8)
