"""Every line of docs/formula-sheet.md, held against the library."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest
from scipy.linalg import sqrtm

import condyn_pin as cp
from condyn_pin.constraints import (
    Coupling,
    Driven,
    HeldJoint,
    KnifeEdge,
    RollingBall,
    Sine,
)
from condyn_pin.contact import ADMM
from condyn_pin.control import operational_space, transmission
from condyn_pin.mechanism import curvature
from condyn_pin.simulation.stability import stability_limit

SHEET = Path(__file__).parent.parent / "docs" / "formula-sheet.md"
GRAVITY = 9.81


def test_every_line_has_a_test_of_its_name():
    names = re.findall(r"^\| `(\w+)` \|", SHEET.read_text(encoding="utf-8"), re.MULTILINE)
    tested = {name.removeprefix("test_") for name in globals() if name.startswith("test_")}
    assert set(names) == tested - {"every_line_has_a_test_of_its_name"}
    assert len(set(names)) == len(names) > 30


@cache
def case():
    """Solo12 on four feet in motion, under torques: independent rows, a floating base."""
    solo = cp.load_robot("solo12")
    scene = cp.Scene(solo, solo.contacts)
    rng = np.random.default_rng(0)
    q, v = scene.sample(rng)
    tau = rng.normal(size=solo.nv)
    t = cp.Workspace(scene).terms(q, v)
    found = cp.solve(scene, q, v, tau)
    M_inv = np.linalg.inv(t.M)
    return SimpleNamespace(
        scene=scene, q=q, v=v, tau=tau, M=t.M, h=t.h, J=t.J, gamma=t.gamma, a=found.a,
        lam=found.lam, M_inv=M_inv, G=t.J @ M_inv @ t.J.T, free=M_inv @ (tau - t.h),
        m=scene.rows, n=solo.nv,
    )  # fmt: skip


def close(x, y, size=1.0):
    assert np.abs(np.subtract(x, y)).max() < 1e-8 * max(size, np.abs(y).max())


# --- dynamics ------------------------------------------------------------------------------------


def test_motion():
    c = case()
    data = c.scene.robot.model.createData()
    inverse = pin.rnea(c.scene.robot.model, data, c.q, c.v, c.a)
    close(inverse, c.tau + c.J.T @ c.lam)


def test_constraint():
    c, h = case(), 1e-6
    close(c.J @ c.a, -c.gamma)
    model = c.scene.robot.model
    equations = cp.Workspace(c.scene)
    ends = [equations.jacobian(pin.integrate(model, c.q, k * h * c.v)) @ c.v for k in (-1, 1)]
    assert np.abs((ends[1] - ends[0]) / (2 * h) - c.gamma).max() < 1e-6


def test_kkt():
    c = case()
    K = np.block([[c.M, -c.J.T], [c.J, np.zeros((c.m, c.m))]])
    close(np.linalg.solve(K, np.concatenate([c.tau - c.h, -c.gamma])), np.append(c.a, c.lam))


def test_delassus():
    c = case()
    close(c.G @ c.lam, -c.gamma - c.J @ c.free)


def test_gauss():
    c = case()
    close(c.free + c.M_inv @ c.J.T @ np.linalg.solve(c.G, -c.gamma - c.J @ c.free), c.a)


def test_null_space():
    c = case()
    N = np.linalg.svd(c.J)[2][c.m :].T
    a0 = np.linalg.lstsq(c.J, -c.gamma, rcond=None)[0]
    z = np.linalg.solve(N.T @ c.M @ N, N.T @ (c.tau - c.h - c.M @ a0))
    close(a0 + N @ z, c.a)


def test_udwadia_kalaba():
    c = case()
    root = np.linalg.inv(np.real(sqrtm(c.M)))
    close(c.free + root @ np.linalg.pinv(c.J @ root) @ (-c.gamma - c.J @ c.free), c.a)


def test_proximal():
    c, mu, lam = case(), 1e-3, np.zeros(12)
    K = np.block([[c.M, -c.J.T], [c.J, mu * np.eye(c.m)]])
    for _ in range(2):
        x = np.linalg.solve(K, np.concatenate([c.tau - c.h, -c.gamma + mu * lam]))
        lam = x[c.n :]
    two = cp.Proximal(mu=mu, max_iterations=2)
    found = cp.solve(c.scene, c.q, c.v, c.tau, solver=two, throw=False)
    assert np.abs(found.a - c.a).max() <= 2 * np.abs(x[: c.n] - c.a).max()
    for _ in range(30):
        x = np.linalg.solve(K, np.concatenate([c.tau - c.h, -c.gamma + mu * lam]))
        lam = x[c.n :]
    close(x[: c.n], c.a)


def test_mobility():
    bar = cp.model.four_bar()
    rank = cp.Scene(bar, bar.loops).rank()
    assert rank.mobility == bar.nv - rank.rank == 1
    assert rank.gruebler == bar.nv - rank.rows == 0


def test_virtual_work():
    c = case()
    w = cp.mechanism.project_velocity(c.scene, c.q, np.random.default_rng(3).normal(size=c.n))
    assert abs(w @ c.J.T @ c.lam) < 1e-10 * np.abs(c.lam).max()


# --- energy --------------------------------------------------------------------------------------


def test_kinetic():
    c = case()
    model = c.scene.robot.model
    close(0.5 * c.v @ c.M @ c.v, pin.computeKineticEnergy(model, model.createData(), c.q, c.v))


def rate_of_energy(scene, q, v, a):
    """T' + U' by differences along the motion."""
    model, h, ends = scene.robot.model, 1e-5, []
    data = model.createData()
    for k in (-1, 1):
        at, speed = pin.integrate(model, q, k * h * v + h**2 / 2 * a), v + k * h * a
        ends.append(pin.computeKineticEnergy(model, data, at, speed)
                    + pin.computePotentialEnergy(model, data, at))  # fmt: skip
    return (ends[1] - ends[0]) / (2 * h)


def test_power():
    c = case()
    assert rate_of_energy(c.scene, c.q, c.v, c.a) == pytest.approx(c.tau @ c.v, abs=1e-6)


@cache
def crank(t=0.2):
    bar, path = cp.model.four_bar(), Sine(0.4, 0.7)
    scene = cp.Scene(bar, [*bar.loops, Driven(HeldJoint("crank", 1.2), path)]).at(t)
    q, v = scene.state()
    return scene, q, v, cp.solve(scene, q, v, np.ones(3)), np.ravel(path(t))


def test_drive_power():
    scene, q, v, answer, s = crank()
    expected = v.sum() + answer.lam[-1] * s[1]
    assert rate_of_energy(scene, q, v, answer.a) == pytest.approx(expected, abs=1e-6)


def test_impact():
    c = case()
    before = c.v + 0.1
    hit = cp.impact(c.scene, c.q, before, restitution=0.3)
    close(c.M @ (hit.v - before), c.J.T @ hit.lam)
    close(c.J @ hit.v, -0.3 * c.J @ before)


def test_carnot():
    c = case()
    before = c.v + 0.1
    hit = cp.impact(c.scene, c.q, before)
    change = hit.v - before
    assert hit.energy_lost == pytest.approx(0.5 * change @ c.M @ change, rel=1e-9)


# --- drift ---------------------------------------------------------------------------------------


def test_baumgarte():
    c, gains = case(), cp.Baumgarte(3.0, 5.0)
    slipping = c.v + 0.1
    scene = cp.Scene(c.scene.robot, [cp.PointContact("FL_FOOT", anchor=(0.2, 0.1, 0.01))])
    workspace = cp.Workspace(scene, drift=gains)
    t = workspace.terms(c.q, slipping)
    close(t.a_ref, -2 * 3.0 * t.J @ slipping - 5.0**2 * workspace.violation(c.q))


def test_static_error():
    ball = cp.model.free_ball(mass=2.0, radius=0.05)
    hung = cp.Scene(ball, [cp.Loop("ball", "world", "planar", axis="x")])
    drift, solver = cp.Baumgarte.critical(20.0), cp.DenseKKT(mu=1e-3)
    run = cp.simulate(hung, *hung.state(), duration=2.0, drift=drift, solver=solver)
    assert run.violation[-1] == pytest.approx(1e-3 * 2.0 * GRAVITY / 20.0**2, abs=1e-8)


def test_settling():
    bar, alpha = cp.model.four_bar(), 20.0
    scene = cp.Scene(bar, [HeldJoint("crank")])
    run = cp.simulate(scene, [0.1, 0, 0], [0.0] * 3, duration=0.2, close_start=False,
                      drift=cp.Baumgarte.critical(alpha))  # fmt: skip
    assert run.q[:, 0] == pytest.approx(
        0.1 * (1 + alpha * run.t) * np.exp(-alpha * run.t), abs=1e-7
    )


def test_deadbeat():
    bar, dt = cp.model.four_bar(), 1e-3
    drift = cp.Baumgarte.deadbeat(dt)
    assert (drift.alpha, drift.beta) == (0.5 / dt, 1 / dt)
    scene = cp.Scene(bar, [HeldJoint("crank")])
    run = cp.simulate(scene, [1e-3, 0, 0], [0.0] * 3, duration=3 * dt, dt=dt, close_start=False,
                      drift=drift, integrator=cp.SemiImplicitEuler())  # fmt: skip
    assert np.abs(run.q[2:, 0]).max() < 1e-12


def test_stability_limit():
    assert stability_limit(cp.SemiImplicitEuler()) == pytest.approx(2 * (np.sqrt(2) - 1), rel=1e-4)


def test_solref():
    gains = cp.Baumgarte.from_solref(0.02, 0.8)
    assert (gains.alpha, gains.beta) == pytest.approx((1 / 0.02, 1 / (0.02 * 0.8)))


def test_projection():
    c = case()
    slipping = c.v + 0.1
    change = -c.M_inv @ c.J.T @ np.linalg.solve(c.G, c.J @ slipping)
    close(cp.mechanism.project_velocity(c.scene, c.q, slipping), slipping + change)


# --- kinds ---------------------------------------------------------------------------------------


def test_driven():
    _, q, v, answer, s = crank()
    assert (q[0] - 1.2, v[0], answer.a[0]) == pytest.approx(tuple(s), abs=1e-9)


def test_coupling():
    bar = cp.model.four_bar()
    gear = cp.Workspace(cp.Scene(bar, [Coupling("crank", "rocker", 2.0, 0.3)]))
    q = np.array([0.7, 0.1, -0.2])
    assert gear.violation(q) == pytest.approx(q[0] - 2.0 * q[2] - 0.3)


def test_rod():
    bar = cp.model.four_bar()
    scene = cp.Scene(bar, [cp.Loop("coupler_tip", "rocker_tip", "rod", length=0.5)])
    q = np.array([0.7, 0.1, -0.2])
    model = bar.model
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    ends = [data.oMf[model.getFrameId(f)].translation for f in ("coupler_tip", "rocker_tip")]
    distance = np.linalg.norm(ends[1] - ends[0])
    assert cp.Workspace(scene).violation(q) == pytest.approx(0.5 - distance)


def test_cable():
    """Over a pulley and wound on a drum, with its gap at a configuration."""
    model = pin.Model()
    for name, kind in (("load", pin.JointModelPZ()), ("winch", pin.JointModelRX())):
        j = model.addJoint(0, kind, pin.SE3.Identity(), name)
        model.appendBodyToJoint(j, pin.Inertia.FromSphere(1.0, 0.1), pin.SE3.Identity())
    over = ("load", "world + [0.3 0 2]", "world + [1 0 0]")
    rope = cp.constraints.Cable(over, 5.0, reels={"winch": 0.2}, name="rope")
    gap = cp.dynamics.contact_gaps(cp.Scene(cp.Robot("hoist", model), contacts=[rope]), [0.5, 0.7])
    spans = np.linalg.norm([0.3, 1.5]) + np.linalg.norm([0.7, 2.0])
    close(gap["rope"], 5.0 + 0.2 * 0.7 - spans)


def test_knife_edge():
    sleigh = cp.model.sleigh()
    scene = cp.Scene(sleigh, [KnifeEdge("blade", axis="y")])
    assert cp.Workspace(scene).jacobian(scene.state()[0]) == pytest.approx(np.array([[0, 1, 0.0]]))


def test_rolling():
    ball = cp.model.rolling_ball(radius=0.2)
    J = cp.Workspace(cp.Scene(ball, [RollingBall("centre", 0.2, height=0.0)])).jacobian(
        cp.Scene(ball, ball.contacts).state()[0]
    )
    v, omega, n = np.array([1.0, 2.0, 3.0]), np.array([4.0, 5.0, 6.0]), np.array([0, 0, 1.0])
    assert J @ [*v, *omega] == pytest.approx(v - 0.2 * np.cross(omega, n))


@pytest.mark.parametrize(
    ("name", "integrable"), [("sleigh", False), ("unicycle", False), ("solo12", True)]
)
def test_curvature(name, integrable):
    made = cp.load_robot(name)
    scene, rng = cp.Scene(made, made.contacts), np.random.default_rng(0)
    q, v = scene.sample(rng)
    w = cp.mechanism.project_velocity(scene, q, rng.normal(size=made.nv))
    assert (np.abs(curvature(scene, q, v) @ w).max() < 1e-9) == integrable
    assert cp.mechanism.is_integrable(scene, q) == integrable


def test_driven_joint_force():
    scene, q, v, answer, _ = crank()
    bar = scene.robot
    u = cp.inverse_dynamics(cp.Scene(bar, bar.loops), q, v, answer.a, passive=np.ones(3)).u
    assert answer.lam[-1] == pytest.approx(u[0], abs=1e-9)


# --- contact -------------------------------------------------------------------------------------


def sliding(friction=0.3, slope=0.5, v0=0.5, dt=1e-3):
    """A ball that cannot turn would do; a point on a slope does."""
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelTranslation(), pin.SE3.Identity(), "body")
    model.appendBodyToJoint(joint, pin.Inertia(2.0, np.zeros(3), np.eye(3)), pin.SE3.Identity())
    model.addFrame(pin.Frame("body", joint, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    model.gravity.linear = GRAVITY * np.array([np.sin(slope), 0.0, -np.cos(slope)])
    point = cp.FrictionalContact("body", friction=friction)
    scene = cp.Scene(cp.Robot("point", model), contacts=[point])
    exact = cp.Moreau(ADMM(polish=True))
    return cp.step(scene, np.zeros(3), np.array([v0, 0, 0]), np.zeros(3), dt=dt, integrator=exact)


def test_coulomb():
    now = sliding()
    t1, t2, n = np.array(now.forces["body"])
    assert n == pytest.approx(2.0 * GRAVITY * np.cos(0.5), rel=1e-9)
    assert np.hypot(t1, t2) == pytest.approx(0.3 * n, rel=1e-9)
    assert now.modes["body"] == "slide"
    held = sliding(friction=2.0, v0=0.0)
    t1, t2, n = np.array(held.forces["body"])
    assert np.hypot(t1, t2) <= 2.0 * n
    assert held.modes["body"] == "stick"


def test_signorini():
    now = sliding()
    normal, opening = now.contact.lam[2], now.contact.sigma[2]
    assert normal > 0
    assert abs(opening) < 1e-12
    assert now.contact.residuals.signorini < 1e-12


def test_slide():
    now = sliding()
    a = (now.v[0] - 0.5) / 1e-3
    assert a == pytest.approx(GRAVITY * (np.sin(0.5) - 0.3 * np.cos(0.5)), rel=1e-8)


def test_restitution():
    ball, e = cp.model.free_ball(mass=1.0, radius=0.05), 0.8
    floor = cp.FrictionalContact("ball", cp.constraints.Ball(0.05), friction=0.2, restitution=e)
    scene = cp.Scene(ball, contacts=[floor])
    q, v = scene.state()
    q[2] = 0.55  # half a metre below it
    run = cp.simulate(scene, q, v, duration=1.2, dt=1e-3, integrator=cp.stepping.EventDriven())
    first = run.run.happened[0].t
    later = run.t > first
    assert run.gaps["ball"][later].max() == pytest.approx(0.5 * e**2, abs=1e-5)


def test_painleve():
    made, half = cp.model.painleve_rod(length=2.0), 1.0
    q = made.postures["paradox"]
    s, c, J = np.sin(q[2]), np.cos(q[2]), 2.0**2 / 12
    limit = (J + half**2 * c**2) / (half**2 * s * c)
    assert limit == pytest.approx(4 / 3)
    M = cp.Workspace(cp.Scene(made)).terms(q, np.zeros(3)).M
    tip = np.array([[1.0, 0.0, half * s], [0.0, 1.0, -half * c]])  # of x and z
    G = tip @ np.linalg.inv(M) @ tip.T
    # a normal force N lifts the tip by G_zz N + G_zx mu N while that slides towards -x
    for mu, lifts in ((limit - 1e-6, True), (limit + 1e-6, False)):
        assert (G[1, 1] + mu * G[1, 0] > 0) == lifts


# --- control -------------------------------------------------------------------------------------


def test_inverse_dynamics():
    c = case()
    found = cp.inverse_dynamics(c.scene, c.q, c.v, c.a)
    close(found.tau + c.J.T @ found.lam, c.M @ c.a + c.h)


def test_transmission():
    delta = cp.model.delta()
    scene = cp.Scene(delta, delta.loops)
    q, v = scene.sample(np.random.default_rng(0))
    found = transmission(scene, q)
    w = np.linalg.lstsq(found.actuation.B, v, rcond=None)[0]
    close(found.velocities(w), v)
    tau = np.random.default_rng(1).normal(size=delta.nv)
    assert found.motor_torques(tau) @ w == pytest.approx(tau @ v, rel=1e-8)


def test_operational():
    c = case()
    space = operational_space(c.scene, c.q, "base_link")
    P = c.M_inv - c.M_inv @ c.J.T @ np.linalg.solve(c.G, c.J @ c.M_inv)
    close(space.Lambda, np.linalg.inv(space.J @ P @ space.J.T))
