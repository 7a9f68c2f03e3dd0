"""Transmission: the four-bar's own formulas, power, and what motors do not determine."""

from __future__ import annotations

import pickle

import numpy as np
import pinocchio as pin
import pytest
from shared import all_scenes, each_of, robot, states

import condyn_pin as cp
from condyn_pin.control import Actuation, gravity_compensation, transmission
from condyn_pin.model import CoupledMotor

WITH_MOTORS = [
    label for label, scene in all_scenes().items() if scene.robot.actuated and scene.rows
]
each_scene_with_motors = each_of(WITH_MOTORS)


def four_bar(**sizes: float) -> cp.Scene:
    bar = cp.model.four_bar(**sizes)
    return cp.Scene(bar, bar.loops)


@pytest.mark.parametrize("seed", range(5))
def test_a_four_bar_has_the_ratio_of_the_textbook(seed):
    """rocker / crank = a sin(t2 - t3) / (c sin(t4 - t3)), with the absolute angles of the bars."""
    a, b, c = 0.3, 0.8, 0.6
    scene = four_bar()
    q, _ = scene.sample(np.random.default_rng(seed), spread=1.0)
    t2, t3, t4 = q[0], q[0] + q[1], q[2]
    of_rocker = a * np.sin(t2 - t3) / (c * np.sin(t4 - t3))
    of_coupler = a * np.sin(t4 - t2) / (b * np.sin(t3 - t4))
    through = transmission(scene, q)
    assert np.allclose(through.G[:, 0], [1.0, of_coupler - 1.0, of_rocker], rtol=1e-12, atol=1e-13)
    assert through.motor_torques([0.0, 0.0, 10.0])[0] == pytest.approx(10.0 * of_rocker, rel=1e-12)
    assert through.joint_torques([10.0], ["rocker"])[0] == pytest.approx(
        10.0 / of_rocker, rel=1e-12
    )
    assert (through.undetermined, through.conflicting, through.at_rest) == (0, 0, ())


def test_a_parallelogram_is_one_to_one():
    scene = four_bar(ground=0.7, crank=0.4, coupler=0.7, rocker=0.4)
    q = scene.assemble([0.9, -0.9, 0.9]).q
    through = transmission(scene, q, actuation=Actuation(scene.robot, ratios=[20.0]))
    assert np.allclose(through.G[:, 0], np.array([1.0, -1.0, 1.0]) / 20.0, atol=1e-12)
    assert through.motor_torques([0.0, 0.0, 60.0])[0] == pytest.approx(3.0, rel=1e-12)
    assert through.joint_torques([3.0], ["rocker"])[0] == pytest.approx(60.0, rel=1e-12)


@each_scene_with_motors
def test_power_at_the_motors_is_power_at_the_joints(label):
    """u . w = tau . v to 1e-12, for speeds of the motors that fit together."""
    scene, (q, _, _) = all_scenes()[label], states(label)[0]
    through = transmission(scene, q)
    J = cp.Workspace(scene).jacobian(q)
    assert np.abs(J @ through.G).max() < 1e-12 * max(np.abs(J).max() * np.abs(through.G).max(), 1)
    assert np.abs(J @ through.free).max(initial=0.0) < 1e-12 * np.abs(J).max()
    rng = np.random.default_rng(0)
    for _ in range(5):
        tau, any_w = rng.normal(size=scene.robot.nv), rng.normal(size=through.G.shape[1])
        v = through.velocities(any_w)
        w = through.actuation.B.T @ v  # what the motors themselves turn
        u = through.motor_torques(tau)
        size = np.abs(tau) @ np.abs(v)
        assert abs(u @ w - tau @ v) < 1e-12 * size
        assert np.allclose(through.velocities(w), v, rtol=0, atol=1e-12 * np.abs(v).max())


@each_scene_with_motors
def test_directions_add_up(label):
    """Motors that fit, and what is left with the motors held: together the mobility."""
    scene, (q, _, _) = all_scenes()[label], states(label)[0]
    through = transmission(scene, q)
    S = np.linalg.svd(cp.Workspace(scene).jacobian(q), compute_uv=False)
    mobility = scene.robot.nv - np.count_nonzero(1e-7 * S[0] < S)
    assert through.undetermined + through.G.shape[1] - through.conflicting == mobility
    moving = np.hstack([through.G, through.free])
    assert np.linalg.matrix_rank(moving, tol=1e-9) == mobility
    assert np.abs(through.free[through.actuation.columns]).max(initial=0.0) < 1e-12
    assert len(through.at_rest) <= through.undetermined


@pytest.mark.long
def test_a_torque_is_held_by_the_motor_that_the_map_says():
    """Statics: a load on coupler and rocker, and its counterpart at the crank, change nothing."""
    scene = four_bar()
    q, v = scene.sample(np.random.default_rng(1))
    load = np.array([0.0, 3.0, -7.0])
    u = transmission(scene, q).motor_torques(load)
    falling = cp.solve(scene, q, v, np.zeros(3)).a
    held = cp.solve(scene, q, v, load - np.array([u[0], 0.0, 0.0])).a
    assert np.abs(held - falling).max() < 1e-11
    assert np.abs(cp.solve(scene, q, v, load).a - falling).max() > 1.0


def test_the_map_is_the_derivative_of_the_closed_mechanism():
    scene = four_bar()
    q, _ = scene.sample(np.random.default_rng(2))
    h = 1e-4
    ahead, behind = (scene.assemble(q + step * np.eye(3)[0], fixed=["crank"]).q for step in (h, -h))
    through = transmission(scene, q)
    assert np.allclose(through.G[:, 0], (ahead - behind) / (2 * h), atol=1e-6)
    model, data = scene.robot.model, scene.robot.model.createData()
    tips = []
    for there in (ahead, behind):
        pin.framesForwardKinematics(model, data, there)
        tips.append(data.oMf[model.getFrameId("coupler_tip")].translation.copy())
    J = through.jacobian("coupler_tip")
    assert J.shape == (6, 1)
    assert np.allclose(J[:3, 0], (tips[0] - tips[1]) / (2 * h), atol=1e-6)
    # about -y, with the coupler: the crank's turn and the coupler's against it
    assert J[4, 0] == pytest.approx(-(through.G[0, 0] + through.G[1, 0]), rel=1e-12)


def test_a_dead_point_shows():
    """Crank and coupler in line: the rocker as motor can neither move nor hold the crank."""
    bar = cp.model.four_bar()
    reach = 0.3 + 0.8
    at_ground = np.arccos((0.7**2 + reach**2 - 0.6**2) / (2 * 0.7 * reach))
    C = reach * np.array([np.cos(at_ground), np.sin(at_ground)])
    rocker = np.arctan2(C[1], C[0] - 0.7)
    scene = cp.Scene(bar, bar.loops)
    through = transmission(scene, [at_ground, 0.0, rocker], actuation=Actuation(bar, ["rocker"]))
    assert (through.undetermined, through.conflicting) == (1, 1)
    assert np.abs(through.G).max() < 1e-6
    assert through.free[2, 0] == 0.0
    with pytest.raises(cp.InvalidArgument, match="cannot do what the motors do"):
        transmission(scene, [at_ground, 0.0, rocker]).joint_torques([1.0], ["rocker"])


@pytest.mark.long
def test_cassies_base_springs_and_rods_rest():
    cassie = robot("cassie")
    legs = cp.Scene(cassie, cassie.loops)
    q, _ = legs.sample(np.random.default_rng(0))
    through = transmission(legs, q)
    assert (through.undetermined, through.conflicting) == (12, 0)
    assert "root_joint" in through.at_rest
    springs = {spring.joint for spring in cassie.springs}
    assert len(springs & set(through.at_rest)) == 4
    # with the springs at rest, the achilles rod ties the tarsus to the knee, one to one but for
    # the rod: a torque at the tarsus is felt in the knee motor with the opposite sign
    tau = np.zeros(cassie.nv)
    tau[cassie.index_v("left-shin-tarsus-joint")] = 1.0
    torques = dict(zip(through.actuation.motors, through.motor_torques(tau), strict=True))
    assert -1.3 < torques["left-knee-op"] < -0.7
    assert abs(torques["right-knee-op"]) < 1e-12


CLOSED = ["cassie loops", "delta loops", "four_bar loops", "parallelogram loops", "stewart loops"]


@pytest.mark.long
@pytest.mark.parametrize("label", CLOSED)
def test_it_is_how_complete_state_follows_the_motors(label):
    scene, (q, _, _) = all_scenes()[label], states(label)[0]
    motors = [scene.robot.index_q(name) for name in scene.robot.actuated]
    state = cp.mechanism.complete_state(scene, q[motors], near=q)
    through = transmission(scene, state.q)
    assert np.abs(through.G - state.G).max() < 1e-9 * np.abs(state.G).max()
    assert through.undetermined == state.undetermined
    assert through.conflicting == state.conflicting == 0


def five_bar() -> cp.Scene:
    bar = cp.model.five_bar()
    return cp.Scene(bar, bar.loops)


def differential(scene: cp.Scene, k: float = 1.0) -> Actuation:
    return Actuation(scene.robot, [
        CoupledMotor("sum", {"left_motor": k, "right_motor": k}),
        CoupledMotor("difference", {"left_motor": 1.0, "right_motor": -1.0}),
    ])  # fmt: skip


@pytest.mark.parametrize("gear", [1.0, 30.0])
def test_a_differential_through_a_loop(gear):
    """w = D (v_left, v_right): v = G D^-1 w, with G of the two cranks alone."""
    scene = five_bar()
    q, _ = scene.sample(np.random.default_rng(0))
    through = transmission(scene, q, actuation=differential(scene, gear))
    D = np.array([[gear, gear], [1.0, -1.0]])
    cranks = transmission(scene, q, actuation=Actuation(scene.robot, ["left_motor", "right_motor"]))
    assert np.allclose(through.G, cranks.G @ np.linalg.inv(D), rtol=1e-11, atol=1e-12)
    assert (through.undetermined, through.conflicting, through.at_rest) == (0, 0, ())
    tau = np.random.default_rng(1).normal(size=scene.robot.nv)
    u = through.motor_torques(tau)
    assert np.allclose(D.T @ u, cranks.motor_torques(tau), rtol=1e-10, atol=1e-11)
    given = through.joint_torques(u, ["left_motor", "right_motor"])
    assert np.allclose(given, D.T @ u, rtol=1e-10, atol=1e-11)
    J = cranks.jacobian("left_rod") @ np.linalg.inv(D)
    assert np.allclose(through.jacobian("left_rod"), J, rtol=1e-10, atol=1e-11)


@pytest.mark.long
@pytest.mark.parametrize("more", [(), ("left_motor",), ("left_motor", "right_motor")])
def test_power_of_motors_on_several_joints(more):
    """u . w = tau . v, also where more motors than freedoms conflict; statics holds."""
    scene = five_bar()
    q, v = scene.sample(np.random.default_rng(2))
    pair = differential(scene).joints
    actuation = Actuation(scene.robot, [*pair, *more], [5.0] * len(more))
    through = transmission(scene, q, actuation=actuation)
    assert (through.undetermined, through.conflicting) == (0, len(more))
    assert np.abs(cp.Workspace(scene).jacobian(q) @ through.G).max() < 1e-12
    rng = np.random.default_rng(3)
    tau, any_w = rng.normal(size=scene.robot.nv), rng.normal(size=through.G.shape[1])
    moving = through.velocities(any_w)
    w, u = actuation.B.T @ moving, through.motor_torques(tau)
    assert u @ w == pytest.approx(tau @ moving, rel=1e-11)
    assert np.allclose(through.velocities(w), moving, rtol=1e-11, atol=1e-12)
    falling = cp.solve(scene, q, v, 0 * v).a
    assert np.abs(cp.solve(scene, q, v, tau - actuation.B @ u).a - falling).max() < 1e-9


def test_one_cable_over_two_joints_leaves_one_of_them_open():
    """A motor that shortens a cable over shoulder and elbow determines the sum alone."""
    arm = cp.model.chain(2)
    cable = CoupledMotor("cable", dict(zip(arm.joints, [0.03, 0.02], strict=True)))
    through = transmission(cp.Scene(arm), [0.3, 0.4], actuation=Actuation(arm, [cable]))
    assert (through.undetermined, through.conflicting) == (1, 0)
    assert len(through.at_rest) == 1
    assert [0.03, 0.02] @ through.G[:, 0] == pytest.approx(1.0, rel=1e-12)
    assert np.abs([0.03, 0.02] @ through.free).max() < 1e-12


@pytest.mark.long
def test_two_feet_on_the_ground_tie_the_motors():
    """Six conditions among 32 motors; the torques that hold a load are the smallest."""
    talos = robot("talos")
    stance = cp.Scene(talos, talos.contacts)
    q, v = stance.state()
    through = transmission(stance, q)
    assert (through.undetermined, through.conflicting, through.at_rest) == (0, 6, ())
    h = cp.Workspace(stance).terms(q, v).h
    assert np.allclose(through.motor_torques(h), gravity_compensation(stance, q).u, atol=1e-9)


@pytest.mark.long
def test_what_no_motor_sees_is_along_free():
    talos = robot("talos")
    alone = transmission(cp.Scene(talos), talos.postures["half_sitting"])
    assert alone.at_rest == ("root_joint",)
    assert alone.undetermined == 6
    push = np.zeros(talos.nv)
    push[2] = 100.0
    assert np.abs(alone.motor_torques(push)).max() == 0.0
    assert np.linalg.norm(alone.free.T @ push) == pytest.approx(100.0)


def test_what_the_motors_leave_open_of_a_frame_has_no_jacobian():
    """A crane, upright: a turntable, a luffing hinge without a motor, and a tip beside both."""
    model, one = pin.Model(), pin.SE3.Identity()
    table = model.addJoint(0, pin.JointModelRZ(), one, "table")
    model.appendBodyToJoint(table, pin.Inertia.FromSphere(1.0, 0.1), one)
    boom = model.addJoint(table, pin.JointModelRY(), one, "boom")
    model.appendBodyToJoint(boom, pin.Inertia.FromSphere(1.0, 0.1), one)
    tip = pin.SE3(np.eye(3), np.array([0.5, 0.0, 0.0]))
    model.addFrame(pin.Frame("tip", boom, 0, tip, pin.FrameType.OP_FRAME))
    crane = cp.Robot("crane", model, actuated=["table"])
    through = transmission(cp.Scene(crane), [0.0, 0.3])
    assert through.at_rest == ("boom",)
    # the boom lifts along x and z, and turns about y: the rest is the table's alone
    nan, side = np.nan, 0.5 * np.cos(0.3)
    assert np.allclose(through.jacobian("tip")[:, 0], [nan, side, nan, 0, nan, 1], equal_nan=True)
    held = through.jacobian("tip", held=["boom"])
    assert np.allclose(held[:, 0], [0.0, side, 0.0, 0.0, 0.0, 1.0])
    with pytest.raises(cp.InvalidArgument, match=r"table is not at rest; .* are boom"):
        through.jacobian("tip", held=["table"])


@pytest.mark.parametrize("robot_name", ["cassie", "solo12"])
def test_a_frame_is_determined_once_base_and_springs_are_held(robot_name):
    made = robot(robot_name)
    scene = cp.Scene(made, made.loops)
    q, _ = scene.state()
    through, frame = transmission(scene, q), made.contacts[0].frames[0]
    assert np.isnan(through.jacobian(frame)).all()
    J = through.jacobian(frame, held=through.at_rest)
    assert np.isfinite(J).all()
    assert np.abs(J).max() > 0.1


@pytest.mark.long
@pytest.mark.parametrize("robot_name", ["delta", "stewart"])
def test_the_middle_of_a_platform_is_moved_by_its_motors_alone(robot_name):
    made = robot(robot_name)
    scene = cp.Scene(made, made.loops)
    q, _ = scene.state("home")
    assert np.abs(made.frame_pose(q, "platform_centre").translation[:2]).max() < 1e-12
    J = transmission(scene, q).jacobian("platform_centre")
    assert np.linalg.matrix_rank(J, tol=1e-6) == len(made.actuated)
    assert np.ptp(J[2]) < 1e-9  # all alike lift it


def test_answers_pickle_and_refuse():
    scene = four_bar()
    q, _ = scene.state()
    through = transmission(scene, q)
    assert np.array_equal(pickle.loads(pickle.dumps(through)).G, through.G)
    assert repr(through) == "Transmission(four_bar: 1 motor, 0 undetermined, 0 conflicting)"
    for call, error, said in (
        (lambda: through.velocities([1.0, 2.0]), cp.InvalidArgument, "w has shape"),
        (lambda: through.motor_torques([1.0]), cp.InvalidArgument, "tau has shape"),
        (lambda: through.joint_torques([1.0], ["roker"]), cp.errors.UnknownName, "'rocker'"),
        (lambda: through.jacobian("world"), cp.InvalidArgument, "does not move"),
        (lambda: through.jacobian("coupler_tp"), cp.errors.UnknownName, "'coupler_tip'"),
        (lambda: transmission(scene, [1.0]), cp.InvalidArgument, "q has shape"),
    ):
        with pytest.raises(error, match=said):
            call()
