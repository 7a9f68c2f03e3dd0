"""Wheels and balls on tables, belts and ramps that move: closed forms, identities, differences."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from shared import relative

import condyn_pin as cp
from condyn_pin.constraints import Driven, HeldJoint, Polynomial, RollingBall, RollingWheel

G, RADIUS = 9.81, 0.1


def on_a_table(kind: object, ball: bool = True, table: float = 3.0) -> cp.Robot:
    """A ball, or a thin disc about y, of 0.5 kg, and a table of 3 kg on a joint."""
    model = pin.Model()
    j = model.addJoint(0, kind, pin.SE3.Identity(), "table")
    model.appendBodyToJoint(j, pin.Inertia.FromBox(table, 1.0, 1.0, 0.1), pin.SE3.Identity())
    j = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "body")
    moments = 0.5 * RADIUS**2 * (np.full(3, 0.4) if ball else np.array([0.25, 0.5, 0.25]))
    model.appendBodyToJoint(j, pin.Inertia(0.5, np.zeros(3), np.diag(moments)), pin.SE3.Identity())
    return cp.Robot("on a table", model)


def test_a_ball_on_a_turntable_runs_a_circle():
    """v' = 2/7 W z x v, wherever the table turns about: Earnshaw's paradox."""
    W = 3.0
    robot = on_a_table(pin.JointModelRZ())
    table = Driven(HeldJoint("table"), Polynomial((0.0, W)))
    scene = cp.Scene(robot, [RollingBall("body", RADIUS, height=0.0, on="table"), table])
    at, v0 = np.array([0.3, -0.2]), np.array([0.4, 0.1])
    q = np.array([0.0, *at, RADIUS, 0, 0, 0, 1.0])
    # of the lowest point: v - r w x z = W z x at
    slip = v0 - W * np.array([-at[1], at[0]])
    v = np.array([W, *v0, 0.0, -slip[1] / RADIUS, slip[0] / RADIUS, 0.0])
    run = cp.simulate(scene, q, v, duration=0.5, dt=5e-3)
    assert run.status.ok
    turn = 2 / 7 * W
    middle = at + np.array([-v0[1], v0[0]]) / turn
    c, s = np.cos(turn * run.t), np.sin(turn * run.t)
    start = at - middle
    circle = middle + np.array([c * start[0] - s * start[1], s * start[0] + c * start[1]]).T
    assert np.abs(run.q[:, 1:3] - circle).max() < 1e-7
    assert run.forces["body"][:, 2] == pytest.approx(0.5 * G, rel=1e-8)


@pytest.mark.parametrize("ball", [True, False])
def test_a_plate_is_pushed_below_what_rolls_on_it(ball):
    """a = F / (M + k m), that of what rolls k a, with k = I / (I + m r^2); momentum is kept."""
    robot = on_a_table(pin.JointModelPX(), ball)
    k = 2 / 7 if ball else 1 / 3
    body = (
        RollingBall("body", RADIUS, height=0.0, on="table")
        if ball
        else RollingWheel("body", RADIUS, height=0.0, on="table")
    )
    scene = cp.Scene(robot, [body])
    q = np.array([0.2, 0.3, 0.1, RADIUS, 0, 0, 0, 1.0])
    push = 2.0
    found = cp.solve(scene, q, np.zeros(7), np.array([push, *np.zeros(6)]))
    a = push / (3.0 + k * 0.5)
    assert found.status.ok
    assert found.a[:2] == pytest.approx([a, k * a], rel=1e-10)
    assert found.forces["body"].components == pytest.approx([0.5 * k * a, 0, 0.5 * G], abs=1e-9)
    v = cp.mechanism.project_velocity(scene, q, np.array([0.5, 1.0, 0.0, 0, 0, 0, 0.3]))
    run = cp.simulate(scene, q, v, duration=0.2, dt=5e-3)
    momentum = 3.0 * run.v[:, 0] + 0.5 * np.array(
        [(pin.Quaternion(row[4:]).matrix() @ w[1:4])[0]
         for row, w in zip(run.q, run.v, strict=True)]
    )  # fmt: skip
    assert np.ptp(momentum) < 1e-8
    assert np.abs(run.energy.error).max() < 1e-8


SLOPE = 0.3


@pytest.mark.parametrize("how", ["normal", "frame"])
@pytest.mark.parametrize("ball", [True, False])
def test_what_rolls_down_a_slope(how, ball):
    """a = g sin(slope) / (1 + I / m r^2)."""
    robot = on_a_table(pin.JointModelPX(), ball)
    n = np.array([np.sin(SLOPE), 0.0, np.cos(SLOPE)])
    tilted = pin.SE3(pin.exp3(np.array([0.0, SLOPE, 0.0])), np.array([0.0, 0.0, 0.4]))
    on = {"normal": n, "height": 0.4 * n[2]} if how == "normal" else {
        "height": 0.0, "on": ("world", tilted)
    }  # fmt: skip
    kind = RollingBall if ball else RollingWheel
    q = np.array([0.0, *(RADIUS * n + [0, 0, 0.4]), 0, 0, 0, 1.0])
    scene = cp.Scene(robot, [kind("body", RADIUS, **on)])
    assert scene.check(q).violation["body"].length < 1e-12
    found = cp.solve(scene, q, np.zeros(7), np.zeros(7))
    a = G * np.sin(SLOPE) / (1.4 if ball else 1.5)
    down = np.array([np.cos(SLOPE), 0.0, -np.sin(SLOPE)])
    assert found.a[1:4] == pytest.approx(a * down, abs=1e-10)


KINDS = {
    "ball": RollingBall("body", RADIUS, (0.1, -0.2, 1.0), 0.05, on="table"),
    "wheel": RollingWheel("body", RADIUS, "y", normal=(0.1, -0.2, 1.0), height=0.05, on="table"),
    "omni": RollingWheel("body", RADIUS, "x", ("rolling", "normal"), on="table"),
}


@pytest.fixture(scope="module")
def free() -> cp.Robot:
    """The table flies freely too."""
    return on_a_table(pin.JointModelFreeFlyer())


def state(robot: cp.Robot, seed: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    q = pin.integrate(robot.model, pin.neutral(robot.model), 0.4 * rng.normal(size=robot.nv))
    return q, rng.normal(size=robot.nv)


@pytest.mark.parametrize("kind", KINDS)
def test_rows_over_a_body_that_stands_still_are_those_over_the_world(kind, free):
    """With the table where it is, its velocity and its columns are all that is new."""
    q, v = state(free, 1)
    v[:6] = 0.0
    table = pin.XYZQUATToSE3(q[:7])
    moving = KINDS[kind]
    fixed = type(moving)(**{**vars(moving), "on": ("world", table)})
    one, two = (cp.Workspace(cp.Scene(free, [each])).terms(q, v) for each in (moving, fixed))
    assert relative(one.J[:, 6:], two.J[:, 6:]) < 1e-12
    assert relative(one.gamma, two.gamma) < 1e-12
    # as one body they do not move past each other
    together = np.concatenate((np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6]), np.zeros(6)))
    body = pin.XYZQUATToSE3(q[7:])
    together[6:] = body.actInv(table.act(pin.Motion(together[:6]))).vector
    assert np.abs(one.J @ together).max() < 1e-12


@pytest.mark.parametrize("drift", [None, cp.Baumgarte(3.0, 5.0)])
@pytest.mark.parametrize("kind", KINDS)
def test_derivatives_are_those_of_differences(kind, free, drift):
    q, v = state(free, 2)
    scene = cp.Scene(free, [KINDS[kind]])
    rng = np.random.default_rng(3)
    cp.derivatives(scene, q, v, rng.normal(size=free.nv), drift=drift, check=True)


@pytest.mark.parametrize("kind", ["ball", "wheel"])
def test_gamma_is_the_rate_of_the_rows_and_j_that_of_the_gap(kind, free):
    q, v = state(free, 4)
    scene = cp.Scene(free, [KINDS[kind]])
    ws, h = cp.Workspace(scene), 1e-5
    there = [pin.integrate(free.model, q, s * h * v) for s in (1.0, -1.0)]
    rows = [ws.terms(each, v).J @ v for each in there]
    assert relative(ws.terms(q, v).gamma, (rows[0] - rows[1]) / (2 * h)) < 1e-7
    equations = cp.dynamics.workspace.Workspace(scene).equations
    gaps = [equations.violation(each) for each in there]
    assert (gaps[0] - gaps[1])[2] / (2 * h) == pytest.approx((ws.terms(q, v).J @ v)[2], rel=1e-7)


def test_what_is_on_a_body_belongs_where_it_is():
    """Without a height a run takes that at the start, in the axes of the table."""
    robot = on_a_table(pin.JointModelPZ())
    table = Driven(HeldJoint("table"), Polynomial((0.2, 0.5)))
    scene = cp.Scene(robot, [RollingBall("body", RADIUS, on="table"), table])
    q = np.array([0.2, 0.0, 0.0, 0.2 + 0.03 + RADIUS, 0, 0, 0, 1.0])
    run = cp.simulate(scene, q, np.array([0.5, 0, 0, 0.5, 0, 0, 0]), duration=0.5)
    assert run.scene.constraints[0].height == pytest.approx(0.03)
    assert run.q[-1, 3] == pytest.approx(q[3] + 0.25, abs=1e-9)


def test_files_names_and_refusals(free, tmp_path):
    scene = cp.Scene(free, [RollingWheel("body", RADIUS, height=0.05, on="table")])
    q = scene.assemble(state(free, 5)[0]).q
    v = cp.mechanism.project_velocity(scene, q, np.ones(free.nv))
    run = cp.simulate(scene, q, v, duration=0.02)
    run.save(tmp_path / "run.npz")
    assert cp.Trajectory.load(tmp_path / "run.npz").scene.constraints == scene.constraints
    assert scene.constraints[0].renamed(lambda name: f"my {name}").on == "my table"
    why = list(cp.dynamics.compiled.why_not(cp.Workspace(scene)))
    assert any("body" in each for each in why)
    with pytest.raises(cp.CondynError, match="body: both sides belong to joint"):
        cp.Scene(free, [RollingBall("body", RADIUS, on="body")])
    with pytest.raises(cp.CondynError, match="nothing in this scene presses on a floor"):
        cp.control.support_polygon(scene, q)
    with pytest.raises(cp.InvalidArgument, match="on = 3"):
        RollingBall("body", RADIUS, on=3)
