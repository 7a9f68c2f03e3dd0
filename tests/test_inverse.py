"""Inverse dynamics: closed forms, forward of inverse, what motors cannot do, internal forces."""

from __future__ import annotations

import dataclasses
import pickle

import numpy as np
import pinocchio as pin
import pytest
from shared import each_row, relative, robot

import condyn_pin as cp
from condyn_pin.control import Actuation, gravity_compensation
from condyn_pin.model import CoupledMotor

GRAVITY = 9.81


def scene(name: str, *, contacts: bool = False) -> cp.Scene:
    chosen = robot(name)
    return cp.Scene(chosen, [*chosen.loops, *(chosen.contacts if contacts else ())])


@pytest.mark.parametrize("ratio", [1.0, 50.0, -3.0])
def test_a_pendulum_by_hand(ratio):
    """ratio u = m l^2 theta'' + m g l sin(theta)."""
    pendulum = cp.model.pendulum(length=0.5, mass=2.0)
    motor = Actuation(pendulum, ratios=[ratio])
    inverse = cp.inverse_dynamics(cp.Scene(pendulum), [0.7], [1.3], [4.0], actuation=motor)
    torque = 2.0 * 0.25 * 4.0 + 2.0 * GRAVITY * 0.5 * np.sin(0.7)
    assert inverse.u[0] == pytest.approx(torque / ratio, rel=1e-12)
    assert inverse.tau[0] == pytest.approx(torque, rel=1e-12)
    assert inverse.torques == {"pivot": inverse.u[0]}
    assert inverse.fully_actuated


def two_link(l1: float, l2: float, m1: float, m2: float) -> cp.Robot:
    """Two massless rods with masses at their ends, in a vertical plane, hanging at zero."""
    model, parent = pin.Model(), 0
    for i, (length, mass) in enumerate(((l1, m1), (l2, m2))):
        at = np.array([0.0, 0.0, -l1 if parent else 0.0])
        parent = model.addJoint(parent, pin.JointModelRY(), pin.SE3(np.eye(3), at), f"joint{i + 1}")
        end = pin.SE3(np.eye(3), np.array([0.0, 0.0, -length]))
        model.appendBodyToJoint(parent, pin.Inertia(mass, np.zeros(3), np.zeros((3, 3))), end)
    return cp.Robot("two_link", model, actuated=("joint1", "joint2"))


def test_a_two_link_arm_by_hand():
    l1, l2, m1, m2 = 0.4, 0.3, 1.2, 0.7
    arm = two_link(l1, l2, m1, m2)
    (q1, q2), (v1, v2), (a1, a2) = (0.5, -1.1), (0.8, 1.7), (2.0, -3.0)
    c, s = np.cos(q2), np.sin(q2)
    torque2 = m2 * l2**2 * (a1 + a2) + m2 * l1 * l2 * (c * a1 + s * v1**2)
    torque2 += m2 * GRAVITY * l2 * np.sin(q1 + q2)
    torque1 = torque2 + (m1 + m2) * l1**2 * a1 + (m1 + m2) * GRAVITY * l1 * np.sin(q1)
    torque1 += m2 * l1 * l2 * (c * (a1 + a2) - s * (v1 + v2) ** 2)
    inverse = cp.inverse_dynamics(cp.Scene(arm), [q1, q2], [v1, v2], [a1, a2])
    assert np.allclose(inverse.u, [torque1, torque2], rtol=1e-12)
    held = gravity_compensation(cp.Scene(arm), [q1, q2])
    second = m2 * GRAVITY * l2 * np.sin(q1 + q2)
    first = second + (m1 + m2) * GRAVITY * l1 * np.sin(q1)
    assert np.allclose(held.u, [first, second], rtol=1e-12)


def box() -> cp.Robot:
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "float")
    model.appendBodyToJoint(
        joint, pin.Inertia(2.0, np.zeros(3), 0.1 * np.eye(3)), pin.SE3.Identity()
    )
    model.addJointFrame(joint)
    return cp.Robot("box", model).with_frame("hook", "float", [0.0, 0.0, 0.4])


@pytest.mark.long
def test_a_hanging_box_needs_no_motor_torque():
    """Motors could carry it: of all ways to share the weight, the smallest torques are none."""
    held = box()
    hanging = cp.Scene(held, [cp.SurfaceContact("hook")])
    motors = Actuation(held, ["float"])
    assert motors.motors == tuple(f"float.{i}" for i in range(6))
    inverse = gravity_compensation(hanging, pin.neutral(held.model), actuation=motors)
    assert np.abs(inverse.u).max() < 1e-12
    assert np.allclose(inverse.lam, [0, 0, 2.0 * GRAVITY, 0, 0, 0], atol=1e-12)
    assert (inverse.rank, inverse.mobility) == (0, 0)
    assert inverse.fully_actuated
    assert inverse.null_space.shape == (12, 6)


def test_the_crank_holds_the_four_bar_with_the_slope_of_its_potential_energy():
    """u = dU / d theta along the closed mechanism."""
    four_bar = scene("four_bar")
    model = four_bar.robot.model
    data = model.createData()
    q, _ = four_bar.sample(np.random.default_rng(3))

    def energy(step: float) -> float:
        moved = four_bar.assemble(q + step * np.eye(3)[0], fixed=["crank"]).q
        return float(pin.computePotentialEnergy(model, data, moved))

    h = 1e-3
    slope = (8 * (energy(h) - energy(-h)) - (energy(2 * h) - energy(-2 * h))) / (12 * h)
    inverse = gravity_compensation(four_bar, q)
    assert inverse.u[0] == pytest.approx(slope, rel=1e-8)
    assert inverse.fully_actuated
    assert inverse.null_space.shape == (4, 1)  # the redundant row across the plane
    assert inverse.notices == ()


@pytest.mark.long
def test_talos_stands_by_itself():
    """Feet carry m g, motors and ground leave nothing to be done, and nothing moves."""
    stance = scene("talos", contacts=True)
    q, v = stance.state()
    held = gravity_compensation(stance, q)
    assert held.fully_actuated
    assert (held.rank, held.mobility) == (26, 26)
    assert np.abs(held.residual).max() < 1e-10
    total = sum(force.in_world()[:3] for force in held.forces.values())
    assert np.allclose(total, [0.0, 0.0, stance.robot.mass * GRAVITY], rtol=1e-10, atol=1e-9)
    assert np.abs(cp.solve(stance, q, v, held.tau).a).max() < 1e-10
    assert held.notices == ()
    assert held.null_space.shape == (44, 6)


MECHANISMS = sorted(
    {"cassie", "delta", "five_bar", "four_bar", "parallelogram", "stewart"}
    & set(cp.io.available_robots())
)


@pytest.mark.values
@pytest.mark.parametrize("contacts", [False, True])
@pytest.mark.parametrize("name", [*MECHANISMS, "solo12", "talos"])
def test_forward_of_inverse_is_the_acceleration(name, contacts):
    """To 1e-10, for accelerations that the motors can make, springs acting by themselves."""
    where = scene(name, contacts=contacts)
    motors = Actuation(where.robot)
    rng = np.random.default_rng(1)
    for _ in range(10):
        q, v = where.sample(rng)
        passive = where.robot.passive_torque(q, v)
        u = 0.1 * GRAVITY * where.robot.mass * rng.normal(size=len(motors.columns))
        tau = motors.B @ u + passive
        a = cp.solve(where, q, v, tau, solver=cp.dynamics.Reference()).a
        inverse = cp.inverse_dynamics(where, q, v, a, passive=passive)
        again = cp.solve(where, q, v, inverse.tau + passive)
        assert relative(again.a, a) < 1e-10
        assert relative(inverse.a, a) < 1e-10
        assert relative(inverse.lam, again.lam, floor=where.nominal.weight) < 1e-8
        assert np.linalg.norm(inverse.u) <= np.linalg.norm(u) * (1 + 1e-9)
        assert not [n for n in inverse.notices if "motors drive" in n and "missing" in n]


@each_row("name", ["cassie", "solo12", "four_bar"])
def test_what_cannot_be_done_comes_nearest(name):
    """The answer says what comes out, and no other torques come nearer in the metric of M."""
    where = scene(name)
    rng = np.random.default_rng(2)
    q, v = where.sample(rng)
    asked = 5.0 * rng.normal(size=where.robot.nv)
    inverse = cp.inverse_dynamics(where, q, v, asked)
    out = cp.solve(where, q, v, inverse.tau, solver=cp.dynamics.Reference())
    assert relative(inverse.a, out.a) < 1e-11
    terms = cp.Workspace(where).terms(q, v)
    assert inverse.projected == pytest.approx(
        np.abs(terms.J @ asked + terms.gamma).max(initial=0.0), abs=1e-12
    )
    off = inverse.a - asked
    distance = off @ terms.M @ off
    for _ in range(20):
        u = inverse.u + rng.normal(size=inverse.u.size)
        a = cp.solve(where, q, v, inverse.actuation.B @ u, solver=cp.dynamics.Reference()).a
        assert (a - asked) @ terms.M @ (a - asked) > distance
    assert any("the nearest that keeps them" in n for n in inverse.notices) == bool(where.rows)
    missing = any("of 22 degrees of freedom" in n or "of 18" in n for n in inverse.notices)
    assert missing == (name != "four_bar") == (not inverse.fully_actuated)
    needed = terms.M @ inverse.a + terms.h - inverse.tau - terms.J.T @ inverse.lam
    assert np.abs(needed).max() < 1e-9 * max(np.abs(terms.h).max(), 1.0)


@each_row("name", ["cassie", "talos", "solo12"])
def test_internal_forces_do_nothing(name):
    where = scene(name, contacts=True)
    rng = np.random.default_rng(4)
    q, v = where.sample(rng)
    inverse = cp.inverse_dynamics(where, q, v, np.zeros(where.robot.nv))
    B, J = inverse.actuation.B, cp.Workspace(where).jacobian(q)
    both, N = np.hstack([B, J.T]), inverse.null_space
    assert N.shape[1] == both.shape[1] - np.linalg.matrix_rank(both, tol=1e-7)
    assert np.linalg.matrix_rank(N) == N.shape[1]
    assert np.abs(both @ N).max() < 1e-9 * np.abs(N).max()
    squeezed = inverse.u + (N @ rng.normal(size=N.shape[1]))[: inverse.u.size]
    for u in (inverse.u, squeezed):
        a = cp.solve(where, q, v, B @ u, solver=cp.dynamics.Reference()).a
        assert relative(a, inverse.a) < 1e-9
    # the smallest torques have no part in it
    size = np.linalg.norm(inverse.u)
    assert np.abs(N[: inverse.u.size].T @ inverse.u).max() < 1e-9 * size * np.abs(N).max()


@pytest.mark.long
def test_cassie_with_locked_springs_stands_on_her_knees_motors():
    """But for the spin of two thin rods, which nothing can hold."""
    cassie = cp.load_robot("cassie", variant={"springs": "locked"})
    feet = [cp.constraints.LineContact(f"{side}-foot") for side in ("left", "right")]
    stance = cp.Scene(cassie, [*cassie.loops, *feet])
    held = gravity_compensation(stance, stance.state()[0])
    assert (held.rank, held.mobility) == (6, 8)
    assert np.abs(held.residual).max() < 0.05
    assert held.torques["left-knee-op"] == pytest.approx(39.2, abs=0.2)
    assert held.torques["right-knee-op"] == pytest.approx(39.1, abs=0.2)
    vertical = sum(held.forces[foot.name].in_world()[2] for foot in feet)
    assert vertical == pytest.approx(cassie.mass * GRAVITY, abs=0.1)


def test_springs_that_hold_nothing_up_show_in_the_notices():
    """Cassie's springs are slack at this posture: what her motors can still do takes 45 kN m."""
    stance = scene("cassie", contacts=True)
    held = gravity_compensation(stance, stance.state("standing")[0])
    assert not held.fully_actuated
    assert held.weakest < 1e-4
    text = str(held)
    for said in ("are missing", "nearly singular", "the contact pulls", "left-knee-op"):
        assert said in text


def test_gears_change_motor_torques_and_which_are_smallest():
    stance = scene("talos", contacts=True)
    q, _ = stance.state()
    plain = gravity_compensation(stance, q)
    geared = Actuation(stance.robot, ratios=dict.fromkeys(stance.robot.actuated, 100.0))
    assert np.allclose(gravity_compensation(stance, q, actuation=geared).u, plain.u / 100.0)
    strong = Actuation(stance.robot, ratios={"leg_left_4_joint": 100.0})
    other = gravity_compensation(stance, q, actuation=strong)
    assert np.abs(cp.solve(stance, q, np.zeros(38), other.tau).a).max() < 1e-10
    assert np.linalg.norm(other.u) < np.linalg.norm(plain.u)


DIFFERENTIAL = (
    CoupledMotor("left", {"joint1": 1.0, "joint2": 1.0}),
    CoupledMotor("right", {"joint1": 1.0, "joint2": -1.0}),
)


def test_a_differential_by_hand():
    """tau_1 = u_left + u_right, tau_2 = u_left - u_right, and their speeds are v_1 +- v_2."""
    arm = two_link(0.4, 0.3, 1.2, 0.7)
    q, v, a = [0.5, -1.1], [0.8, 1.7], [2.0, -3.0]
    tau = cp.inverse_dynamics(cp.Scene(arm), q, v, a).tau
    turned = arm.with_motors(*DIFFERENTIAL)
    inverse = cp.inverse_dynamics(cp.Scene(turned), q, v, a)
    assert np.allclose(inverse.u, [tau.sum() / 2, (tau[0] - tau[1]) / 2], rtol=1e-12)
    assert np.allclose(inverse.tau, tau, rtol=1e-12)
    assert list(inverse.torques) == ["left", "right"]
    assert inverse.fully_actuated
    assert np.allclose(Actuation(turned).B.T @ v, [2.5, -0.9], rtol=1e-15)


def test_a_torque_that_a_motor_cannot_give_is_a_notice():
    """Of two cables against each other, the smallest torques push with one."""
    arm = two_link(0.4, 0.3, 1.2, 0.7)
    cables = [CoupledMotor("flexor", {"joint2": 0.02}, (0.0, 900.0)),
              CoupledMotor("extensor", {"joint2": -0.03}, (0.0, 900.0))]  # fmt: skip
    pulled = arm.with_motors("joint1", *cables)
    q, v, up = [0.5, -1.1], [0.0, 0.0], [0.0, 30.0]
    answer = cp.inverse_dynamics(cp.Scene(pulled), q, v, up)
    assert answer.u[2] < 0 < answer.u[1]
    (said,) = answer.notices
    assert f"extensor: {answer.u[2]:.4g} N or N m, where it gives 0 to 900" in said
    assert "Controller" in said
    model = pin.Model(arm.model)
    model.effortLimit = np.array([0.5, 0.0])
    weak = cp.Scene(dataclasses.replace(arm, model=model))
    (said,) = gravity_compensation(weak, q).notices
    assert said.startswith("joint1: ")
    assert "where it gives -0.5 to 0.5" in said
    assert gravity_compensation(cp.Scene(arm), q).notices == ()


@pytest.mark.values
@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("count", [1, 2, 5])
def test_any_map_from_motors_to_joints(seed, count):
    """u = B^+ tau where B reaches tau; else the nearest acceleration in the metric of M."""
    rng = np.random.default_rng(seed)
    arm = cp.model.chain(3)
    B = np.round(rng.normal(size=(3, count)), 2) + 3.0
    motors = [CoupledMotor(f"m{k}", dict(zip(arm.joints, B[:, k], strict=True)))
              for k in range(count)]  # fmt: skip
    motors = Actuation(arm, motors)
    assert np.array_equal(motors.B, B)
    where = cp.Scene(arm)
    q, v, a = rng.normal(size=(3, 3))
    inverse = cp.inverse_dynamics(where, q, v, a, actuation=motors)
    M, h = (getattr(cp.Workspace(where).terms(q, v), key) for key in ("M", "h"))
    L = np.linalg.cholesky(M)
    u = np.linalg.pinv(np.linalg.solve(L, B)) @ np.linalg.solve(L, M @ a + h)
    assert np.allclose(inverse.u, u, rtol=1e-9, atol=1e-9)
    assert np.allclose(M @ inverse.a + h, B @ u, rtol=1e-9, atol=1e-9)
    assert inverse.rank == min(count, 3)
    assert inverse.null_space.shape == (count, max(count - 3, 0))


@pytest.mark.long
def test_a_motor_of_one_joint_is_one_with_a_ratio():
    arm = two_link(0.4, 0.3, 1.2, 0.7)
    geared = Actuation(arm, ["joint1", CoupledMotor("elbow", {"joint2": 7.0})], ratios=[3.0])
    plain = Actuation(arm, ratios=[3.0, 7.0])
    assert np.array_equal(geared.B, plain.B)
    assert geared.motors == ("joint1", "elbow")


@pytest.mark.long
def test_actuation_of_coupled_motors_is_a_value():
    arm = two_link(0.4, 0.3, 1.2, 0.7)
    motors = Actuation(arm, DIFFERENTIAL)
    turned = arm.with_motors(*DIFFERENTIAL)
    assert Actuation(turned) == Actuation(turned, list(DIFFERENTIAL))
    assert motors == Actuation(arm, [*DIFFERENTIAL, DIFFERENTIAL[0]])
    copy = pickle.loads(pickle.dumps(motors))
    assert copy == motors
    assert hash(copy) == hash(motors)
    assert np.array_equal(copy.B, motors.B)


@each_row(("made", "error", "said"), [
        (lambda: CoupledMotor("", {"joint1": 1.0}), cp.InvalidArgument, "name of a motor"),
        (lambda: CoupledMotor("m", {}), cp.InvalidArgument, "one joint at least"),
        (lambda: CoupledMotor("m", ["joint1"]), cp.InvalidArgument, "a weight by joint"),
        (lambda: CoupledMotor("m", {"joint1": 0.0}), cp.InvalidArgument, "of 'joint1' is 0"),
        (lambda: CoupledMotor("m", {"joint1": 1e-200}), cp.InvalidArgument, "is 1e-200; leave it"),
        (lambda: CoupledMotor("m", [("j", 1), ("j", 2)]), cp.InvalidArgument, "is named twice"),
        (lambda: CoupledMotor("m", {"joint1": np.nan}), cp.InvalidArgument, "finite numbers"),
        (lambda: CoupledMotor("m", {"joint1": 1.0}, (3.0, 1.0)), cp.InvalidArgument, "below the"),
        (lambda: CoupledMotor("m", {"joint1": 1.0}, 3.0), cp.InvalidArgument, "the least and"),
        (lambda: CoupledMotor("m", {"joint1": 1.0}, "12"), cp.InvalidArgument, "the least and"),
        (lambda: CoupledMotor("m", {"joint1": 1.0}, (np.nan, 1.0)), cp.InvalidArgument, "below"),
        (lambda: CoupledMotor("m", {"joint3": 1.0}), cp.errors.UnknownName, "named 'joint3'"),
        (lambda: CoupledMotor("joint1", {"joint2": 1.0}), cp.InvalidArgument, "a joint has this"),
        (lambda: CoupledMotor("left", {"joint2": 1.0}), cp.InvalidArgument, "two are named 'left'"),
    ])  # fmt: skip
def test_coupled_motors_refuse(made, error, said):
    arm = two_link(0.4, 0.3, 1.2, 0.7)
    with pytest.raises(error, match=said):
        Actuation(arm, [DIFFERENTIAL[0], made()])
    with pytest.raises(error, match=said):
        arm.with_motors(DIFFERENTIAL[0], made())


def test_no_two_motors_have_one_name():
    solo = robot("solo12")
    base = Actuation(solo, ["root_joint"]).motors[0]
    knee = CoupledMotor(base, {solo.joints[1]: 1.0})
    with pytest.raises(cp.InvalidArgument, match=f"two are named '{base}'"):
        Actuation(solo, ["root_joint", knee])


def test_a_motor_on_several_joints_needs_joints_of_one_freedom():
    with pytest.raises(cp.InvalidArgument, match="'root_joint' has 6 degrees of freedom"):
        robot("solo12").with_motors(CoupledMotor("m", {"root_joint": 1.0}))


@pytest.mark.long
def test_actuation_is_a_value():
    solo = robot("solo12")
    motors = Actuation(solo, ["FL_KFE", "HR_HAA"], {"HR_HAA": 9.0})
    assert motors == Actuation(solo, ("FL_KFE", "HR_HAA"), (1.0, 9.0))
    assert motors == dataclasses.replace(motors)
    assert motors != Actuation(solo, ["FL_KFE", "HR_HAA"])
    copy = pickle.loads(pickle.dumps(motors))
    assert copy == motors
    assert hash(copy) == hash(motors)
    assert np.array_equal(copy.B, motors.B)
    rows = [solo.index_v(name) for name in ("FL_KFE", "HR_HAA")]
    assert motors.B.shape == (18, 2)
    assert np.count_nonzero(motors.B) == 2
    assert motors.B[rows[0], 0] == 1.0
    assert motors.B[rows[1], 1] == 9.0
    with pytest.raises(ValueError, match="read-only"):
        motors.B[0, 0] = 1.0
    with pytest.raises(dataclasses.FrozenInstanceError):
        motors.joints = ()


@pytest.mark.long
def test_answers_pickle():
    where = scene("four_bar")
    held = gravity_compensation(where, where.state()[0])
    copy = pickle.loads(pickle.dumps(held))
    assert np.array_equal(copy.u, held.u)
    assert copy.actuation == held.actuation
    assert copy.fully_actuated


@each_row(
    ("joints", "ratios", "error", "said"),
    [
        (["FL_KEF"], None, cp.errors.UnknownName, "did you mean 'FL_KFE'"),
        ([], None, cp.InvalidArgument, "names no joint with a motor"),
        ("FL_KFE", None, cp.InvalidArgument, "a list of names is needed"),
        ([3], None, cp.InvalidArgument, "3 is not the name of a joint"),
        (["FL_KFE"], [0.0], cp.InvalidArgument, "that of 'FL_KFE' is 0"),
        (["FL_KFE"], [1.0, 2.0], cp.InvalidArgument, "ratios has shape"),
        (["FL_KFE"], [np.nan], cp.InvalidArgument, "finite numbers are needed"),
        (["FL_KFE"], {"FL_HFE": 2.0}, cp.errors.UnknownName, "joint with a motor named 'FL_HFE'"),
        (["FL_KFE"], 3.0, cp.InvalidArgument, "ratios = 3.0"),
        (["FL_KFE"], {"FL_KFE": "much"}, cp.InvalidArgument, "ratios"),
    ],
)
def test_actuation_refuses(joints, ratios, error, said):
    with pytest.raises(error, match=said):
        Actuation(robot("solo12"), joints, ratios)


def test_bad_input_is_refused():
    where = scene("four_bar")
    q, v = where.state()
    motors = Actuation(robot("solo12"))
    for call, said in (
        (lambda: cp.inverse_dynamics(where, q, v, [1.0]), "a has shape"),
        (lambda: cp.inverse_dynamics(where, q, v, [1.0, np.nan, 0.0]), r"a\[1\] = nan"),
        (lambda: cp.inverse_dynamics(where, q[1:], v, v), "q has shape"),
        (lambda: cp.inverse_dynamics(where, q, v, v, passive=[1.0]), "passive has shape"),
        (lambda: cp.inverse_dynamics(where, q, v, v, actuation=motors), "made for the model of"),
        (lambda: cp.inverse_dynamics(where, q, v, v, actuation=["crank"]), "actuation = "),
        (lambda: gravity_compensation("four_bar", q), "scene = str: a Scene is needed"),
        (lambda: gravity_compensation(cp.Scene(box()), q), "names no joint with a motor"),
        (lambda: Actuation("solo12"), "robot = str"),
    ):
        with pytest.raises(cp.InvalidArgument, match=said):
            call()
