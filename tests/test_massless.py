"""Machines whose mass matrix is singular at some postures: those are refused, and no others.

Hinges with massless links between them stand in for a ball until two of their axes meet; a point
mass on a slider turns about a hinge until it is on its axis.
"""

from __future__ import annotations

import functools
import re
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pinocchio as pin
import pytest
from oracle import Oracle
from shared import SOLVERS, central

import condyn_pin as cp

AXES = {
    "yaw": pin.JointModelRZ, "pitch": pin.JointModelRY, "roll": pin.JointModelRX,
    "again": pin.JointModelRZ,
}  # fmt: skip
LOCKED = np.array([0.2, 0.5 * np.pi, 0.3, 0.4])
NAMED = re.escape("at q = [0.2") + ".*yaw, roll can move there without moving inertia"


def arm(*names: str) -> cp.Scene:
    """A leg on hinges of these axes at one point, its foot on the ground."""
    model = pin.Model()
    inertia = pin.Inertia(1.0, np.array([0.0, 0.0, -0.3]), np.diag([0.02, 0.03, 0.01]))
    down = pin.SE3(np.eye(3), np.array([0.0, 0.0, -0.5]))
    i = 0
    for name in names:
        i = model.addJoint(i, AXES[name](), pin.SE3.Identity(), name)
    model.appendBodyToJoint(i, inertia, pin.SE3.Identity())
    i = model.addJoint(i, pin.JointModelRY(), down, "knee")
    model.appendBodyToJoint(i, inertia, pin.SE3.Identity())
    model.addFrame(pin.Frame("foot", i, 0, down, pin.FrameType.OP_FRAME))
    return cp.Scene(cp.Robot("leg", model), [cp.PointContact("foot")])


WRIST = """<robot name="wrist"><link name="base"/><link name="one"/><link name="two"/>
<link name="hand"><inertial><mass value="1"/><origin xyz="0.1 0.05 0.2"/>
<inertia ixx="0.01" iyy="0.02" izz="0.015" ixy="0" ixz="0" iyz="0"/></inertial></link>
{}</robot>"""
HINGE = """<joint name="{}" type="revolute"><parent link="{}"/><child link="{}"/>
<axis xyz="{}"/><limit lower="-3" upper="3" effort="9" velocity="9"/></joint>"""


def polar(*, gravity: float = -9.81) -> cp.Robot:
    """A point mass on a slider on a hinge: M = diag(r^2, 1), singular where r = 0."""
    model = pin.Model()
    model.gravity.linear = np.array([0.0, 0.0, gravity])
    here = pin.SE3.Identity()
    swing = model.addJoint(0, pin.JointModelRY(), here, "swing")
    slide = model.addJoint(swing, pin.JointModelPZ(), here, "slide")
    model.appendBodyToJoint(slide, pin.Inertia(1.0, np.zeros(3), np.zeros((3, 3))), here)
    model.addFrame(pin.Frame("mass", slide, 0, here, pin.FrameType.OP_FRAME))
    return cp.Robot("polar", model)


class Sometimes(NamedTuple):
    """A robot whose M is singular in the neutral posture and at `there`, not where it is `good`."""

    robot: cp.Robot
    good: list[list[float]]
    there: list[float]
    named: str


@functools.cache
def sometimes(name: str) -> Sometimes:
    if name == "polar":
        good = [[0.3, 2.0], [-1.0, -5.0], [0.3, 1e-3], [0.3, 1e-6]]
        return Sometimes(polar(), good, [0.3, 0.0], "swing can move there without moving inertia")
    hinges = [("first", "base", "one"), ("middle", "one", "two"), ("last", "two", "hand")]
    axes = ["0 0 1", "0 1 0", "0 0 1"]
    joints = "".join(HINGE.format(*each, axis) for each, axis in zip(hinges, axes, strict=True))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "wrist.urdf"
        path.write_text(WRIST.format(joints), encoding="utf-8")
        made = cp.load_robot(path)
    good = [[0.2, 0.9, 0.3], [0.2, -0.01, 0.3]]
    named = "first, last can move there without moving inertia"
    return Sometimes(made, good, [0.2, 0.0, 0.5], named)


each_of_two = pytest.mark.parametrize("name", ["polar", "wrist"])


def rate(of: Sometimes) -> np.ndarray:
    return np.linspace(0.5, 1.0, of.robot.nv)


@pytest.fixture(scope="module")
def scene():
    return arm("yaw", "pitch", "roll")


METHODS = [made() for made in SOLVERS.values()]


@pytest.mark.parametrize("solver", METHODS, ids=lambda solver: type(solver).__name__)
def test_a_solve_names_the_joints_and_the_configuration(scene, solver):
    still = np.zeros(4)
    with pytest.raises(cp.SolveFailed, match=NAMED) as failed:
        cp.solve(scene, LOCKED, still, still, solver=solver)
    assert "mu is too small" not in str(failed.value)
    assert "redundant" not in str(failed.value)
    found = cp.solve(scene, LOCKED, still, still, solver=solver, throw=False)
    assert not found.status.ok
    (notice,) = found.notices
    assert re.search(NAMED, notice)


@pytest.mark.parametrize("apart", [1e-1, 1e-2, 1e-3, 1e-4, 1e-6, 1e-8])
def test_what_is_ok_near_the_lock_is_right(scene, apart):
    """M falls with the square of the angle between the axes, and rounding of it grows in a."""
    accepted, still = 0, np.zeros(4)
    for seed in range(4):
        rng = np.random.default_rng(seed)
        q = LOCKED + apart * (1 + 0.1 * seed) * np.array([0.0, 1.0, 0.0, 0.0])
        q[[0, 2, 3]] += 0.3 * rng.normal(size=3)
        exact, _ = Oracle(scene).solve(q, still, still)
        right = exact.astype(float).ravel()
        size = max(9.81, float(np.abs(right).max()))
        for solver in METHODS:
            if not solver.exact:
                continue
            found = cp.solve(scene, q, still, still, solver=solver, throw=False)
            accepted += found.status.ok
            assert not found.status.ok or np.abs(found.a - right).max() < 1e-8 * size, solver
    assert bool(accepted) == (apart > 1e-4)


@pytest.mark.long
def test_pivots_that_no_link_without_inertia_lowers_are_not_watched():
    assert cp.Scene(arm("yaw", "pitch", "roll").robot).nominal.pivots.may_fall
    for name in ("four_bar", "talos", "solo12"):
        assert not cp.Scene(cp.load_robot(name)).nominal.pivots.may_fall


@pytest.mark.long
def test_without_constraints_too(scene):
    with pytest.raises(cp.SolveFailed, match=NAMED):
        cp.solve(cp.Scene(scene.robot), LOCKED, np.zeros(4), np.zeros(4))


@pytest.mark.parametrize(
    "ask",
    [
        lambda scene, still: scene.rank(LOCKED),
        lambda scene, still: cp.mechanism.project_velocity(
            scene, LOCKED, still + 1.0, metric="mass"
        ),
        lambda scene, still: cp.derivatives(scene, LOCKED, still, still),
        lambda scene, still: cp.simulate(scene, LOCKED, still, duration=0.01, dt=0.001),
        lambda scene, still: cp.control.operational_space(scene, LOCKED, "foot"),
    ],
    ids=["rank", "project_velocity", "derivatives", "simulate", "operational_space"],
)
def test_whatever_is_asked_names_them(scene, ask):
    with pytest.raises((cp.errors.InvalidModel, cp.SolveFailed), match=NAMED):
        ask(scene, np.zeros(4))


@pytest.mark.long
def test_a_scene_whose_first_posture_is_there():
    """Two yaw hinges with a pitch between them, and that at zero: the robot is sound elsewhere."""
    scene = arm("yaw", "pitch", "again")
    assert scene.rank().rank == 3
    assert scene.check(scene.nominal.q).closed
    q, _ = scene.state()
    assert np.abs(q).max() < 1e-12  # a posture stays what it is
    with pytest.raises(cp.errors.InvalidModel, match="yaw, again can move there without"):
        scene.rank(q)


@pytest.mark.values
@pytest.mark.parametrize("off", [1e-5, 1e-7])
@pytest.mark.parametrize("solver", METHODS, ids=lambda solver: type(solver).__name__)
def test_nearby_an_answer_that_is_not_ok_says_why(scene, solver, off):
    q, still = LOCKED - [0.0, off, 0.0, 0.0], np.zeros(4)
    found = cp.solve(scene, q, still, still + 1.0, solver=solver, throw=False)
    assert not found.status.ok
    (said,) = (text for text in found.notices if "mass matrix" in text)
    assert re.search("(nearly singular|not positive definite) at q.* yaw, roll can move", said)


@pytest.mark.long
def test_elsewhere_nothing_is_said(scene):
    q = LOCKED - [0.0, 0.3, 0.0, 0.0]
    found = cp.solve(scene, q, np.zeros(4), np.zeros(4))
    assert found.status.ok
    assert not [text for text in found.notices if "inertia" in text]


@pytest.mark.values
@each_of_two
@pytest.mark.parametrize("solver", METHODS, ids=lambda solver: type(solver).__name__)
def test_states_are_answered_but_for_those_where_M_is_singular(name, solver):
    of, data = sometimes(name), sometimes(name).robot.model.createData()
    scene, v, tau = cp.Scene(of.robot), rate(of), np.zeros(of.robot.nv)
    workspace = cp.Workspace(scene, solver)
    for q in np.array(of.good):
        right = pin.aba(of.robot.model, data, q, v, tau)
        found = workspace.solve(q, v, tau)
        size = max(9.81, float(np.abs(right).max()))
        assert found.status.ok
        assert not found.notices
        assert np.abs(found.a - right).max() < 1e-9 * size
        assert np.abs(workspace.acceleration(q, v, tau) - right).max() < 1e-9 * size
    there = np.array(of.there)
    for ask in (workspace.solve, workspace.acceleration):
        with pytest.raises(cp.SolveFailed, match=of.named):
            ask(there, v, tau)
    assert not workspace.solve(there, v, tau, throw=False).status.ok


@pytest.mark.long
def test_a_mass_in_polar_coordinates_falls_as_newton_says():
    scene, (angle, r), (turning, going) = cp.Scene(polar()), (0.3, 2.0), (1.0, 0.5)
    turns = (9.81 * np.sin(angle) - 2 * going * turning) / r
    slides = r * turning**2 - 9.81 * np.cos(angle)
    found = cp.solve(scene, [angle, r], [turning, going], [0.0, 0.0])
    assert found.a == pytest.approx([turns, slides], rel=1e-12)


@each_of_two
def test_what_is_said_of_a_scene_is_said_of_a_regular_state(name):
    of = sometimes(name)
    scene = cp.Scene(of.robot)
    assert scene.summary().mobility == scene.rank().mobility == of.robot.nv
    assert scene.nominal.condition < 1e4
    assert np.array_equal(scene.state()[0], pin.neutral(of.robot.model))
    with pytest.raises(cp.errors.InvalidModel, match=of.named):
        scene.summary(of.there)


@pytest.mark.long
@each_of_two
def test_whatever_needs_M_is_refused_there_and_nowhere_else(name):
    of, scene = sometimes(name), cp.Scene(sometimes(name).robot)
    v, tau, good = rate(of), np.zeros(of.robot.nv), np.array(of.good[0])
    frame = of.robot.frames[-1]
    touching = [cp.FrictionalContact(frame, cp.constraints.Point(), friction=0.5)]
    floor = cp.Scene(of.robot, contacts=touching)
    asked = (
        lambda q: cp.derivatives(scene, q, v, tau).da_dq,
        lambda q: cp.mechanism.project_velocity(scene, q, v, metric="mass"),
        lambda q: cp.simulate(scene, q, v, duration=0.01, dt=1e-3).q,
        lambda q: cp.stepping.step(floor, q, v, tau, dt=1e-3).v,
    )
    for ask in asked:
        assert np.isfinite(ask(good)).all()
        with pytest.raises((cp.errors.InvalidModel, cp.SolveFailed), match=of.named):
            ask(np.array(of.there))
    workspace = cp.Workspace(scene)
    for k, push in enumerate(np.eye(of.robot.nv)):
        slope = central(lambda h, push=push: workspace.acceleration(good + h * push, v, tau))
        assert workspace.derivatives(good, v, tau).da_dq[:, k] == pytest.approx(slope, abs=1e-6)


@pytest.mark.long
@each_of_two
@pytest.mark.parametrize(
    "core",
    [pytest.param(False, id="Python"), pytest.param(True, id="core", marks=pytest.mark.native)],
)
def test_a_batch_is_answered_but_for_its_rows_there(name, core):
    of = sometimes(name)
    scene, executor = cp.Scene(of.robot), cp.Native(threads=1) if core else None
    Q, V = np.array([of.good[0], of.there, of.good[1]]), np.tile(rate(of), (3, 1))
    found = cp.solve_batch(scene, Q, V, 0, executor=executor)
    assert found.failed.tolist() == [1]
    slopes = cp.simulation.derivatives_batch(scene, Q, V, 0, executor=executor)
    assert np.isfinite(slopes.da_dq[[0, 2]]).all()
    runs = cp.simulate_batch(scene, Q, V, duration=0.005, dt=1e-3, executor=executor)
    assert [bool(re.search(of.named, reason)) for reason in runs.reasons] == [False, True, False]


@pytest.mark.values
@pytest.mark.parametrize("offset", [0.0, 1e-9, 1e-6, 1e-3, 1e-2])
@pytest.mark.parametrize(
    "integrator",
    [cp.RungeKutta4(), cp.simulation.DormandPrince(), cp.simulation.SemiImplicitEuler()],
    ids=lambda integrator: type(integrator).__name__,
)
def test_a_motion_that_passes_by_the_axis_is_right_or_says_that_it_is_not(integrator, offset):
    """A free mass goes straight ahead; in polar coordinates half a turn takes offset / 2 s."""
    scene, q = cp.Scene(polar(gravity=0.0)), np.array([0.3, 1.0])
    v = 2.0 * np.array([offset, -np.sqrt(1 - offset**2)])
    run = cp.simulate(scene, q, v, duration=1.0, dt=1e-3, integrator=integrator)
    outward, across = np.array([np.sin(0.3), np.cos(0.3)]), np.array([np.cos(0.3), -np.sin(0.3)])
    place = run.q[:, 1, None] * np.column_stack((np.sin(run.q[:, 0]), np.cos(run.q[:, 0])))
    right = outward + run.t[:, None] * (v[1] * outward + v[0] * across)
    right_to_the_end = run.status.ok and np.abs(place - right).max() < 1e-6
    assert right_to_the_end or not run.status.ok or "energy appeared or vanished" in run.notices[0]


@pytest.mark.long
def test_loops_are_closed_where_the_first_posture_is_singular():
    """The middle hinge follows a crank: closed and singular at zero, and regular around it."""
    model = pin.Model()
    crank = model.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), "crank")
    model.appendBodyToJoint(crank, pin.Inertia.FromSphere(1.0, 0.1), pin.SE3.Identity())
    place = pin.SE3(np.eye(3), np.array([1.0, 0.0, 0.0]))
    i = crank
    for name in ("yaw", "pitch", "again"):
        i = model.addJoint(i, AXES[name](), place, name)
        place = pin.SE3.Identity()
    body = pin.Inertia(1.0, np.array([0.5, 0.05, 0.1]), np.diag([0.01, 0.1, 0.1]))
    model.appendBodyToJoint(i, body, pin.SE3.Identity())
    geared = cp.Scene(cp.Robot("geared", model), [cp.constraints.Coupling("pitch", "crank", 0.7)])
    assert geared.summary().mobility == 3
    closed, still = geared.assemble(np.zeros(4)).q, np.zeros(4)
    assert np.abs(closed).max() < 1e-12
    with pytest.raises(cp.SolveFailed, match="yaw, again can move there without moving inertia"):
        cp.solve(geared, closed, still, still)
    q, v = geared.sample(np.random.default_rng(1))
    exact, _ = Oracle(geared).solve(q, v, still)
    for solver in METHODS:
        if not solver.exact or not solver.takes_every_kind:
            continue
        found = cp.solve(geared, q, v, still, solver=solver)
        assert found.a == pytest.approx(exact.astype(float).ravel(), rel=1e-8, abs=1e-8)
    assert cp.simulate(geared, q, v, duration=0.05, dt=1e-3).status.ok


@pytest.mark.long
def test_torques_of_a_controller_do_not_need_M_to_be_regular():
    of = sometimes("wrist")
    robot = replace(of.robot, actuated=of.robot.joints)
    scene, v = cp.Scene(robot), rate(of)
    still = cp.control.Posture(np.zeros(3))
    controller = cp.control.Controller(scene, [still], cones={})
    for q in (np.array(of.good[0]), np.array(of.there)):
        out = controller.solve(q, v)
        right = pin.rnea(robot.model, robot.model.createData(), q, v, out.a)
        assert out.status.ok
        assert out.tau == pytest.approx(right, abs=1e-9)


def test_a_joint_that_moves_no_inertia_anywhere_is_refused():
    """A hinge along the slider whose point mass is on its axis at any q."""
    model, here = pin.Model(), pin.SE3.Identity()
    spin = model.addJoint(0, pin.JointModelRZ(), here, "spin")
    slide = model.addJoint(spin, pin.JointModelPZ(), here, "slide")
    model.appendBodyToJoint(slide, pin.Inertia(1.0, np.zeros(3), np.zeros((3, 3))), here)
    with pytest.raises(cp.errors.InvalidModel, match="no inertia moves with spin"):
        cp.Robot("spinning", model)
